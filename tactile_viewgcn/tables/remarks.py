"""Warnings of what spoils any result of a table of raw counts, for `ingest`, `inspect` and `fit`."""

import re
import unicodedata
import warnings
from collections.abc import Iterator

import numpy as np
import pandas as pd

from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.tables.look import Look
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

EXAMPLES = 3  # long places in a warning
CHANCE = 1e-3  # expected number of recordings that would look so by chance
# share of a recording's frames that differ from the one before, where sensors have noise
MOSTLY_MOVES = 0.5
FEWEST_EQUAL = 3  # equal frames at the beginning or the end that count
PADDED = 0.1  # share of a recording's frames, from which on they count
RARELY, MUCH = 0.02, 0.25  # of so few recordings only ends count that are longer than this share
# share of frames that equal the one before, inside recordings of sensors with noise
MOST_REPEATS = 0.05
FEWEST_REPEATS = 0.01  # the same, of which chance is computed at least
# share of the sensors: more that stand still in some recordings are untouched, not faulty
MOST_STUCK = 0.1
LIVELY = 0.9  # share of the recordings in which a sensor moves, in which it moves all the time
TELLS = 1e-3  # probability of Kruskal and Wallis, below which numbers differ between objects
# factor between recordings of two units, and an empty gap of that factor between them
OTHER_UNIT = 4.0


def remarks(recordings: Recordings, look: Look) -> list[Note]:
    """The reader's notes, and warnings of what spoils a result.

    Args:
        look: of the same recordings, see `look_at`.
    """
    found = [
        *_copies(recordings, look),
        *_shared_frames(recordings, look),
        *_standing_still(recordings, look),
        *_stuck_sensors(recordings, look),
        *_equal_ends(recordings, look),
        *_units(recordings, look),
        *_spellings(recordings),
        *_times(recordings),
    ]
    return [
        *recordings.notes,
        *without_frames(recordings),
        *(Note(text, "warning", topic) for topic, text in found),
    ]


def without_frames(recordings: Recordings) -> list[Note]:
    """A warning that names recordings without frames, and objects of which there is no frame."""
    recorded = set(recordings.columns["recording"])
    with_frames = set(recordings.columns["object"])
    names = [name for number, name in enumerate(recordings.recordings) if number not in recorded]
    objects = [name for number, name in enumerate(recordings.objects) if number not in with_frames]
    text = ""
    if names:
        text += f"{several(len(names), 'recording')} without frames: {listed(names)}. "
    if objects:
        text += f"No frame of the objects {listed(objects)}. "
    if not text:
        return []
    return [Note(f"{text}Record them again, or remove them.", "warning", "no frames")]


def _examples(places: list[str]) -> str:
    """The first three places, which are long texts, and the number of the others."""
    more = [f"and {len(places) - EXAMPLES} more"] if len(places) > EXAMPLES else []
    return ", ".join([*places[:EXAMPLES], *more])


def _copies(recordings: Recordings, look: Look) -> Iterator[tuple[str, str]]:
    names = recordings.recordings
    copies = look.each[look.each["original"] != look.each.index]
    pairs = [f"{names[copy]} repeats {names[first]}" for copy, first in copies["original"].items()]
    if pairs:
        text = f"{several(len(pairs), 'recording')} with the counts of a different one: {listed(pairs)}. "
        text += "A copy tests nothing, and as a different object it is wrong: remove it, or record it again."
        yield "copies", text


def _shared_frames(recordings: Recordings, look: Look) -> Iterator[tuple[str, str]]:
    """A warning of recordings that have frames in common with an earlier one, and are no copy of it.

    Recordings that the source holds together already, as overlapping windows, are none.
    """
    names = recordings.recordings
    each = look.each
    takes = pd.Series(each.index, index=each.index)
    if "take" in recordings.columns:
        takes = (
            pd.Series(recordings.columns["take"]).groupby(recordings.columns["recording"]).first()
        )
    of_partner = each.loc[each["partner"]]
    is_together = takes.loc[each.index].to_numpy() == takes.loc[each["partner"]].to_numpy()
    is_other_object = each["object"].to_numpy() != of_partner["object"].to_numpy()
    is_piece = (each["shared"] > 0) & (each["original"] == each.index)
    pieces = each[is_piece & (is_other_object | ~is_together)]
    if pieces.empty:
        return
    places = [
        f"{names[number]} ({row.shared} of {several(row.frames, 'frame')}, as {names[row.partner]})"
        for number, row in pieces.iterrows()
    ]
    text = (
        f"{several(len(pieces), 'recording')} with frames of a different one: {_examples(places)}. "
    )
    text += (
        "They are overlapping pieces or copies of one recording, and tell nothing of a new one. "
    )
    mixed = pieces[is_other_object[each.index.get_indexer(pieces.index)]]
    if len(mixed):
        text += f"{several(len(mixed), 'pair')} of different objects: are their labels right? "
    text += "Those of an object are held out together here; where you deal them yourself, give their `groups`."
    yield "shared frames", text


