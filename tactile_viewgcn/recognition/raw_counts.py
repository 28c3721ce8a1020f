"""Checks whether new recordings are like the training set in layout, scale and frame rate."""

from collections.abc import Sequence
from math import ceil

import numpy as np

from tactile_viewgcn.frames.training_readings import change_between_frames, strong_reading
from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.source import Recording
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.plan import Plan
from tactile_viewgcn.tables.recordings import Recordings

# factor by which readings can be weaker or stronger than in every training recording
SCALE_TIMES = 4.0
# factor by which the frames of an untouched hand can differ less than in every training recording
STILL_TIMES = 16.0
RATE_TIMES = 1.1  # factor by which frame rates can be lower or higher
# (H, W) of a frame; names of the sensors, row after row, empty if they have none
Layout = tuple[tuple[int, ...], list[str]]


def check_layout(where: str, layout: Layout, trained: Layout) -> None:
    """Raise a UserError if sensors have other names, or frames another shape, than in training.

    Args:
        where: the beginning of the message.
        layout: of a recording.
        trained: layout of the training set.
    """
    shape, names = layout
    trained_shape, trained_names = trained
    for number, (name, expected) in enumerate(zip(names, trained_names, strict=False), 1):
        if name != expected:
            raise UserError(
                f"{where}: sensor {number} is {name}; "
                f"expected {expected} of {listed(trained_names)}"
            )
    if shape != trained_shape:
        remedy = ""
        if shape[0] == 1:
            remedy = ", and one recording in a list: [X]"
        raise UserError(
            f"{where}: frames of {_by(shape)}; expected {_by(trained_shape)}, "
            f"as in the training{remedy}"
        )


def _by(shape: tuple[int, ...]) -> str:
    """Return the shape of a frame as a text, such as `8 x 10`."""
    return " x ".join(map(str, shape))


def check_layouts(recordings: Sequence[Recording], trained: Layout | None = None) -> None:
    """Raise a UserError for the first recording that has another layout than in training.

    Args:
        recordings: one or more recordings that `recording_of` returned.
        trained: layout of the training set; None compares with the first recording.
    """
    for recording in recordings:
        layout = (recording.values["pressure"].shape[1:], recording.channel_names)
        trained = trained or layout
        check_layout(recording.names["recording"], layout, trained)


def fault_of(plan: Plan, counts: np.ndarray, contact: np.ndarray, excess: np.ndarray) -> str:
    """Return what is wrong with the counts of a recording, or "" if nothing is.

    Wrong is a number that the training set's integer type cannot hold, or a scale that differs from
    the training set's scale. Whether counts are finite is checked elsewhere, where they come in:
    see `recording_of` and `CountsFile`.

    Args:
        plan: of the training set.
        counts: (n, H, W) of all frames.
        contact: bool (n,) frames of contact with an object, whose scale is checked. If there are
            none, the scale of all frames is checked.
        excess: (k, H, W) counts above baseline of the frames in contact.
    """
    dtype = np.dtype(plan.dtype)
    if dtype.kind == "i" and counts.dtype != dtype:
        limits = np.iinfo(dtype)
        is_whole = counts % 1 == 0
        unfit = counts[~is_whole | (counts < limits.min) | (counts > limits.max)]
        if unfit.size:
            return (
                f"holds {unfit[0]:g}; expected whole numbers from {limits.min} to {limits.max}, "
                "raw counts as in training"
            )
    if not contact.any():
        return _fault_without_contact(plan, counts)
    above, raw = plan.strong_readings
    return _fault_of_scale(plan, excess, above, "off its baseline") or _fault_of_scale(
        plan, counts[contact], raw, "as recorded"
    )


def _fault_without_contact(plan: Plan, counts: np.ndarray) -> str:
    """Return what is wrong with counts (n, H, W) in which no contact was found, or "".

    Contact is also missed if the counts are in a smaller unit than in training.
    """
    weakest = weakest_baseline(plan)
    raw = strong_reading(counts[:, plan.live])
    if raw < weakest / SCALE_TIMES:
        return (
            f"one in a hundred readings is {raw:.3g} or more; expected {weakest:.3g} or more, as "
            "an open hand read in the training: is the glove or the unit a different one?"
        )
    return ""


def _fault_of_scale(plan: Plan, readings: np.ndarray, bounds: list[float], origin: str) -> str:
    """Return what is wrong with the scale of readings (k, H, W) in contact, or ""."""
    weakest, strongest = bounds
    reading = strong_reading(readings[:, plan.live])
    if weakest / SCALE_TIMES <= reading <= strongest * SCALE_TIMES:
        return ""
    return (
        f"one in a hundred readings in contact is {reading:.3g} or more {origin}; expected "
        f"{weakest:.3g} to {strongest:.3g}, as in the training: "
        "is the glove or the unit a different one?"
    )


