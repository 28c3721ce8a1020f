"""Warn of recordings that spoil a result, for `ingest`, `inspect` and `fit`."""

import re
import unicodedata
import warnings
from collections.abc import Iterator, Sequence
from itertools import compress

import numpy as np
import pandas as pd

from tactile_viewgcn.messages import EMPTY_HAND, Note, listed, several
from tactile_viewgcn.tables.look import Look, takes_of_source
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

EMPTY_HANDS = ("empty", "emptyhand")  # other names of the empty hand, without blanks
MOST_PLACES = 3  # recordings with a long text that one warning lists
# a warning needs fewer recordings, or sensors, than this that look so by chance
MOST_EXPECTED = 1e-3
# if sensors have noise, at least this share of a recording's frames differ from the frame before
NOISY_MOVES = 0.5
FEWEST_EQUAL = 3  # fewest equal frames at the beginning or the end that count
FEWEST_EQUAL_SHARE = 0.1  # the same as a share of the recording's frames
RARE_ENDS = 0.02  # if a smaller share of the recordings has equal ends, only long ends count
LONG_END = 0.25  # the length of a long end, as a share of the recording's frames
# if sensors have noise, at most this share of the frames between the ends equal the frame before
MOST_REPEATS = 0.05
FEWEST_REPEATS = 0.01  # chance is computed with at least this share
# if more than this share of the sensors stand still in some recordings, they are untouched
MOST_STUCK = 0.1
# share of the recordings in which a sensor moves at all; there it must move all the time
LIVELY_SHARE = 0.9
# lengths differ by object if the probability of the Kruskal-Wallis test is below this
DIFFER_BELOW = 1e-3
# factor between recordings in two units; no recording lies in the gap between them
OTHER_UNIT = 4.0


def remarks(recordings: Recordings, look: Look) -> list[Note]:
    """Return the reader's notes, and warnings of recordings that spoil a result.

    Args:
        recordings: the table of raw counts.
        look: the look at the same recordings, see `look_at`.
    """
    return [
        *recordings.notes,
        *without_frames(recordings),
        *_copies(recordings, look),
        *_shared_frames(recordings, look),
        *_standing_still(recordings, look),
        *_stuck_sensors(recordings, look),
        *_equal_ends(recordings, look),
        *_units(recordings, look),
        *_spellings(recordings),
        *_times(recordings),
    ]


def without_frames(recordings: Recordings) -> list[Note]:
    """Return a warning that names recordings without frames, and objects without a frame.

    Args:
        recordings: the table of raw counts.
    """
    text = ""
    names = _not_in(recordings.columns["recording"], recordings.recordings)
    if names:
        text += f"{several(len(names), 'recording')} without frames: {listed(names)}. "
    objects = _not_in(recordings.columns["object"], recordings.objects)
    if objects:
        text += f"There is no frame of the objects {listed(objects)}. "
    if not text:
        return []
    return [_warning("no frames", f"{text}Record them again, or remove them.")]


def _not_in(index: np.ndarray, names: list[str]) -> list[str]:
    """Return the names whose number is not in an index (T,) of frames."""
    missing = np.setdiff1d(np.arange(len(names)), index)
    return [names[number] for number in missing]


def _warning(topic: str, text: str) -> Note:
    return Note(text, "warning", topic)


def _places(places: list[str]) -> str:
    """Return the first three places, which are long texts, and the number of other places."""
    first = places[:MOST_PLACES]
    if len(places) > MOST_PLACES:
        first.append(f"and {len(places) - MOST_PLACES} more")
    return ", ".join(first)


def _copies(recordings: Recordings, look: Look) -> Iterator[Note]:
    """Warn of recordings that have the counts of an earlier recording."""
    original = look.by_recording["original"]
    names = recordings.recordings
    pairs = list[str]()
    for copy, first in original[original != original.index].items():
        pairs.append(f"{names[copy]} repeats {names[first]}")
    if not pairs:
        return
    text = f"{several(len(pairs), 'recording')} with the counts of a different one: "
    text += f"{listed(pairs)}. A copy tests nothing, and a copy labelled as a different object is "
    text += "wrong. Remove it, or record it again."
    yield _warning("copies", text)


