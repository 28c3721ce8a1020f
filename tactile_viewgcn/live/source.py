"""The lines of the input, read on by a thread while answers are computed."""

import queue
import time
from collections import deque
from collections.abc import Callable
from threading import Thread

CHUNK = 1 << 16  # bytes that are read at once
MOST_CHUNKS = 256  # read ahead; a program that prints more waits
LONGEST_LINE = 1 << 23  # bytes


class LineSource:
    """Lines in the order in which they come, none of which is lost.

    It reads from when it is made.

    Args:
        read: returns the next bytes, at most so many, and waits for them; none at the end.

    Attributes:
        number: of the last line, from 1.
        came_at: when the last line came, in seconds of the monotonic clock; at first when it was
            made.
        has_ended: whether there are no more lines.
        cut: what follows the last line's end, at the end of the input.
    """

    def __init__(self, read: Callable[[int], bytes]):
        self.number = 0
        self.came_at = time.monotonic()
        self.has_ended = False
        self.cut = b""
        self._chunks = queue.Queue[tuple[float, bytes]](MOST_CHUNKS)
        self._lines = deque[bytes]()
        # it may wait for input for ever, which does not keep the program from ending
        Thread(target=self._read_on, args=(read,), daemon=True).start()

    @property
    def are_waiting(self) -> bool:
        """Return whether more lines than the last one have come already."""
        return bool(self._lines) or not self._chunks.empty()

    def next(self, seconds: float) -> bytes | None:
        """Return the next line; None if none comes in so many seconds, or at the end.

        A line of more than 8 MiB is cut there.

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
        self.came_at = came_at
        first, *others = chunk.split(b"\n")
        self.cut = (self.cut + first)[:LONGEST_LINE]
        for part in others:
            self._lines.append(self.cut)
            self.cut = part

    def _read_on(self, read: Callable[[int], bytes]) -> None:
        chunk = b"not at the end"
        while chunk:
            try:
                chunk = read(CHUNK)
            except OSError:  # of a terminal that is closed
                chunk = b""
            self._chunks.put((time.monotonic(), chunk))