def _standing_still(recordings: Recordings, look: Look) -> Iterator[tuple[str, str]]:
    """A warning of recordings in which nothing changes, where others change nearly all the time."""
    each = look.each[look.each["frames"] > 1]
    moving = each[each["moves"] > 0]
    still = each[each["moves"] == 0]
    if still.empty or len(moving) < len(still):
        return
    usual = float((moving["moves"] / (moving["frames"] - 1)).median())
    expected = len(each) * (1 - usual) ** (still["frames"] - 1)
    still = still[expected < CHANCE]
    if usual < MOSTLY_MOVES or still.empty:
        return
    names = [recordings.recordings[number] for number in still.index]
    text = f"No sensor changes in {several(len(names), 'recording')}: {listed(names)}. "
    yield "standing still", f"{text}Did the glove freeze? Record them again, or remove them."


def _stuck_sensors(recordings: Recordings, look: Look) -> Iterator[tuple[str, str]]:
    """A warning of sensors that never change in some recordings, and always do in most.

    Where many sensors are so, untouched sensors read a constant: nothing is wrong.
    """
    long_enough = look.lively.any(axis=1)
    stuck, lively = look.stuck[long_enough], look.lively[long_enough]
    objects = look.each["object"].to_numpy()[long_enough]
    numbers = look.each.index.to_numpy()[long_enough]
    moving = ~stuck
    is_lively = lively.sum(axis=0) >= LIVELY * moving.sum(axis=0)
    is_odd = stuck.any(axis=0) & is_lively & (moving.sum(axis=0) > stuck.sum(axis=0))
    sensors = np.flatnonzero(is_odd)
    some = np.flatnonzero(stuck.any(axis=0))
    if not len(sensors) or len(some) > max(1, MOST_STUCK * stuck.shape[1]):
        return
    names = recordings.sensor_names(recordings.live)
    places = []
    for sensor in sensors:
        rows = np.flatnonzero(stuck[:, sensor])
        place = f"{names[sensor]} in {listed([recordings.recordings[number] for number in numbers[rows]])}"
        touched = np.unique(objects[rows])
        if len(touched) == 1 and len(rows) == np.sum(objects == touched[0]) > 1:
            place = f"{names[sensor]} in all of {recordings.objects[touched[0]]}"
        places.append(place)
    text = f"{several(len(places), 'sensor')} that never change in some recordings, and always in others: "
    if len(places) == 1:
        text = "A sensor never changes in some recordings, and always in others: "
    text += (
        f"{listed(places, '; ')}. Is its cable loose? If nothing touches it there, this is right."
    )
    yield "standing still", text


def _equal_ends(recordings: Recordings, look: Look) -> Iterator[tuple[str, str]]:
    """A warning of recordings that begin or end with equal frames, where frames are hardly ever repeated inside.

    Sensors without noise read the same while the hand rests: that is none. Readings far from all
        others are padding.
    """
    each = look.each[look.each["moves"] > 0]
    if each.empty:
        return
    equal = each["head"] + each["tail"] - 2
    steps = float((each["frames"] - 1 - equal).sum())
    repeats = (steps - float(each["moves"].sum())) / max(steps, 1.0)
    longest = each[["head", "tail"]].max(axis=1)
    is_long = (longest >= FEWEST_EQUAL) & (longest >= PADDED * each["frames"])
    by_chance = len(each) * max(repeats, FEWEST_REPEATS) ** (longest - 1)
    stops = (repeats <= MOST_REPEATS) & (by_chance < CHANCE) & (each["end"] != "rest")
    is_padded = is_long & (stops | (each["end"] == "outside"))
    if is_padded.mean() < RARELY:
        is_padded &= longest >= MUCH * each["frames"]
    ends = each[is_padded]
    if ends.empty:
        return
    places = []
    for number, row in ends.iterrows():
        place = "the first"
        count = row["head"]
        if row["tail"] >= row["head"]:
            place = "the last"
            count = row["tail"]
        places.append(f"{recordings.recordings[number]} ({place} {count} of {row['frames']})")
    text = f"Equal frames at an end of {several(len(places), 'recording')}: {_examples(places)}. "
    text += "Is that padding, or did the glove freeze? "
    if _differ_by_object(equal.where(is_padded, 0).to_numpy(), each["object"].to_numpy()):
        text += "Their number differs between the objects, and a classifier may learn that. "
    text += "Then cut these frames off: recordings may be of unlike length. If the hand rests there, this is right."
    yield "equal ends", text


