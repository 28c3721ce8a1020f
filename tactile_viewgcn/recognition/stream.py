"""Answers to frames as they come, one for each contact."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import trimmed_moments
from tactile_viewgcn.frames.open_hand import Follower, is_contact
from tactile_viewgcn.readers.source import UNLABELLED
from tactile_viewgcn.recognition.answer import UNKNOWN, Answer, answer_contact
from tactile_viewgcn.recognition.frame_lines import read_frame
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.recognition.unlabelled import Row

OPEN_FRAMES = 20  # at the start, of the open hand
GAP_FRAMES = 3  # without contact, after which it has ended
SPACING = 4  # frames in contact from one that is classified early to the next: neighbours are nearly the same
MOST_KEPT = 1024  # frames of one contact; a longer one keeps every second, fourth, ...


class Contact:
    """The frames of one contact, above baseline, thinned out evenly where there are too many."""

    def __init__(self, start: float):
        self.start, self.count, self.answered = start, 0, False
        self.frames: list[np.ndarray] = []
        self._every = 1

    def add(self, excess: np.ndarray) -> None:
        """Take the next frame (H, W)."""
        if self.count % self._every == 0:
            self.frames.append(excess)
        self.count += 1
        if len(self.frames) > MOST_KEPT:
            self.frames, self._every = self.frames[::2], 2 * self._every

    def stack(self) -> np.ndarray:
        """The frames kept (n, H, W)."""
        return np.stack(self.frames)


class Stream:
    """Answers to frames of one hand, one for each contact.

    The first `OPEN_FRAMES` frames are the open hand, and give the baseline, which follows the open hand from then on.
    Where the training took every frame, all frames are one contact, above the training's baseline. A contact of another
    scale than the training's is unlike anything seen.

    Args:
        stop_at: answer as soon as a class has this calibrated probability, or after V frames; None: when contact ends.

    Attributes:
        frames: number of frames so far.
        note: a sentence on the baseline, once it is known.
    """

    def __init__(self, recogniser: Recogniser, *, stop_at: float | None = None):
        if stop_at is not None:
            recogniser.check_sequential(stop_at, "stop_at")
        self.frames, self.note = 0, ""
        self._recogniser, self._stop_at, self._fitted = recogniser, stop_at, recogniser.preprocessing
        self._known = self._fitted.mean_baseline()[self._fitted.live]
        self._opening: list[np.ndarray] = []
        self._follower: Follower | None = None
        self._contact: Contact | None = None
        self._number = self._gap = 0

    def observe(self, counts: np.ndarray, seconds: float = float("nan")) -> Row | None:
        """Take the next frame (H, W) of raw counts, at its time; the answer if it brings one."""
        self.frames += 1
        pressed = self._fitted.takes_all or self._is_pressed(counts[self._fitted.live])
        if pressed:
            self._contact = self._contact or Contact(seconds)
            self._contact.add(self._above(counts))
            self._gap = 0
            return self._early(self._contact, seconds)
        self._gap += 1
        return self.finish(seconds) if self._gap == GAP_FRAMES else None

    def finish(self, seconds: float = float("nan")) -> Row | None:
        """The answer to the contact that has ended; None if there is none, or it has been given."""
        contact, self._contact = self._contact, None
        if contact is None or contact.answered:
            return None
        answer = answer_contact(self._recogniser, contact.stack(), stop_at=self._stop_at)
        return self._row(contact, answer, seconds)

    def _is_pressed(self, readings: np.ndarray) -> bool:
        """Whether the live sensors (S,) of the next frame are in contact; the first frames become the baseline."""
        if self._follower is None:
            self._opening.append(readings)
            if len(self._opening) == OPEN_FRAMES:
                self._follower = self._start()
            return False
        return self._follower.observe(readings)[0] >= self._fitted.params.contact_sensors

    def _start(self) -> Follower:
        """The baseline of the open hand that the frames begin with; the training's if they are contact."""
        fitted, live = self._fitted, self._fitted.live
        mean, noise = trimmed_moments(np.stack(self._opening))
        measured = fitted.noise[live]
        threshold = fitted.params.contact_sigmas * np.where(np.isfinite(measured), measured, noise)
        self.note = f"ready: the first {OPEN_FRAMES} frames are the baseline"
        if fitted.params.baseline != "none" and is_contact(mean - self._known, threshold):
            self.note = f"the first {OPEN_FRAMES} frames are contact: the training's baseline; begin with the open hand"
            mean = self._known
        return Follower(mean.astype(np.float64), threshold)

    def _above(self, counts: np.ndarray) -> np.ndarray:
        """The frame (H, W) above baseline."""
        params, live = self._fitted.params, self._fitted.live
        if params.baseline == "none":
            return counts - params.zero
        excess = np.zeros(counts.shape)
        excess[live] = counts[live] - (self._follower.baseline if self._follower else self._known)
        return excess

    def _early(self, contact: Contact, seconds: float) -> Row | None:
        """The answer in the middle of a contact, if it is confident or V frames are taken."""
        views, place = self._recogniser.classifier.views, contact.count - 1
        if self._stop_at is None or contact.answered or place % SPACING or place // SPACING >= views:
            return None
        frames = contact.stack()[::SPACING]
        answer = answer_contact(self._recogniser, frames)
        if answer.probabilities.max() < self._stop_at and len(frames) < views:
            return None
        return self._row(contact, replace(answer, contact=contact.count), seconds)

    def _row(self, contact: Contact, answer: Answer, seconds: float) -> Row:
        contact.answered = True
        self._number += 1
        try:
            self._fitted.check_strength(contact.stack(), f"contact {self._number}")
        except UserError:  # the frames that follow may be better
            answer = replace(answer, status=UNKNOWN)
        return Row(f"contact {self._number}", UNLABELLED, contact.start, seconds, self.frames, answer)


def follow(stream: Stream, recogniser: Recogniser, lines: Iterable[str]) -> Iterator[Row | str]:
    """The answers to frames as text, each with its latency from the last line to the answer; an interrupt ends them.

    The stream's note comes before them, as soon as there is one.
    """
    told = ""
    try:
        for number, text in enumerate(lines, start=1):
            begin = time.perf_counter()
            row = stream.observe(*read_frame(text, number, recogniser.preprocessing))
            if stream.note != told:
                told = stream.note
                yield told
            if row is not None:
                yield replace(row, latency_ms=1000 * (time.perf_counter() - begin))
    except KeyboardInterrupt:
        pass
    begin = time.perf_counter()
    row = stream.finish()
    if row is not None:
        yield replace(row, latency_ms=1000 * (time.perf_counter() - begin))
