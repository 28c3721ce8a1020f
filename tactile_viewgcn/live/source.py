"""The lines of the input, which a thread reads while answers are computed."""

import queue
import time
from collections import deque
from collections.abc import Callable
from threading import Thread

CHUNK = 1 << 16  # bytes that are read at once
MOST_CHUNKS = 256  # chunks that are read ahead; a program that prints more has to wait
LONGEST_LINE = 1 << 23  # bytes of a line that are kept, 8 MiB; such a long line is no frame


class LineSource:
    """Lines in the order in which they come; no line is lost.

    A thread begins to read when the object is made.

    Args:
        read: waits for the next bytes and returns them, at most as many as its argument says. At
            the end of the input it returns no bytes.

    Attributes:
        number: number of the last line, from 1.
        came_at: when the end of the last line came, in seconds of the monotonic clock; before the
            first line, when the object was made.
        has_ended: whether there are no more lines.
    """

    def __init__(self, read: Callable[[int], bytes]):
        self.number = 0
        self.came_at = time.monotonic()
        self.has_ended = False
        self._parts = list[bytes]()  # of the line whose end has not come
        self._length = 0  # bytes of these parts
        self._chunks = queue.Queue[tuple[float, bytes]](MOST_CHUNKS)
        self._lines = deque[bytes]()
        # a daemon: it can wait for input for ever without keeping the program from ending
        Thread(target=self._read_on, args=(read,), daemon=True).start()

    @property
    def is_behind(self) -> bool:
        """Return whether more input than the last line has come already."""
        return bool(self._lines) or not self._chunks.empty()

    @property
    def cut(self) -> bytes:
        """Return the bytes after the end of the last line."""
        return b"".join(self._parts)

    def next(self, seconds: float) -> bytes | None:
        """Return the next line; None if no line comes in time, or at the end of the input.

        A line of more than `LONGEST_LINE` bytes is cut there.

        Args:
            seconds: how long to wait for a line.
        """
        if not self._lines and not self.has_ended:
            self._take(seconds)
        if not self._lines:
            return None
        self.number += 1
        return self._lines.popleft()

    def _take(self, seconds: float) -> None:
        """Wait for bytes, and split them into lines."""
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
        """Keep a part of a line, up to the longest line."""
        part = part[: LONGEST_LINE - self._length]
        if part:
            self._parts.append(part)
            self._length += len(part)

    def _read_on(self, read: Callable[[int], bytes]) -> None:
        chunk = b"not at the end"
        while chunk:
            try:
                chunk = read(CHUNK)
            except OSError:  # the terminal was closed
                chunk = b""
            self._chunks.put((time.monotonic(), chunk))