def weakest_baseline(plan: Plan) -> float:
    """Return the smallest `strong_reading` of the training set's baselines, in counts."""
    return min(strong_reading(mean[plan.live]) for mean in plan.baselines)


def is_weak(plan: Plan, excess: np.ndarray) -> bool:
    """Return whether a recording reads less than a quarter of the weakest training recording.

    Args:
        plan: of the training set.
        excess: (k, H, W) counts above baseline of the recording's frames in contact.
    """
    (weakest, _), _ = plan.strong_readings
    return strong_reading(excess[:, plan.live]) < weakest / SCALE_TIMES


def is_untouched(plan: Plan, counts: np.ndarray, contact: np.ndarray, excess: np.ndarray) -> bool:
    """Return whether a recording reads as little as a hand that touches nothing.

    Such a recording is too weak for every object of the training set. Noise can make a few of its
    frames look like contact. If the training set took every frame, all of them count as contact.

    A glove with a smaller unit reads little too, but then its baseline and its noise are also
    smaller. Hence a recording does not count as untouched in three cases; `fault_of` then says what
    is wrong:

    - it reads less than a quarter of the training set's smallest baseline;
    - it reads more than four times the training set's strongest reading;
    - its frames differ by less than a sixteenth of the differences in every training recording.

    Args:
        plan: of the training set.
        counts: (n, H, W) of all frames.
        contact: bool (n,) frames that count as contact, at least one.
        excess: (k, H, W) counts above baseline of these frames.
    """
    if not is_weak(plan, excess):
        return False
    _, (_, strongest_raw) = plan.strong_readings
    raw = strong_reading(counts[contact][:, plan.live])
    if not weakest_baseline(plan) / SCALE_TIMES <= raw <= strongest_raw * SCALE_TIMES:
        return False
    change = change_between_frames(counts, plan.live)
    return change == 0 or change >= plan.least_change / STILL_TIMES


def untouched_note(plan: Plan, names: list[str], total: int, *, is_class: bool) -> Note:
    """Return a note on the recordings that `is_untouched` found.

    Args:
        plan: of the training set.
        names: of these recordings.
        total: number of all recordings.
        is_class: whether the empty hand is a class. If it is not, the note is a warning.
    """
    weakest, _ = plan.strong_readings[0]
    text = (
        f"{len(names)} of {several(total, 'recording')} read less than a quarter of the training's "
        f"weakest ({weakest:.3g} off the baseline), as a hand that touches nothing: "
        f"{listed(names)}. If the hand holds something, the glove or the unit is a different one."
    )
    if is_class:
        return Note(text, "info", "contact")
    return Note(text, "warning", "contact")


def no_contact_note(names: list[str], total: int) -> Note:
    """Return a note on recordings in which no frame is in contact.

    Args:
        names: of these recordings.
        total: number of all recordings.
    """
    text = (
        f"no frame is in contact in {len(names)} of {several(total, 'recording')}: "
        f"{listed(names)}. An object that presses too little, or that is held from the first frame "
        "to the last, can be taken for an open hand. Begin each recording with an open hand."
    )
    return Note(text, "info", "contact")


def short_note(names: list[str], total: int, limit: float) -> Note:
    """Return a note on recordings that are too short for calibrated probabilities.

    Args:
        names: of these recordings.
        total: number of all recordings.
        limit: number of frames in contact below which a recording is too short.
    """
    text = (
        f"{len(names)} of {several(total, 'recording')} have fewer than {ceil(limit)} frames in "
        f"contact, half of what training recordings have: {listed(names)}. Their probabilities "
        "are not calibrated."
    )
    return Note(text, "info", "contact")


def rate_notes(plan: Plan, recordings: Recordings) -> list[Note]:
    """Return a warning if recordings are over a tenth slower or faster than in training."""
    rates = frame_rates(recordings.columns["time"], recordings.columns["recording"])
    lowest, highest = plan.rates
    low = lowest / RATE_TIMES
    high = highest * RATE_TIMES
    unlike = [
        f"{recordings.recordings[number]} {rate:.3g} Hz"
        for number, rate in rates.items()
        if not low <= rate <= high
    ]
    if not unlike:
        return []
    text = (
        f"{len(unlike)} of {several(len(rates), 'recording')}: {listed(unlike)}; "
        f"expected {low:.3g} to {high:.3g} Hz, as in the training: resample them or record again"
    )
    return [Note(text, "warning", "frame rate")]