def _shared_frames(recordings: Recordings, look: Look) -> Iterator[Note]:
    """Warn of recordings that have frames in common with an earlier one, and are no copies of it.

    Recordings that the source already holds out together, such as overlapping windows, do not
    count.
    """
    table = look.by_recording
    partners = table.loc[table["partner"]]
    is_other_object = table["object"].to_numpy() != partners["object"].to_numpy()
    is_apart = np.ones(len(table), dtype=bool)
    takes = takes_of_source(recordings)
    if takes is not None:
        is_apart = takes.loc[table.index].to_numpy() != takes.loc[partners.index].to_numpy()
    is_piece = (table["shared"] > 0) & (table["original"] == table.index)
    is_remarkable = is_piece & (is_other_object | is_apart)
    pieces = table[is_remarkable]
    if pieces.empty:
        return
    names = recordings.recordings
    places = list[str]()
    for number, piece in pieces.iterrows():
        of_frames = f"{piece['shared']} of {several(piece['frames'], 'frame')}"
        places.append(f"{names[number]} ({of_frames}, as {names[piece['partner']]})")
    text = f"{several(len(pieces), 'recording')} with frames of a different one: "
    text += f"{_places(places)}. They are overlapping pieces or copies of one recording, "
    text += "and say nothing about a new one. "
    mixed = int((is_remarkable & is_other_object).sum())
    if mixed:
        text += f"{several(mixed, 'pair')} of different objects: are their labels right? "
    text += "Pieces of one object are held out together here"
    if _are_of_several_sessions(recordings, pieces):
        text += ", but not by split.by=session, since some of them are of several sessions"
    text += ". If you split recordings yourself, pass their `groups`."
    yield _warning("shared frames", text)


def _are_of_several_sessions(recordings: Recordings, pieces: pd.DataFrame) -> bool:
    """Return whether a recording and its partner of the same frames are of different sessions.

    Args:
        recordings: the table of raw counts.
        pieces: rows of `Look.by_recording`.
    """
    numbers = np.asarray(recordings.columns["recording"])
    session_of = pd.Series(np.asarray(recordings.columns["session"])).groupby(numbers).first()
    of_pieces = session_of.loc[pieces.index].to_numpy()
    of_partners = session_of.loc[pieces["partner"]].to_numpy()
    return bool((of_pieces != of_partners).any())


def _standing_still(recordings: Recordings, look: Look) -> Iterator[Note]:
    """Warn of recordings in which nothing changes, if others change nearly all the time."""
    long_enough = look.by_recording[look.by_recording["frames"] > 1]
    moving = long_enough[long_enough["moves"] > 0]
    still = long_enough[long_enough["moves"] == 0]
    if still.empty or len(moving) < len(still):
        return
    usual = float((moving["moves"] / (moving["frames"] - 1)).median())
    expected = len(long_enough) * (1 - usual) ** (still["frames"] - 1)
    still = still[expected < MOST_EXPECTED]
    if usual < NOISY_MOVES or still.empty:
        return
    names = [recordings.recordings[number] for number in still.index]
    text = f"No sensor changes in {several(len(names), 'recording')}: {listed(names)}. "
    text += "Did the glove freeze? Record them again, or remove them."
    yield _warning("standing still", text)


def _stuck_sensors(recordings: Recordings, look: Look) -> Iterator[Note]:
    """Warn of sensors that never change in some recordings, but always change in most others.

    If many sensors stand still, nothing is wrong: nothing touches them, and they read a constant.
    With coarse noise, one sensor of many stands still in a short recording by chance.
    """
    long_enough = np.asarray(look.lively.any(axis=1))
    stuck = look.stuck[long_enough]
    lively = look.lively[long_enough]
    of_recording = look.by_recording[long_enough]
    moving = ~stuck
    is_stuck = stuck.any(axis=0)
    is_lively = lively.sum(axis=0) >= LIVELY_SHARE * moving.sum(axis=0)
    is_odd = is_stuck & is_lively & (moving.sum(axis=0) > stuck.sum(axis=0))
    if not is_odd.any() or is_stuck.sum() > max(1, MOST_STUCK * stuck.shape[1]):
        return
    odd = np.flatnonzero(is_odd)
    index_of = compress(frames_by_recording(recordings), long_enough)
    counts_of = [recordings.live_counts()[index][:, odd] for index in index_of]
    chance = _chance_of_stuck(counts_of, stuck[:, odd])
    odd = odd[stuck.shape[1] * chance < MOST_EXPECTED]
    if not len(odd):
        return
    names = recordings.sensor_names(recordings.live)
    places = list[str]()
    for sensor in odd:
        place = _place_of_stuck(recordings, of_recording["object"], stuck[:, sensor])
        places.append(f"{names[sensor]} in {place}")
    text = "A sensor never changes in some recordings, but always changes in others: "
    if len(places) > 1:
        text = f"{several(len(places), 'sensor')} that never change in some recordings, "
        text += "but always change in others: "
    text += f"{listed(places, '; ')}. Is its cable loose? "
    text += "If nothing touches it there, all is well."
    yield _warning("standing still", text)


