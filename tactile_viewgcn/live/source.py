"""The lines of the input, read on by a thread while answers are computed."""

import queue
import time
from collections import deque
from collections.abc import Callable
from threading import Thread

CHUNK = 1 << 16  # bytes that are read at once
MOST_CHUNKS = 256  # read ahead; a program that prints more waits
LONGEST_LINE = 1 << 23  # bytes that are kept of a line, 8 MiB; a line of so many is no frame


class LineSource:
    """Lines in the order in which they come, none of which is lost.

    A thread begins to read when this is made.

    Args:
        read: returns the next bytes, at most so many, and waits for them; none at the end.

    Attributes:
        number: of the last line, from 1.
        came_at: when the end of the last line came, in seconds of the monotonic clock; at first
            when this was made.
        has_ended: whether there are no more lines.
    """

    def __init__(self, read: Callable[[int], bytes]):
        self.number = 0
        self.came_at = time.monotonic()
        self.has_ended = False
        self._parts = list[bytes]()  # of the line whose end has not come
        self._length = 0  # of these parts
        self._chunks = queue.Queue[tuple[float, bytes]](MOST_CHUNKS)
        self._lines = deque[bytes]()
        # it may wait for input for ever, which does not keep the program from ending
        Thread(target=self._read_on, args=(read,), daemon=True).start()

    @property
    def is_behind(self) -> bool:
        """Return whether more has come already than the last line."""
        return bool(self._lines) or not self._chunks.empty()

    @property
    def cut(self) -> bytes:
        """Return what follows the end of the last line."""
        return b"".join(self._parts)

    def next(self, seconds: float) -> bytes | None:
        """Return the next line; None if none comes in so many seconds, or at the end.

        A line of more than `LONGEST_LINE` bytes is cut there.

        Args:
            seconds: to wait.
        """
        if not self._lines and not self.has_ended:
            self._take(seconds)
        if not self._lines:
            return None
        self.number += 1
        return self._lines.popleft()

    def _take(self, seconds: float) -> None:
        """Wait for bytes, and part them into lines."""
        try:
            came_at, chunk = self._chunks.get(timeout=seconds)
        except queue.Empty:
            return
        if not chunk:
            self.has_ended = True
            return
        first, *others = chunk.split(b"\n")
        self._keep(first)
        for part in others:
            self._lines.append(self.cut)
            self._parts.clear()
            self._length = 0
            self._keep(part)
        if others:
            self.came_at = came_at

    def _keep(self, part: bytes) -> None:
        """Keep a part of a line, as far as the line may be so long."""
        part = part[: LONGEST_LINE - self._length]
        if part:
            self._parts.append(part)
            self._length += len(part)

    def _read_on(self, read: Callable[[int], bytes]) -> None:
        chunk = b"not at the end"
        while chunk:
            try:
                chunk = read(CHUNK)
            except OSError:  # of a terminal that is closed
                chunk = b""
            self._chunks.put((time.monotonic(), chunk))