def _differ_by_object(numbers: np.ndarray, objects: np.ndarray) -> bool:
    """Whether numbers (R,) of recordings differ between their objects (R,), by the test of Kruskal and Wallis."""
    from scipy.stats import kruskal

    if len(np.unique(numbers)) < 2 or len(np.unique(objects)) < 2:
        return False
    samples = [numbers[objects == label] for label in np.unique(objects)]
    return bool(kruskal(*samples).pvalue < TELLS)


def _units(recordings: Recordings, look: Look) -> Iterator[tuple[str, str]]:
    """A warning of recordings whose readings and whose smallest changes are both weaker or stronger by a factor.

    A light grip reads less, but its noise is that of a firm one: in another unit the noise is
    different too. Between the recordings of two units there is a gap.
    """
    strength = _relative(look.strength)
    step = _relative(look.step)
    known = np.flatnonzero(np.isfinite(strength) & np.isfinite(step))
    if len(known) < 2:
        return
    order = known[np.argsort(strength[known])]
    cluster = np.cumsum(np.diff(strength[order], prepend=strength[order[0]]) >= np.log(OTHER_UNIT))
    usual = order[cluster == np.bincount(cluster).argmax()]
    strength -= np.median(strength[usual])
    step -= np.median(step[usual])
    others = np.setdiff1d(order, usual)
    is_scaled = (strength[others] * step[others] > 0) & (
        np.abs(step[others]) >= np.abs(strength[others]) / 2
    )
    others = others[is_scaled]
    if not len(others):
        return
    numbers = look.each.index.to_numpy()
    for word, sign in (("weaker", -1), ("stronger", 1)):
        rows = others[np.sign(strength[others]) == sign]
        if not len(rows):
            continue
        factor = float(np.exp(np.median(np.abs(strength[rows]))))
        names = [recordings.recordings[number] for number in numbers[np.sort(rows)]]
        text = (
            f"{several(len(names), 'recording')} about {factor:.3g} times {word} than the others, "
        )
        text += (
            f"noise included: {listed(names)}. Another unit or gain? Convert them, or remove them."
        )
        yield "unit", text


def _relative(values: np.ndarray) -> np.ndarray:
    """The logarithm (R,) of how much larger a recording's values (R, K) are than usual: the median over sensors.

    NaN where no sensor has a value above 0.
    """
    with np.errstate(divide="ignore"), warnings.catch_warnings():
        # of sensors, or recordings, without a value
        warnings.simplefilter("ignore", RuntimeWarning)
        logarithms = np.log(np.where(values > 0, values, np.nan).astype(np.float64))
        usual = np.nanquantile(logarithms, 0.5, axis=0, method="lower")
        return np.asarray(np.nanmedian(logarithms - usual, axis=1))


def _spellings(recordings: Recordings) -> Iterator[tuple[str, str]]:
    """A warning of objects whose names differ in capitals, blanks, hyphens or underscores alone."""
    labels = [recordings.columns["object"][index[0]] for index in frames_by_recording(recordings)]
    counts, alike = np.bincount(labels, minlength=len(recordings.objects)), dict[str, list[str]]()
    for name, count in zip(recordings.objects, counts.tolist(), strict=True):
        key = re.sub(r"(?<=\w)[\s_-]+", "", unicodedata.normalize("NFKC", name)).casefold()
        alike.setdefault(key, []).append(f"{name!r} ({several(count, 'recording')})")
    if names := [" and ".join(spelt) for spelt in alike.values() if len(spelt) > 1]:
        yield (
            "spelling",
            f"Objects whose names differ in spelling alone: {listed(names)}. If one is meant, rename it.",
        )


def _times(recordings: Recordings) -> Iterator[tuple[str, str]]:
    """A warning of times that do not rise from frame to frame."""
    order = np.concatenate(frames_by_recording(recordings))
    number, time = (recordings.columns[name][order] for name in ("recording", "time"))
    steps, within = np.diff(time), number[1:] == number[:-1]
    if (bad := within & (steps <= 0)).any():
        places = f"{several(int(bad.sum()), 'place')}, first in {recordings.recordings[number[bad.argmax()]]}"
        yield (
            "time",
            f"Times repeat or fall at {places}. Look at the clock of the program that records.",
        )
