"""Raw counts of new recordings: are they like the training's, what is their baseline, which frames are in contact?"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_viewgcn.frames.baseline import (
    Baseline,
    measure_baseline,
    session_moments,
    sessions_with_empty_hand,
)
from tactile_viewgcn.frames.filter import flagged, pressed_frames
from tactile_viewgcn.frames.open_hand import hand_states
from tactile_viewgcn.messages import Note, UserError, listed, several
from tactile_viewgcn.readers.source import Recording
from tactile_viewgcn.recognition.model_file import (
    FittedPreprocessing,
    change_between_frames,
    strong_reading,
)
from tactile_viewgcn.tables.frames import frame_rates
from tactile_viewgcn.tables.recordings import NO_SESSION, Recordings

# factor by which readings may be weaker or stronger than all recordings of the training
MOST_TIMES = 4.0
# factor by which the frames of an untouched hand may differ less than the training's
STILL_TIMES = MOST_TIMES**2
RATE_TIMES = 1.1  # factor by which frame rates may be lower or higher
# (H, W) of a frame, and names of the sensors, row after row, or none
Layout = tuple[tuple[int, ...], list[str]]
# share of the training's frames that the filter kept, from which recordings count as all contact
ALL_KEPT = 0.99


def check_layout(where: str, layout: Layout, trained: Layout) -> None:
    """Raise a UserError, which begins with `where`, for sensors of other names, or frames of a different shape."""
    for at, (name, expected) in enumerate(zip(layout[1], trained[1], strict=False), 1):
        if name != expected:
            raise UserError(
                f"{where}: sensor {at} is {name}; expected {expected} of {listed(trained[1])}"
            )
    if layout[0] != trained[0]:
        shape, expected = (" x ".join(map(str, each)) for each, _ in (layout, trained))
        alone = ", and one recording in a list: [X]" if layout[0][0] == 1 else ""
        raise UserError(
            f"{where}: frames of {shape}; expected {expected}, as in the training{alone}"
        )


def check_layouts(recordings: Sequence[Recording], trained: Layout | None = None) -> None:
    """`check_layout` of recordings of `recording_of`, against the training's, or without it the first one's."""
    layouts = [(each.values["pressure"].shape[1:], each.channel_names) for each in recordings]
    for recording, layout in zip(recordings, layouts, strict=True):
        check_layout(recording.names["recording"], layout, trained or layouts[0])


def fault_of(
    fitted: FittedPreprocessing, counts: np.ndarray, contact: np.ndarray, excess: np.ndarray
) -> str:
    """What is wrong with a recording, "" if nothing: counts that the training's integer type cannot hold, or a scale.

    Whether counts are finite is checked where they come in, see `recording_of` and `check_column`.

    Args:
        counts: (n, H, W) of all its frames.
        contact: bool (n,) frames of contact with an object, whose scale is checked; without any,
            that of all frames is.
        excess: (k, H, W) their counts above baseline.
    """
    dtype = np.dtype(fitted.dtype)
    if dtype.kind == "i" and counts.dtype != dtype:
        least, most = np.iinfo(dtype).min, np.iinfo(dtype).max
        unfit = counts[(counts % 1 != 0) | (counts < least) | (counts > most)]
        if unfit.size:
            return f"holds {unfit[0]:g}; expected whole numbers from {least} to {most}, raw counts as in training"
    weakest_raw = weakest_baseline(fitted)
    raw = strong_reading(counts[:, fitted.live])
    # no contact is found in a smaller unit
    if not contact.any() and raw < weakest_raw / MOST_TIMES:
        return (
            f"one in a hundred readings is {raw:.3g} or more; expected {weakest_raw:.3g} or more, as an open hand read "
            "in the training: is the glove or the unit a different one?"
        )
    scales = zip(
        ("off its baseline", "as recorded"),
        (excess, counts[contact]),
        fitted.strong_readings,
        strict=True,
    )
    for origin, readings, (weakest, strongest) in scales if contact.any() else ():
        reading = strong_reading(readings[:, fitted.live])
        if not weakest / MOST_TIMES <= reading <= strongest * MOST_TIMES:
            return (
                f"one in a hundred readings in contact is {reading:.3g} or more {origin}; expected {weakest:.3g} to "
                f"{strongest:.3g}, as in the training: is the glove or the unit a different one?"
            )
    return ""


def weakest_baseline(fitted: FittedPreprocessing) -> float:
    """The strong reading of the weakest baseline of the training's sessions."""
    return min(strong_reading(mean[fitted.live]) for mean in fitted.baselines.values())