def _chance_of_stuck(counts_of: Sequence[np.ndarray], stuck: np.ndarray) -> np.ndarray:
    """Return the probability (S,) that sensors stand still in so many recordings by chance.

    If the readings of a sensor are independent, and its most frequent reading has the probability
    p, then n frames are equal with a probability of p^(n - 1) at most.

    Args:
        counts_of: R recordings (n, S).
        stuck: bool (R, S), whether a sensor stands still in a recording.
    """
    from scipy.stats import poisson

    shares = np.array([_most_frequent_share(counts) for counts in counts_of])
    usual = shares.mean(axis=0, where=~stuck)
    frames = np.array([len(counts) for counts in counts_of])
    expected = (usual ** (frames[:, None] - 1)).sum(axis=0)
    probability: np.ndarray = poisson.sf(stuck.sum(axis=0) - 1, expected)
    return probability


def _most_frequent_share(counts: np.ndarray) -> np.ndarray:
    """Return the share (S,) of the frames (n, S) in which each sensor has its commonest reading."""
    rising = np.sort(counts, axis=0)
    run = np.ones(counts.shape[1])
    longest = run.copy()
    for is_same in rising[1:] == rising[:-1]:
        run = np.where(is_same, run + 1, 1)
        longest = np.maximum(longest, run)
    return longest / len(counts)


def _place_of_stuck(recordings: Recordings, objects: pd.Series, is_stuck: np.ndarray) -> str:
    """Return the names of the recordings in which a sensor is stuck, or of their object.

    Args:
        recordings: the table of raw counts.
        objects: the object of each of some recordings, by the recording's number.
        is_stuck: bool, whether the sensor is stuck in each of these recordings.
    """
    of_stuck = objects[is_stuck]
    first = of_stuck.iloc[0]
    is_one_object = bool((of_stuck == first).all())
    if is_one_object and len(of_stuck) == (objects == first).sum() > 1:
        return f"all of {recordings.objects[first]}"
    return listed([recordings.recordings[number] for number in of_stuck.index])


def _equal_ends(recordings: Recordings, look: Look) -> Iterator[Note]:
    """Warn of recordings that begin or end with equal frames, if frames hardly repeat inside.

    Sensors without noise read the same while the hand rests, which is no fault. Readings far from
    all others are padding.
    """
    moving = look.by_recording[look.by_recording["moves"] > 0]
    if moving.empty:
        return
    is_padded = _is_padded(moving)
    padded = moving[is_padded]
    if padded.empty:
        return
    places = list[str]()
    for number, row in padded.iterrows():
        end = f"the first {row['head']}"
        if row["tail"] >= row["head"]:
            end = f"the last {row['tail']}"
        places.append(f"{recordings.recordings[number]} ({end} of {row['frames']})")
    text = f"Equal frames at an end of {several(len(places), 'recording')}: {_places(places)}. "
    text += "Is that padding, or did the glove freeze? "
    of_ends = _equal_frames(moving).where(is_padded, 0)
    if _differ_by_object(of_ends.to_numpy(), moving["object"].to_numpy()):
        text += "Their number differs between the objects, and a classifier can learn that. "
    text += "If it is either, cut these frames off: recordings can differ in length. "
    text += "If the hand rests there, all is well."
    yield _warning("equal ends", text)


def _equal_frames(rows: pd.DataFrame) -> pd.Series:
    """Return how many frames at both ends repeat the first or the last frame of a recording."""
    return rows["head"] + rows["tail"] - 2


def _is_padded(rows: pd.DataFrame) -> pd.Series:
    """Return the recordings that begin or end with equal frames that are no hand at rest.

    Args:
        rows: the rows of `Look.by_recording` for recordings that move.
    """
    steps = float((rows["frames"] - 1 - _equal_frames(rows)).sum())
    repeats = (steps - float(rows["moves"].sum())) / max(steps, 1.0)
    longest = rows[["head", "tail"]].max(axis=1)
    is_long = (longest >= FEWEST_EQUAL) & (longest >= FEWEST_EQUAL_SHARE * rows["frames"])
    expected = len(rows) * max(repeats, FEWEST_REPEATS) ** (longest - 1)
    stands_out = (repeats <= MOST_REPEATS) & (expected < MOST_EXPECTED) & (rows["end"] != "rest")
    is_padded = is_long & (stands_out | (rows["end"] == "outside"))
    if is_padded.mean() < RARE_ENDS:
        is_padded &= longest >= LONG_END * rows["frames"]
    return is_padded


def _differ_by_object(lengths: np.ndarray, objects: np.ndarray) -> bool:
    """Return whether lengths differ between objects, by the Kruskal-Wallis test.

    Args:
        lengths: (R,) a length of each recording.
        objects: (R,) the object of each recording.
    """
    from scipy.stats import kruskal

    if len(np.unique(lengths)) < 2 or len(np.unique(objects)) < 2:
        return False
    samples = [lengths[objects == label] for label in np.unique(objects)]
    return bool(kruskal(*samples).pvalue < DIFFER_BELOW)


