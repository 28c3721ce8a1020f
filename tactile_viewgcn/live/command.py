"""The command `live`: answers lines of numbers on standard input while the hand holds the object.

No frame is lost. If an answer takes longer than a frame, lines wait. The waiting frames are then
taken without a provisional answer, and the skipped answers are counted.
"""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from tactile_viewgcn.live.lines import Frame, FrameLines, LineError
from tactile_viewgcn.live.source import LineSource
from tactile_viewgcn.live.stream import LiveStream, Update
from tactile_viewgcn.live.view import View
from tactile_viewgcn.messages import UserError, several

EVERY_FRAME = (
    "warning: the training took every frame, so nothing shows where a grasp begins or ends; "
    "if its recordings begin with an open hand, train with preprocess.baseline=grasp"
)
TICK = 0.2  # seconds without a line after which the view is drawn again
MOST_QUIET = 10.0  # seconds without a line after which the user is told
MOST_WAITING = 10.0  # seconds without an open hand after which the user is told
FALLS = 1.0  # seconds; if the time falls by more, the logger has started again
MOST_REFUSED = 10  # number of lines whose faults are told; then the 100th, the 1000th and so on


class LiveCommand:
    """Lines of the input on their way through a stream to a view.

    Args:
        stream: answers frames.
        reader: reads a line as a frame.
        view: shows updates.
        skips: whether provisional answers are skipped while more lines wait.
        is_paced: whether a frame without a time gets the time at which its line came. The lines of
            a file all come at once, so this makes no sense for a file.
    """

    def __init__(
        self,
        stream: LiveStream,
        reader: FrameLines,
        view: View,
        *,
        skips: bool,
        is_paced: bool = True,
    ):
        self._stream = stream
        self._began_at = 0.0  # in seconds of the monotonic clock
        self._reader = reader
        self._view = view
        self._skips = skips
        self._is_paced = is_paced
        self._frames = 0
        self._first_frame_at: float | None = None  # in seconds of the monotonic clock
        self._refused = 0
        self._ended_by = 0  # number of the signal
        self._time: float | None = None  # of the last frame, if a column has it
        self._is_quiet = False  # whether no line comes, and the user was told
        self._was_ready = False
        self._is_open_hand_missed = False  # whether the user was told

    def run(self, source: LineSource) -> int:
        """Answer all lines of the input, and return the exit code.

        The exit code is 0 at the end of the input, 130 after Ctrl-C and 143 after SIGTERM. A second
        signal ends the program at once.

        Args:
            source: the lines of the input.

        Raises:
            UserError: the input holds no frame, or names other sensors than the model has.
        """
        self._began_at = source.came_at
        with self._ended_by_signals():
            try:
                while not (source.has_ended or self._ended_by):
                    self._step(source)
                    if self._waits_too_long():
                        self._miss_open_hand(source.number)
                    self._view.draw()
            finally:
                self._end(source)
        if not self._frames and not self._ended_by:
            lines = several(source.number, "line")
            raise UserError(
                f"the input has {lines} and no frame; expected a line of {self._reader.expected}"
            )
        if self._ended_by:
            return 128 + self._ended_by
        return 0

    def _waits_too_long(self) -> bool:
        """Return whether no open hand was seen for long, since the first frame came."""
        if self._was_ready or self._first_frame_at is None:
            return False
        return time.monotonic() - self._first_frame_at > MOST_WAITING

    @contextmanager
    def _ended_by_signals(self) -> Iterator[None]:
        """Let Ctrl-C and SIGTERM end the input, after the answer that is being computed.

        A second signal ends the program at once, since the first one waits if nobody reads the
        answers.
        """

        def end(number: int, _: FrameType | None) -> None:
            if self._ended_by:
                os._exit(128 + number)  # an exception would print the last answer, and wait again
            self._ended_by = number

        before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    def _step(self, source: LineSource) -> None:
        """Take the next line, or notice that none has come."""
        line = source.next(TICK)
        if line is None:
            is_quiet = time.monotonic() - source.came_at > MOST_QUIET and not source.has_ended
            if is_quiet and not self._is_quiet:
                self._is_quiet = True
                self._say(source.number, f"no line for {MOST_QUIET:.0f} s; still reading")
            return
        self._is_quiet = False
        try:
            frame = self._reader.frame(line)
            for note in self._reader.notes:
                self._say(source.number, note)
            self._reader.notes.clear()
            if frame is not None:
                self._push(frame, source)
        except LineError as error:
            self._refuse(source.number, str(error))
        except UserError as error:
            raise UserError(f"line {source.number}: {error}") from None

    def _push(self, frame: Frame, source: LineSource) -> None:
        """Push the frame of the last line, and show what it has changed.

        Raises:
            LineError: a reading is out of its range.
        """
        is_behind = self._skips and source.is_behind
        moment = frame.time
        if moment is None and self._is_paced:
            moment = source.came_at - self._began_at
        try:
            if self._falls(frame.time):
                self._stream.check(frame.counts)  # a wrong frame begins no new recording
                text = f"the time falls from {self._time:g} to {moment:g} s: a new recording begins"
                self._say(source.number, text)
                self._close(source.number)
            updates = self._stream.push(frame.counts, moment, answer=not is_behind)
        except UserError as error:
            raise LineError(str(error).removeprefix(f"frame {self._frames}: ")) from None
        self._time = frame.time
        self._frames += 1
        if self._first_frame_at is None:
            self._first_frame_at = time.monotonic()
        self._view.count_frame()
        for update in updates:
            self._show(update, source.number)

    def _falls(self, moment: float | None) -> bool:
        """Return whether the time of a frame shows that a logger has started again."""
        if moment is None or self._time is None:
            return False
        return moment < self._time - FALLS

    def _show(self, update: Update, line: int) -> None:
        """Show an update; say on standard error too why there is no answer."""
        if update.state != "waiting":
            self._was_ready = True
        self._view.show(update, line)
        if update.note and update.probabilities is None:
            self._say(line, update.note)

    def _refuse(self, line: int, fault: str) -> None:
        """Say what is wrong with a line that is no frame; of many lines, say it of a few."""
        self._refused += 1
        is_power_of_ten = str(self._refused).strip("0") == "1"
        if self._refused < MOST_REFUSED:
            self._say(line, f"no frame: {fault}")
        elif is_power_of_ten:
            count = several(self._refused, "line")
            self._say(line, f"no frame: {fault} ({count} so far, the next are counted)")

    def _miss_open_hand(self, line: int) -> None:
        """Say once that no open hand was seen."""
        if self._is_open_hand_missed or not self._frames:
            return
        self._is_open_hand_missed = True
        frames = several(self._frames, "frame")
        text = f"no open hand in {frames}, so no answer: open your hand and hold it still; "
        if self._stream.tare:
            text += "the first frames must read alike; if they do not in a still hand, "
            text += "is the glove or the unit a different one?"
        else:
            text += "if it is open, it does not read as in the training: try --tare"
        self._say(line, text)

    def _end(self, source: LineSource) -> None:
        """Show the last answer, and say how many frames there were and what was left out."""
        if source.has_ended and source.cut:
            self._refuse(source.number + 1, "the input ended in it, so it may be cut")
        self._close(source.number)
        if not self._was_ready:
            self._miss_open_hand(source.number)
        self._view.end()
        counts = [several(self._frames, "frame")]
        if self._refused:
            counts.append(f"{several(self._refused, 'line')} without a frame")
        if self._stream.skipped:
            counts.append(f"{several(self._stream.skipped, 'answer')} skipped to keep up")
        self._view.say(", ".join(counts))

    def _close(self, line: int) -> None:
        """Show the final answer of a grasp that is still open when the frames end."""
        for update in self._stream.close():
            self._show(update, line)
            if update.probabilities is not None:
                self._say(line, update.note)

    def _say(self, line: int, text: str) -> None:
        self._view.say(f"line {line}: {text}")
