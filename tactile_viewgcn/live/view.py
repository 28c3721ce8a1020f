"""Shows the updates of `live`: a line on a terminal, lines of text, or JSON for programs."""

import json
import shutil
import sys
import time
import unicodedata
from collections import deque
from collections.abc import Callable
from typing import Any

import click

from tactile_viewgcn.live.stream import Update
from tactile_viewgcn.messages import several, shown

BAR = 20  # letters
OBJECT_WIDTH = 20  # columns of a terminal
STATE_WIDTH = 8
RATE_SECONDS = 2.0  # time over which the frames per second are counted
DRAWN_SECONDS = 0.05  # shortest time from one drawing of a line to the next
CLEAR = "\r\x1b[K"  # goes to the beginning of the line, and clears it
HINTS = {"waiting": "open your hand", "ready": "take an object"}


class View:
    """Shows an update of a stream as a line of text, if the state or the object has changed.

    Args:
        out: prints a text as it is, without the end of a line.
        err: prints a text on standard error.
    """

    def __init__(self, out: Callable[[str], Any], err: Callable[[str], Any]):
        self._out = out
        self._err = err
        self._last = ("", "")  # state and object

    def show(self, update: Update, line: int) -> None:
        """Show an update.

        Args:
            update: of the stream.
            line: number of the line that brought the update.
        """
        now = (update.state, update.object or "")
        if now == self._last and update.state != "final":
            return
        self._last = now
        self._out(f"line {line:>8,}  {described(update).rstrip()}\n")

    def say(self, text: str) -> None:
        """Print a line on standard error.

        Args:
            text: the line without the end of a line.
        """
        self._err(f"{shown(text)}\n")

    def count_frame(self) -> None:
        """Count a frame, for the frames per second."""

    def draw(self) -> None:
        """Draw the line that is updated in place; a view without such a line does nothing."""

    def end(self) -> None:
        """Remove the line that is updated in place; a view without such a line does nothing."""


class JsonView(View):
    """Prints each update as a line of JSON."""

    def __init__(self, out: Callable[[str], Any], err: Callable[[str], Any], classes: list[str]):
        super().__init__(out, err)
        self._classes = classes

    def show(self, update: Update, line: int) -> None:
        """See `View.show`."""
        probabilities = None
        if update.probabilities is not None:
            values = update.probabilities.tolist()
            probabilities = dict(zip(self._classes, values, strict=True))
        record = {
            "state": update.state,
            "line": line,
            "frame": update.frame,
            "time": update.time,
            "object": update.object,
            "probability": update.probability,
            "frames": update.frames,
            "seconds": update.seconds,
            "note": update.note,
            "probabilities": probabilities,
        }
        self._out(json.dumps(record) + "\n")


class TerminalView(View):
    """Updates one line of a terminal in place, and leaves the line of each final answer.

    Args:
        out: see `View`.
        err: see `View`.
        width: returns the columns of the terminal.
        letters: the letters of the bar, full and empty.
    """

    def __init__(
        self,
        out: Callable[[str], Any],
        err: Callable[[str], Any],
        *,
        width: Callable[[], int],
        letters: str,
    ):
        super().__init__(out, err)
        self._width = width
        self._letters = letters
        self._update: Update | None = None
        self._times = deque[float]()  # of the frames in the last seconds
        self._drawn_at = 0.0

    def show(self, update: Update, line: int) -> None:
        """See `View.show`."""
        if update.state == "final":
            text = described(update, self._letters)
            self._out(f"{CLEAR}{fitted(text, self._width() - 1).rstrip()}\n")
            self._update = None
            return
        is_new = self._update is None or update.state != self._update.state
        self._update = update
        if is_new:
            self._drawn_at = 0.0

    def say(self, text: str) -> None:
        """See `View.say`; the line that is updated in place stays the last line."""
        self._out(CLEAR)
        super().say(text)
        self._drawn_at = 0.0

    def count_frame(self) -> None:
        """See `View.count_frame`."""
        self._times.append(time.monotonic())

    def draw(self) -> None:
        """See `View.draw`; the line is drawn at most twenty times a second."""
        now = time.monotonic()
        if now - self._drawn_at < DRAWN_SECONDS:
            return
        self._drawn_at = now
        while self._times and self._times[0] < now - RATE_SECONDS:
            self._times.popleft()
        text = "no frame yet"
        if self._update is not None:
            text = described(self._update, self._letters)
        rate = f"{len(self._times) / RATE_SECONDS:.0f} frames/s"
        room = self._width() - 1 - len(rate) - 2
        self._out(f"{CLEAR}{fitted(text, room)}  {rate}")

    def end(self) -> None:
        """See `View.end`."""
        self._out(CLEAR)


def view_of(classes: list[str], *, as_json: bool) -> View:
    """Return a view that suits standard output: JSON, a terminal, or lines of text.

    Args:
        classes: names of the classes.
        as_json: whether programs read the output.
    """

    def out(text: str) -> None:
        click.echo(text, nl=False)

    def err(text: str) -> None:
        click.echo(text, nl=False, err=True)

    if as_json:
        return JsonView(out, err, classes)
    if not sys.stdout.isatty():
        return View(out, err)
    letters = "#."
    if (sys.stdout.encoding or "").lower().startswith("utf"):
        letters = "█░"
    return TerminalView(out, err, width=lambda: shutil.get_terminal_size().columns, letters=letters)


def described(update: Update, letters: str = "#.") -> str:
    """Return an update in one line: state, object, probability as a bar and in percent, duration.

    Args:
        update: of a stream.
        letters: the letters of the bar, full and empty.
    """
    state = f"{update.state:<{STATE_WIDTH}}"
    if update.state in HINTS:
        return f"{state} {update.note or HINTS[update.state]}"
    duration = several(update.frames, "frame")
    if update.seconds is not None:
        duration = f"{update.seconds:.1f} s"
    if update.probability is None:
        reason = "no answer yet"
        if update.note:
            reason = f"no answer: {update.note}"
        return f"{state} {reason}  {duration}"
    full = round(BAR * update.probability)
    bar = full * letters[0] + (BAR - full) * letters[1]
    name = fitted(shown(update.object), OBJECT_WIDTH)
    text = f"{state} {name} {bar} {100 * update.probability:3.0f} %  {duration}"
    if update.note:
        text += f"  {update.note}"
    return text


def fitted(text: str, width: int) -> str:
    """Return a text that fills a number of columns of a terminal, cut or with blanks at its end.

    Args:
        text: without control characters.
        width: number of columns; a wide letter takes two.
    """
    fitting = ""
    taken = 0
    for letter in text:
        columns = _columns_of(letter)
        if taken + columns > width:
            break
        fitting += letter
        taken += columns
    return fitting + " " * (width - taken)


def _columns_of(letter: str) -> int:
    """Return how many columns of a terminal a letter takes."""
    if unicodedata.combining(letter):
        return 0
    if unicodedata.east_asian_width(letter) in "WF":
        return 2
    return 1
