"""Look once at each recording's readings: what repeats, what stands still, how strong they are.

Recordings are read one at a time. Little of each stays in memory: a row of a table, a number for
each frame, and a few values for each sensor. `tables.remarks` makes warnings of these.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from tactile_viewgcn.files import new_files
from tactile_viewgcn.messages import EMPTY_HAND
from tactile_viewgcn.readers.source import COLUMNS as COLUMN_TYPES
from tactile_viewgcn.tables.common_frames import (
    CommonFrames,
    common_frames,
    frame_hashes,
    is_monotone,
    sensor_weights,
)
from tactile_viewgcn.tables.counts import COLUMNS_FILE, evenly, read_columns, write_columns
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording

FEWEST_INSIDE = 5  # fewest frames between equal ends that show how the readings move
NEARLY_ALL = 0.9  # share of the sensors that vary
MOST_SCALED_SENSORS = 64  # sensors whose strength and steps are computed
MOST_SCALED_FRAMES = 20_000  # frames of a recording from which these are computed
STRONG_QUANTILE = 0.99  # of a sensor's absolute readings in a recording
# of a sensor's changes; it is the size of the noise, or of the step to which readings are rounded
STEP_QUANTILE = 0.1
MOST_PARTS = 10  # parts of a recording; a lively sensor changes in each of them
FEWEST_PART_STEPS = 10  # fewest steps of a part


@dataclass(frozen=True, kw_only=True)
class Look:
    """The findings of one look at R recordings with frames and S live sensors.

    Attributes:
        by_recording: a row for each recording, by its number. The columns are

            - `object`: the number of its object;
            - `frames`: the number of its frames;
            - `moves`: the number of frames that differ from the frame before;
            - `head` and `tail`: the numbers of equal frames at the beginning and at the end. They
              are at least 1, and count all frames if nothing changes;
            - `end`: how the longer of these ends reads, see `_kind_of_end`;
            - `original`: the number of the first recording with the same counts;
            - `shared`: the number of its frames that earlier recordings have too;
            - `partner`: the number of the first of these recordings, or else its own;
            - `take`: the number of the first recording with which it is held out together.
        stuck: bool (R, S), the sensors that read the same in all frames of the recording.
        lively: bool (R, S), the sensors that change in every part of the recording.
        strength: (R, K), the strong readings of up to 64 sensors, see `STRONG_QUANTILE`.
        step: (R, K), the small changes of these sensors, see `STEP_QUANTILE`. It is NaN if a sensor
            does not change.
    """

    by_recording: pd.DataFrame
    stuck: np.ndarray
    lively: np.ndarray
    strength: np.ndarray
    step: np.ndarray

    @property
    def has_shared_frames(self) -> bool:
        """Whether any two recordings have frames in common."""
        return bool(self.by_recording["shared"].any())


def look_at(recordings: Recordings) -> Look:
    """Look at every recording that has frames, and return the findings.

    A clock among the columns always changes. So monotone columns do not count when frames are
    compared.

    Args:
        recordings: the table of raw counts. Each recording is read once or twice.
    """
    live = recordings.live_counts()
    index_of = frames_by_recording(recordings)
    scaled = evenly(np.arange(live.shape[1]), MOST_SCALED_SENSORS)
    compared = np.flatnonzero(~is_monotone(live, index_of))
    weights = sensor_weights(len(compared))
    rows = list[dict[str, int | str]]()
    stuck = list[np.ndarray]()
    lively = list[np.ndarray]()
    strength = list[np.ndarray]()
    step = list[np.ndarray]()
    hashes = list[np.ndarray]()
    changed = list[np.ndarray]()
    for index in index_of:
        counts = live[index]
        differs = counts[1:] != counts[:-1]
        moved = differs[:, compared].any(axis=1)
        rows.append(_row(counts[:, compared], moved))
        stuck.append(~differs.any(axis=0))
        lively.append(_lively(differs))
        strength.append(_strong_readings(counts, scaled))
        step.append(_small_steps(counts, scaled))
        hashes.append(frame_hashes(counts[:, compared], weights))
        changed.append(np.concatenate([[False], moved]))

    first_frames = [index[0] for index in index_of]
    numbers = np.asarray(recordings.columns["recording"], dtype=np.int64)[first_frames]
    labels = np.asarray(recordings.columns["object"], dtype=np.int64)[first_frames]
    common = common_frames(
        live,
        index_of,
        hashes=np.concatenate(hashes),
        changed=np.concatenate(changed),
        is_empty=np.array([recordings.objects[label] == EMPTY_HAND for label in labels]),
        compared=compared,
    )
    by_recording = pd.DataFrame(rows, index=pd.Index(numbers, name="recording"))
    by_recording.insert(0, "object", labels)
    _add_common_frames(by_recording, common)
    by_recording["take"] = _takes(recordings, numbers, common.links)
    return Look(
        by_recording=by_recording,
        stuck=np.array(stuck),
        lively=np.array(lively),
        strength=np.array(strength),
        step=np.array(step),
    )


def held_together(recordings: Recordings, look: Look) -> Recordings:
    """Return the recordings such that recordings with frames in common are held out together.

    Recordings with frames in common get the same number in the column `take`.

    Args:
        recordings: the table of raw counts.
        look: the look at the same recordings.
    """
    if not look.has_shared_frames:
        return recordings
    columns = recordings.columns.copy()
    columns["take"] = _take_of_frames(recordings, look)
    return replace(recordings, columns=columns)


def write_takes(folder: Path, recordings: Recordings, look: Look) -> None:
    """Write the column `take` of `held_together` to a table, if recordings share frames.

    Args:
        folder: the folder of the table.
        recordings: the same table.
        look: the look at the same recordings.
    """
    if not look.has_shared_frames:
        return
    columns = read_columns(folder)
    columns["take"] = _take_of_frames(recordings, look)
    with new_files(folder, COLUMNS_FILE) as part:
        write_columns(part, columns)


def groups_together(recordings: Recordings, look: Look, groups: np.ndarray) -> np.ndarray:
    """Return the groups int (T,) of frames after merging groups that have frames in common.

    Args:
        recordings: the table of raw counts.
        look: the look at the same recordings.
        groups: int (T,), the group of each frame.
    """
    if not look.has_shared_frames:
        return groups
    group = pd.factorize(groups, sort=True)[0]
    take = pd.factorize(_take_of_frames(recordings, look), sort=True)[0]
    take_node = group.max() + 1 + take
    links = pd.DataFrame({"group": group, "take": take_node}).drop_duplicates()
    component = _components(links.to_numpy(), int(take_node.max()) + 1)
    return np.asarray(component[group])


def _take_of_frames(recordings: Recordings, look: Look) -> np.ndarray:
    """Return the take (T,) of each frame."""
    takes = look.by_recording["take"].loc[np.asarray(recordings.columns["recording"])]
    return np.asarray(takes, dtype=COLUMN_TYPES["take"])


def _row(counts: np.ndarray, moved: np.ndarray) -> dict[str, int | str]:
    """Return how a recording moves, see `Look.by_recording`.

    Args:
        counts: (n, S) the counts of the sensors that are compared.
        moved: bool (n - 1,), the steps in which any of these sensors changes.
    """
    frames = len(counts)
    steps = np.flatnonzero(moved)
    head = frames
    tail = frames
    if len(steps):
        head = int(steps[0]) + 1
        tail = frames - 1 - int(steps[-1])
    return {
        "frames": frames,
        "moves": len(steps),
        "head": head,
        "tail": tail,
        "end": _kind_of_end(counts, head=head, tail=tail),
    }


def _kind_of_end(counts: np.ndarray, *, head: int, tail: int) -> str:
    """Return how the equal frames at the longer end compare with the frames between the ends.

    Args:
        counts: (n, S) the counts of a recording.
        head: the number of equal frames at the beginning.
        tail: the number of equal frames at the end.

    Returns:
        `rest` if both ends are equal, or if nearly all sensors have their smallest or largest
        reading there, as in a hand at rest. `outside` if the end is further from all other readings
        than these are from each other. Otherwise "".
    """
    if max(head, tail) < 2:
        return ""
    if min(head, tail) > 1 and (counts[0] == counts[-1]).all():
        return "rest"
    inside = counts[head : len(counts) - tail]
    if len(inside) < FEWEST_INSIDE:
        return ""
    end = counts[0].astype(np.float64)
    if tail >= head:
        end = counts[-1].astype(np.float64)
    low = inside.min(axis=0).astype(np.float64)
    high = inside.max(axis=0).astype(np.float64)
    varies = (low != end) | (high != end)
    beyond = np.maximum(low - end, end - high)
    is_far = beyond > high - low
    if is_far[varies].mean() >= NEARLY_ALL:
        return "outside"
    is_extreme = beyond >= 0
    if is_extreme[varies].mean() >= NEARLY_ALL:
        return "rest"
    return ""


def _lively(differs: np.ndarray) -> np.ndarray:
    """Return the sensors bool (S,) that change in each of up to ten parts of a recording.

    Args:
        differs: bool (n - 1, S), whether a sensor changes in a step.
    """
    steps = len(differs)
    if steps < FEWEST_PART_STEPS:
        return np.zeros(differs.shape[1], dtype=bool)
    parts = min(MOST_PARTS, steps // FEWEST_PART_STEPS)
    begins = np.linspace(0, steps, parts, endpoint=False).astype(int)
    changes_in_part = np.logical_or.reduceat(differs, begins, axis=0)
    return np.asarray(changes_in_part.all(axis=0))


def _strong_readings(counts: np.ndarray, sensors: np.ndarray) -> np.ndarray:
    """Return the strong reading (K,) of each of the `sensors` (K,), see `STRONG_QUANTILE`.

    Args:
        counts: (n, S) the counts of a recording.
        sensors: int (K,), the indices of the sensors.
    """
    frames = evenly(np.arange(len(counts)), MOST_SCALED_FRAMES)
    readings = np.abs(counts[np.ix_(frames, sensors)].astype(np.float64))
    return np.asarray(np.quantile(readings, STRONG_QUANTILE, axis=0), dtype=np.float32)


def _small_steps(counts: np.ndarray, sensors: np.ndarray) -> np.ndarray:
    """Return a small change (K,) of each of the `sensors` (K,), see `STEP_QUANTILE`.

    Args:
        counts: (n, S) the counts of a recording.
        sensors: int (K,), the indices of the sensors.
    """
    frames = evenly(np.arange(len(counts) - 1), MOST_SCALED_FRAMES)
    before = counts[np.ix_(frames, sensors)].astype(np.float64)
    after = counts[np.ix_(frames + 1, sensors)].astype(np.float64)
    steps = np.sort(np.abs(after - before), axis=0)
    zeros = (steps == 0).sum(axis=0)
    moving = np.flatnonzero(zeros < len(steps))
    rank = (zeros + STEP_QUANTILE * (len(steps) - zeros)).astype(int)
    small = np.full(len(sensors), np.nan, dtype=np.float32)
    small[moving] = steps[rank[moving], moving]
    return small


def _add_common_frames(by_recording: pd.DataFrame, common: CommonFrames) -> None:
    """Add the columns `original`, `shared` and `partner`, see `Look.by_recording`."""
    numbers = by_recording.index.to_numpy()
    partner = np.arange(len(numbers))
    np.minimum.at(partner, common.links[:, 0], common.links[:, 1])
    by_recording["original"] = numbers[common.original]
    by_recording["shared"] = common.shared
    by_recording["partner"] = numbers[partner]


def _takes(recordings: Recordings, numbers: np.ndarray, links: np.ndarray) -> np.ndarray:
    """Return the take (R,) of each recording, see `Look.by_recording`.

    Takes that the source names stay together.

    Args:
        recordings: the table of raw counts.
        numbers: (R,) the numbers of the recordings with frames.
        links: (L, 2) pairs of indices into `numbers`.
    """
    pairs = [links]
    takes = takes_of_source(recordings)
    if takes is not None:
        position = pd.Series(np.arange(len(numbers)))
        first = position.groupby(takes.to_numpy()).transform("min")
        pairs.append(np.stack([position, first], axis=1))
    component = _components(np.concatenate(pairs), len(numbers))
    return np.asarray(pd.Series(numbers).groupby(component).transform("min"))


def takes_of_source(recordings: Recordings) -> pd.Series | None:
    """Return the take of each recording with frames, by its number; None if there are no takes.

    Args:
        recordings: the table of raw counts.
    """
    if "take" not in recordings.columns:
        return None
    take = pd.Series(np.asarray(recordings.columns["take"]))
    return take.groupby(np.asarray(recordings.columns["recording"])).first()


def _components(pairs: np.ndarray, count: int) -> np.ndarray:
    """Return the number (count,) of the connected component of each node.

    Args:
        pairs: int (L, 2), the nodes that are connected.
        count: the number of nodes.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1])
