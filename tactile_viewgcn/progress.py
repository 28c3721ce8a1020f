"""Shows the progress of a long step: a bar on a terminal, elsewhere a line about every 10 s.

Commands show progress, since they enter the context `shown`. A Python program that uses the package
sees nothing unless it enters this context too.
"""

import sys
import time
from collections.abc import Iterable, Iterator, Sized
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

from tqdm import tqdm

EVERY = 10.0  # least seconds between two lines, and before the first line
clock = time.monotonic
Item = TypeVar("Item")
_is_shown = ContextVar("is_shown", default=False)


@contextmanager
def shown(is_shown: bool = True) -> Iterator[None]:
    """Enter a context in which progress is shown, or is not shown."""
    token = _is_shown.set(is_shown)
    try:
        yield
    finally:
        _is_shown.reset(token)


def is_shown() -> bool:
    """Return whether progress is shown here; a process that is started here has to be told."""
    return _is_shown.get()


def steps(items: Iterable[Item], step: str, units: str) -> Iterator[Item]:
    """Yield the items, and show the progress through them.

    Args:
        items: the items of the step; their number is the total, if they have a length.
        step: see `progress`.
        units: see `progress`.
    """
    total = None
    if isinstance(items, Sized):
        total = len(items)
    with progress(step, units, total) as bar:
        for item in items:
            yield item
            bar.update()


def progress(step: str, units: str = "", total: int | None = None, done: int = 0) -> "tqdm[Any]":
    """Return a context whose `update(n)` counts n more units.

    Args:
        step: the words before the numbers.
        units: the things that are counted, such as frames.
        total: number of units; if it is None, only the seconds are shown.
        done: number of units before the first update.
    """
    settings: dict[str, Any] = {
        "desc": step,
        "unit": f" {units}",
        "total": total,
        "initial": done,
        "leave": False,
    }
    if not _is_shown.get():
        return tqdm(disable=True, **settings)
    if sys.stderr.isatty():
        return tqdm(file=sys.stderr, **settings)
    return _Lines(file=sys.stderr, **settings)


@contextmanager
def working(step: str) -> Iterator[None]:
    """Enter a step that says about every ten seconds that it goes on.

    On a terminal it says nothing, since bars show the progress.
    """
    if sys.stderr.isatty():
        yield
        return
    with progress(step):
        yield


def say(text: str) -> None:
    """Print a line on standard error at once, above a bar."""
    if not _is_shown.get():
        return
    if sys.stderr.isatty():
        tqdm.write(text, file=sys.stderr)
        return
    print(text, file=sys.stderr, flush=True)
    _Lines.last = clock()


class _Lines(tqdm):  # type: ignore[type-arg]  # tqdm cannot be indexed when the program runs
    """Progress as lines; a line names all steps that are under way, the outer steps first.

    tqdm's monitor also calls `display` if nothing was counted for a long time.
    """

    monitor_interval = EVERY / 2  # type: ignore[assignment]  # tqdm's types have an integer
    under_way: "list[_Lines]" = []  # noqa: RUF012  # shared in this process
    last = 0.0  # when the last line was printed

    def __init__(self, **settings: Any):
        # with the delay nothing is printed here
        super().__init__(delay=EVERY, maxinterval=EVERY, **settings)
        self.begin = clock()
        if not self.under_way:
            _Lines.last = clock()
        self.under_way.append(self)
        self._look_after()

    def update(self, n: float | None = 1) -> bool | None:
        """Count n more units, and print a line if it is time."""
        self.n += n or 0
        self.display()
        return None

    def close(self) -> None:
        """End the step."""
        # tqdm compares bars by their position, so `is` is needed
        _Lines.under_way = [bar for bar in self.under_way if bar is not self]
        super().close()

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Print the line if this is the innermost step and the last line is old enough."""
        self._look_after()
        is_innermost = bool(self.under_way) and self.under_way[-1] is self
        if msg == "" or not is_innermost:
            return
        if clock() - self.last >= EVERY:
            print("; ".join(bar.text() for bar in self.under_way), file=self.fp, flush=True)
            _Lines.last = clock()

    def _look_after(self) -> None:
        """Make tqdm's monitor call `display` after `maxinterval`.

        The monitor does this for a bar with `miniters` above 1.
        """
        self.miniters = 2
        self.last_print_t = time.time()

    def text(self) -> str:
        """Return the step, how many units are done, and about how long the other units take."""
        seconds = clock() - self.begin
        text = self.desc.removesuffix(": ")
        if not self.total:
            return f"{text}: {seconds:,.0f} s"
        text += f": {self.n:,} of {self.total:,}{self.unit}"
        done = self.n - self.initial
        if done > 0:
            text += f", about {seconds * (self.total - self.n) / done:,.0f} s left"
        return text