def _units(recordings: Recordings, look: Look) -> Iterator[Note]:
    """Warn of recordings whose readings and smallest changes are weaker or stronger by a factor.

    A light grip reads less than a firm grip, but has the same noise. In another unit the noise
    differs too, and there is a gap between the recordings of the two units.
    """
    strength = _relative(look.strength)
    step = _relative(look.step)
    known = np.flatnonzero(np.isfinite(strength) & np.isfinite(step))
    if len(known) < 2:
        return
    usual = _largest_cluster(strength, known)
    strength -= np.median(strength[usual])
    step -= np.median(step[usual])
    others = np.setdiff1d(known, usual)
    has_same_sign = strength[others] * step[others] > 0
    has_other_noise = np.abs(step[others]) >= np.abs(strength[others]) / 2
    others = others[has_same_sign & has_other_noise]
    numbers = look.by_recording.index
    for word, sign in (("weaker", -1), ("stronger", 1)):
        rows = others[np.sign(strength[others]) == sign]
        if not len(rows):
            continue
        factor = float(np.exp(np.median(np.abs(strength[rows]))))
        names = [recordings.recordings[number] for number in numbers[rows]]
        text = f"{several(len(names), 'recording')} about {factor:.3g} times {word} than the "
        text += f"others, noise included: {listed(names)}. "
        text += "Do they have another unit or gain? Convert them, or remove them."
        yield _warning("unit", text)


def _largest_cluster(strength: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the indices of the largest set of recordings without a gap of `OTHER_UNIT` inside.

    Args:
        strength: (R,) the logarithm of each recording's strength.
        known: the indices of the recordings whose strength is known.
    """
    order = known[np.argsort(strength[known])]
    gaps = np.diff(strength[order], prepend=strength[order[0]])
    cluster = np.cumsum(gaps >= np.log(OTHER_UNIT))
    return np.asarray(order[cluster == np.bincount(cluster).argmax()])


def _relative(values: np.ndarray) -> np.ndarray:
    """Return the logarithm (R,) of the factor by which a recording's values exceed the usual ones.

    It is the median over sensors, and NaN if no sensor has a value above 0.

    Args:
        values: (R, K), the value of each recording and sensor.
    """
    with np.errstate(divide="ignore"), warnings.catch_warnings():
        # NumPy warns of sensors and recordings without a value
        warnings.simplefilter("ignore", RuntimeWarning)
        logarithms = np.log(np.where(values > 0, values, np.nan).astype(np.float64))
        usual = np.nanquantile(logarithms, 0.5, axis=0, method="lower")
        return np.asarray(np.nanmedian(logarithms - usual, axis=1))


def _spellings(recordings: Recordings) -> Iterator[Note]:
    """Warn of objects whose names differ only in capitals, blanks, hyphens or underscores.

    The name of the empty hand is always `empty_hand`, so another spelling of it is warned of too.
    """
    first_frames = [index[0] for index in frames_by_recording(recordings)]
    labels = np.asarray(recordings.columns["object"])[first_frames]
    counts = np.bincount(labels, minlength=len(recordings.objects)).tolist()
    spellings = dict[str, list[str]]()
    for name, count in zip(recordings.objects, counts, strict=True):
        spelling = f"{name!r} ({several(count, 'recording')})"
        letters = unicodedata.normalize("NFKC", name)
        key = re.sub(r"(?<=\w)[\s_-]+", "", letters).casefold()
        spellings.setdefault(key, []).append(spelling)
        if key in EMPTY_HANDS and name != EMPTY_HAND:
            text = f"The object {spelling}: if it is the empty hand, name it {EMPTY_HAND!r}."
            yield _warning("spelling", text)
    names = [" and ".join(alike) for alike in spellings.values() if len(alike) > 1]
    if names:
        text = f"Objects whose names differ only in spelling: {listed(names)}. "
        text += "If they are one object, give them one name."
        yield _warning("spelling", text)


def _times(recordings: Recordings) -> Iterator[Note]:
    """Warn of times that do not rise from frame to frame."""
    order = np.concatenate(frames_by_recording(recordings))
    recording = np.asarray(recordings.columns["recording"])[order]
    time = np.asarray(recordings.columns["time"])[order]
    is_in_one_recording = recording[1:] == recording[:-1]
    falls = is_in_one_recording & (np.diff(time) <= 0)
    if not falls.any():
        return
    first = recordings.recordings[recording[falls.argmax()]]
    text = f"Times repeat or fall at {several(int(falls.sum()), 'place')}, first in {first}. "
    text += "Check the clock of the program that records."
    yield _warning("time", text)
