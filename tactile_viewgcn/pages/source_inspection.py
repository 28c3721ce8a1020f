"""What the text and the page of an inspection show, measured when they are asked for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactile_viewgcn.frames.automatic import compare, first_look
from tactile_viewgcn.frames.baseline import MIN_FRAMES, evenly
from tactile_viewgcn.frames.inspection import Inspection, contact_readings, inspect_recordings
from tactile_viewgcn.frames.leak import check_first_frames
from tactile_viewgcn.frames.measurement import Measurement, possible_baselines
from tactile_viewgcn.frames.quick_error import QuickError
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.pages.split_choice import split_choices
from tactile_viewgcn.params import DEFAULTS, load
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.recordings import Recordings, recordings_of

PERCENTILES = (0, 1, 50, 99, 100)
SAMPLE = 2000  # frames of which percentiles are computed
POINTS = 100  # of a time line, at most
STUCK = 0.1  # of the median sensor's noise
SATURATED = 0.01  # share of frames at the largest reading there is
GAP = 2.5  # median intervals: frames are missing
ALWAYS = ("object", "recording", "session", "frame", "time")  # columns that every source has


@dataclass(frozen=True)
class Overview:
    """What is shown of R recordings with frames, S sensors that vary, O objects.

    Attributes:
        inspection: what is decided by.
        path: of the source.
        shape, dtype: of a frame; of the stored counts.
        columns: optional columns that the source has, such as `valid`, `grasp`, `split`.
        sessions: names.
        seconds: (R,) from first to last frame; NaN where the source has no time.
        interval: median seconds between frames, or None; gaps: intervals of more than 2.5 times that.
        drift: (R,) largest change of the open hand, see `_drift`.
        measurement: errors by baseline and filter, on all recordings by the `split.by` that is recommended; None where
            no whole groups can be held out.
        first_frame: whether objects are told from the first frame of each recording; None where it was not checked, as
            where all frames are contact.
        percentiles: (5,) of all readings, in counts: 0, 1, 50, 99 and 100.
        above: (5,) of the readings of sensors in contact, in counts above the baseline; NaN without any.
        stuck: bool (H, W) sensors that vary by less than a tenth of the median sensor's noise.
        saturated: (H, W) share of frames in which a sensor reads the largest number that any does; 0 everywhere where
            only one reading is that large.
        noise: (H, W) standard deviation of a sensor without contact, the median of the sessions.
        mean_frame: (O, H, W) mean counts above the baseline in frames of contact, NaN of an object without any.
        activity: for each recording, up to 100 means over the sensors, in counts above the baseline, in order.
        in_contact: for each of these, the share of its frames that are in contact.
    """

    inspection: Inspection
    path: Path
    shape: tuple[int, int]
    dtype: str
    columns: list[str]
    sessions: list[str]
    seconds: np.ndarray
    interval: float | None
    gaps: int
    drift: np.ndarray
    measurement: Measurement | None
    first_frame: QuickError | None
    percentiles: np.ndarray
    above: np.ndarray
    stuck: np.ndarray
    saturated: np.ndarray
    noise: np.ndarray
    mean_frame: np.ndarray
    activity: list[np.ndarray]
    in_contact: list[np.ndarray]


def inspect_source(path: str | Path, layout: Sequence[int] | None = None) -> Overview:
    """Inspect a source in any form that `ingest` reads, see `open_source`.

    Raises:
        UserError: lists the mistakes of the source.
        FileNotFoundError: nothing at that path.
    """
    with recordings_of(path, layout=layout) as recordings:
        return overview(recordings)


def overview(recordings: Recordings, *, sensors: int | None = None) -> Overview:
    """Inspect the table of raw counts; `sensors`: `preprocess.contact_sensors`, None: auto."""
    asked = load(DEFAULTS).preprocess
    hand, params = first_look(recordings, asked if sensors is None else replace(asked, contact_sensors=sensors))
    of, measurement = inspect_recordings(recordings, hand), None
    by = next(str(note.value) for note in split_choices(of) if note.key == "split.by")
    if by != "frame":
        baselines, everything = possible_baselines(recordings, hand, params), np.ones(len(recordings), dtype=bool)
        measurement = compare(recordings, of, baselines, params, split_groups(recordings.columns, by), everything)
    interval, gaps, seconds = _sampling([recordings.columns["time"][index] for index in of.frames_of])
    means, activity, in_contact = _means(of)
    above = contact_readings(of)[1]
    sample = of.hand.counts[evenly(np.arange(len(recordings)), SAMPLE)]
    smallest, largest, at_largest = _extremes(of)
    spread, noise = sample.std(axis=0, dtype=np.float64), np.median(of.hand.noise[np.unique(of.session)], axis=0)
    rng = stream(0, "first frame")
    return Overview(
        inspection=of,
        path=recordings.path,
        shape=recordings.shape,
        dtype=str(recordings.dtype),
        columns=[name for name in recordings.columns if name not in ALWAYS],
        sessions=recordings.sessions,
        seconds=seconds,
        interval=interval,
        gaps=gaps,
        drift=_drift(of),
        measurement=measurement,
        first_frame=None if of.all_contact else check_first_frames(recordings, of.hand, rng),
        percentiles=np.array([smallest, *np.percentile(sample, PERCENTILES[1:-1]), largest]),
        above=np.percentile(above, PERCENTILES) if len(above) else np.full(len(PERCENTILES), np.nan),
        stuck=_on_layout(spread < STUCK * np.median(noise), of.live),
        saturated=_on_layout(at_largest / len(recordings) * (at_largest.sum() > 1), of.live),
        noise=_on_layout(noise, of.live),
        mean_frame=np.stack([_on_layout(mean, of.live) for mean in means]),
        activity=activity,
        in_contact=in_contact,
    )


def _on_layout(values: np.ndarray, live: np.ndarray) -> np.ndarray:
    """Values (S,) of the live sensors as (H, W); 0 elsewhere."""
    layout = np.zeros(live.shape, dtype=values.dtype)
    layout[live] = values
    return layout


def _sampling(times: list[np.ndarray]) -> tuple[float | None, int, np.ndarray]:
    """Median interval in seconds, number of gaps, and the length of each recording, from the times of its frames."""
    seconds = np.array([time[-1] - time[0] for time in times])
    steps = np.concatenate([np.diff(time) for time in times])
    if not len(steps) or not np.isfinite(steps).all() or not (interval := float(np.median(steps))) > 0:
        return None, 0, np.where(seconds > 0, seconds, np.nan)
    return interval, int((steps > GAP * interval).sum()), seconds


def _drift(of: Inspection) -> np.ndarray:
    """Largest change (R,) of the open hand within each recording, or from its session's baseline.

    It is the root mean square over sensors in standard deviations of noise; NaN with fewer than ten open-hand frames.
    """
    drift = np.full(len(of.frames_of), np.nan)
    for row, index in enumerate(of.frames_of):
        opened = index[of.hand.open[index]]
        if of.all_contact or len(opened) < 2 * MIN_FRAMES:
            continue
        first, last = (of.hand.counts[part].mean(axis=0) for part in (opened[:MIN_FRAMES], opened[-MIN_FRAMES:]))
        baseline, noise = of.of_session[of.session[row]], of.hand.noise[of.session[row]]
        changes = np.stack([last - first, first - baseline, last - baseline]) / noise
        drift[row] = np.sqrt((changes**2).mean(axis=1)).max()
    return drift


def _means(of: Inspection) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Mean frame (O, S) of each object in contact, and the time lines `activity` and `in_contact`; see `Overview`."""
    sums, number = np.zeros((len(of.objects), of.hand.counts.shape[1])), np.zeros((len(of.objects), 1))
    activity, in_contact = [], []
    for row, index in enumerate(of.frames_of):
        excess, in_hand, points = of.hand.counts[index] - of.baseline[row], of.in_hand[index], min(POINTS, len(index))
        sums[of.label[row]] += excess[in_hand].sum(axis=0)
        number[of.label[row]] += in_hand.sum()
        activity.append(np.array([part.mean() for part in np.array_split(excess.mean(axis=1), points)]))
        in_contact.append(np.array([part.mean() for part in np.array_split(in_hand, points)]))
    return np.where(number > 0, sums / np.maximum(number, 1), np.nan), activity, in_contact


def _extremes(of: Inspection) -> tuple[float, float, np.ndarray]:
    """Smallest and largest reading, and in how many frames each sensor (S,) reads the largest."""
    smallest, largest = (float(end([end(of.hand.counts[index]) for index in of.frames_of])) for end in (np.min, np.max))
    at_largest = sum((of.hand.counts[index] == largest).sum(axis=0) for index in of.frames_of)
    return smallest, largest, np.asarray(at_largest)