def is_untouched(
    fitted: FittedPreprocessing, counts: np.ndarray, contact: np.ndarray, excess: np.ndarray
) -> bool:
    """Whether a recording reads as little as a hand that touches nothing: too weak for every object of the training.

    A few of its frames may pass for contact by their noise, or all of them where the training took
    every frame.

    A glove in a smaller unit reads less, too. Then its baseline and its noise are smaller as well.
    So a recording is not taken for untouched if it reads less than a quarter of the smallest
    baseline of the training, or if its frames differ by less than a sixteenth of what those of
    every training recording do. `fault_of` then says what is wrong.

    Args:
        counts: (n, H, W) of all its frames.
        contact: bool (n,) frames that pass for contact, at least one.
        excess: (k, H, W) their counts above baseline.
    """
    live = fitted.live
    (weakest, _), (_, strongest_raw) = fitted.strong_readings
    raw = strong_reading(counts[contact][:, live])
    is_weak = strong_reading(excess[:, live]) < weakest / MOST_TIMES
    is_in_range = weakest_baseline(fitted) / MOST_TIMES <= raw <= strongest_raw * MOST_TIMES
    if not (is_weak and is_in_range):
        return False
    change = change_between_frames(counts, live)
    return change == 0 or change >= fitted.least_change / STILL_TIMES


def untouched_note(
    fitted: FittedPreprocessing, names: list[str], total: int, *, is_class: bool
) -> Note:
    """A note on the recordings that `is_untouched` found among `total`; a warning unless the empty hand is a class."""
    text = (
        f"{len(names)} of {several(total, 'recording')} read less than a quarter of the training's weakest "
        f"({fitted.strong_readings[0][0]:.3g} off the baseline), as a hand that touches nothing: {listed(names)}. "
        "If the hand holds something, the glove or the unit is a different one."
    )
    return Note(text, "info" if is_class else "warning", "contact")


def rate_notes(fitted: FittedPreprocessing, recordings: Recordings) -> list[Note]:
    """A warning of recordings that are slower or faster than the training's by more than a tenth."""
    rates, (lowest, highest) = (
        frame_rates(recordings.columns["time"], recordings.columns["recording"]),
        fitted.rates,
    )
    low, high = lowest / RATE_TIMES, highest * RATE_TIMES
    unlike = [
        f"{recordings.recordings[at]} {rate:.3g} Hz"
        for at, rate in rates.items()
        if not low <= rate <= high
    ]
    text = f"{len(unlike)} of {several(len(rates), 'recording')}: {listed(unlike)}; expected {low:.3g} to {high:.3g} Hz, "
    return (
        [Note(f"{text}near the training's: resample or record anew", "warning", "frame rate")]
        if unlike
        else []
    )


def find_contact(
    fitted: FittedPreprocessing, recordings: Recordings
) -> tuple[Baseline, np.ndarray]:
    """The baseline of new recordings, and whether each frame is in contact, bool (T,).

    A recording's baseline is its session's empty hand if that is among the recordings; else it
    depends on the recording alone, whatever others are asked beside it. Without an open hand it has
    its session's baseline of the training, or the mean of all sessions if its own has no name, or
    one that the training does not know. Every frame is in contact where the training could not find
    contact.

    Names of objects are not used, but for the empty hand's.
    """
    params, recordings = fitted.params, _apart(recordings)
    sensors = int(params.contact_sensors)
    trained, states = None, None
    if params.baseline != "none":
        average = fitted.mean_baseline()
        known = {name: mean for name, mean in fitted.baselines.items() if name != NO_SESSION}
        trained = [(known.get(name, average), fitted.noise) for name in recordings.sessions]
    moments = session_moments(recordings, trained)
    if params.baseline != "none":
        states = hand_states(recordings, sensors, moments)
    baseline = measure_baseline(recordings, params, moments, states)
    if params.filter == "flags" and {"valid", "grasp_valid"} & recordings.columns.keys():
        return baseline, flagged(recordings)
    if params.filter == "none" or (params.baseline == "none" and fitted.kept_share >= ALL_KEPT):
        return baseline, np.ones(len(recordings), dtype=bool)
    if np.isfinite(baseline.noise).all():
        return baseline, pressed_frames(recordings, baseline, sensors)
    return baseline, hand_states(recordings, sensors, moments).contact


def _apart(recordings: Recordings) -> Recordings:
    """The table in which a session without an empty hand becomes a session for each of its recordings."""
    session, recording = recordings.columns["session"], recordings.columns["recording"]
    together = sessions_with_empty_hand(recordings)[session]
    pairs = np.stack([session, np.where(together, -1, recording)])
    used, number = np.unique(pairs, axis=1, return_inverse=True)
    columns = recordings.columns | {"session": number.ravel()}
    return replace(
        recordings, columns=columns, sessions=[recordings.sessions[each] for each in used[0]]
    )
