"""What the text and the page of an inspection show: a rehearsal of `preprocess`, and facts that only they need."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.baseline import MIN_FRAMES, evenly, of_empty_hand
from tactile_viewgcn.frames.choose import Choice, choose, contact_readings, measure
from tactile_viewgcn.frames.contact import session_medians
from tactile_viewgcn.frames.leak import check_first_frames
from tactile_viewgcn.frames.open_hand import OpenHand, frames_by_recording
from tactile_viewgcn.frames.quick_error import QuickError
from tactile_viewgcn.frames.sides import deal
from tactile_viewgcn.frames.split import SPLIT_SEED, split_groups
from tactile_viewgcn.notes import Note
from tactile_viewgcn.pages.settings import preprocess_settings, split_settings
from tactile_viewgcn.params import DEFAULTS, PreprocessSection, load
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import TRAIN
from tactile_viewgcn.tables.recordings import Recordings, recordings_of

PERCENTILES = (0, 1, 50, 99, 100)
SAMPLE = 2000  # frames of which percentiles are computed
STUCK = 0.1  # of the median sensor's noise
SATURATED = 0.01  # share of frames at the largest reading there is
GAP = 2.5  # median intervals: frames are missing


@dataclass(frozen=True)
class Overview:
    """What is shown of R recordings with frames, of O objects.

    Attributes:
        recordings: the table; its frames stay mapped after its file is gone.
        choice: what `preprocess` chooses with the recommended split.
        settings: recommended values with reasons, of level `choice`.
        label, session: (R,) index of each recording's object and session.
        counts: (R,) numbers of each recording's frames by their kind: `frames`, `in contact`, `open hand` and, where
            the source flags that an object is held, `flagged`; `recordings` are ones.
        empty: (sessions,) frames of the empty hand.
        groups: by `split.by`, each object's number of groups (O,), 0 of the empty hand's.
        error, leak: of the quick classifier on all recordings above that baseline, on contact and without it; None
            where no whole groups can be held out.
        first_frame: error on the first frame of each recording; None where all frames are contact.
        seconds: (R,) from first to last frame; NaN where the source has no time.
        interval: median seconds between frames, or None; gaps: intervals of more than 2.5 times that.
        drift: (R,) largest change of the open hand, see `_drift`.
        readings: percentiles (5,) 0, 1, 50, 99 and 100 of `all` readings in counts, and of those of sensors in contact
            `above the baseline`; NaN without any.
        stuck: bool (H, W) sensors that vary by less than a tenth of the median sensor's noise.
        saturated: bool (H, W) sensors that read the largest number that any does in more than 1 % of the frames; none
            where only one reading is that large.
        noise: (H, W) standard deviation of a sensor without contact, the median of the sessions.
    """

    recordings: Recordings
    choice: Choice
    settings: list[Note]
    label: np.ndarray
    session: np.ndarray
    counts: dict[str, np.ndarray]
    empty: np.ndarray
    groups: dict[str, np.ndarray]
    error: QuickError | None
    leak: QuickError | None
    first_frame: QuickError | None
    seconds: np.ndarray
    interval: float | None
    gaps: int
    drift: np.ndarray
    readings: dict[str, np.ndarray]
    stuck: np.ndarray
    saturated: np.ndarray
    noise: np.ndarray

    @property
    def hand(self) -> OpenHand:
        """Where the hand is open, and where it is in contact."""
        assert self.choice.hand  # all is `auto`
        return self.choice.hand

    def setting(self, key: str) -> str:
        """The recommended value of a parameter."""
        return next(str(note.value) for note in self.settings if note.key == key)


def inspect_source(path: str | Path, layout: Sequence[int] | None = None) -> Overview:
    """Inspect a source in any form that `ingest` reads, see `open_source`.

    Raises:
        UserError: lists the mistakes of the source.
        FileNotFoundError: nothing at that path.
    """
    with recordings_of(path, layout=layout) as recordings:
        asked = load(DEFAULTS).preprocess
        return overview(
            recordings, replace(asked, baseline="auto", filter="auto", contact_sensors="auto", scale="auto")
        )


def overview(recordings: Recordings, asked: PreprocessSection) -> Overview:
    """Inspect the table of raw counts: split and settings are those that `preprocess` takes with the recommended ones.

    Args:
        asked: every value that is chosen here is `auto`.
    """
    columns, empty, recorded = recordings.columns, of_empty_hand(recordings), frames_by_recording(recordings)
    first, groups = np.array([index[0] for index in recorded]), _groups(recordings, empty)
    settings = split_settings(groups)
    split = replace(load(DEFAULTS).split, **{note.key.removeprefix("split."): note.value for note in settings})
    rng = stream(SPLIT_SEED, "preprocess")
    sides = deal(recordings, split, rng, empty_hand_class=asked.empty_hand_class)
    choice = choose(recordings, asked, sides)
    hand, kind = choice.hand, choice.params.baseline
    assert hand  # all is `auto`
    everything = replace(sides, side=np.full_like(sides.side, TRAIN))
    errors, leaks = measure(recordings, hand, {kind: choice.baseline}, everything) if sides.whole else ({}, {})
    kinds = {"frames": np.ones(len(recordings), dtype=bool), "in contact": hand.contact, "open hand": hand.open}
    if flags := [columns[name] for name in ("grasp_valid", "valid") if name in columns]:
        kinds["flagged"] = flags[0]
    counts = {name: np.array([mask[index].sum() for index in recorded]) for name, mask in kinds.items()}
    interval, gaps, seconds = _sampling([columns["time"][index] for index in recorded])
    above = contact_readings(recordings, hand, choice.baseline, np.ones(len(recordings), dtype=bool))
    sample = hand.counts[evenly(np.arange(len(recordings)), SAMPLE)]
    smallest, largest, at_largest = _extremes(hand, recorded)
    noise = np.median(hand.noise[np.unique(columns["session"][first])], axis=0)
    stuck = sample.std(axis=0, dtype=np.float64) < STUCK * np.median(noise)
    saturated = (at_largest / len(recordings) > SATURATED) & (at_largest.sum() > 1)
    return Overview(
        recordings=recordings,
        choice=choice,
        settings=[*preprocess_settings(recordings, choice), *settings],
        label=columns["object"][first],
        session=columns["session"][first],
        counts={"recordings": np.ones(len(recorded), dtype=np.int64)} | counts,
        empty=np.bincount(columns["session"][empty], minlength=len(recordings.sessions)),
        groups=groups,
        error=errors.get(kind),
        leak=leaks.get(kind),
        first_frame=None if hand.all_contact else check_first_frames(recordings, hand),
        seconds=seconds,
        interval=interval,
        gaps=gaps,
        drift=_drift(hand, recorded, columns["session"][first]),
        readings={
            "all": np.array([smallest, *np.percentile(sample, PERCENTILES[1:-1]), largest]),
            "above the baseline": np.percentile(above, PERCENTILES)
            if len(above)
            else np.full(len(PERCENTILES), np.nan),
        },
        stuck=_on_layout(stuck, recordings.live),
        saturated=_on_layout(saturated, recordings.live),
        noise=_on_layout(noise, recordings.live),
    )


def _groups(recordings: Recordings, empty: np.ndarray) -> dict[str, np.ndarray]:
    """See `Overview.groups`; of `source` the groups are its two sides."""
    columns = {name: values[~empty] for name, values in recordings.columns.items()}
    groups = {}
    for by in ("source", "recording", "grasp"):
        with suppress(UserError):  # no such column
            group = split_groups(columns, by)
            pairs = np.unique(np.stack([columns["object"], columns["split"] if by == "source" else group]), axis=1)
            groups[by] = np.bincount(pairs[0], minlength=len(recordings.objects))
    return groups


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


def _drift(hand: OpenHand, recorded: list[np.ndarray], session: np.ndarray) -> np.ndarray:
    """Largest change (R,) of the open hand within each recording, or from the median of its session's (R,).

    It is the root mean square over sensors in standard deviations of noise; NaN with fewer than ten open-hand frames.
    """
    drift, medians = np.full(len(recorded), np.nan), session_medians(hand.quiet, session)
    for row, index in enumerate(recorded):
        opened = index[hand.open[index]]
        if len(opened) < 2 * MIN_FRAMES:
            continue
        first, last = (hand.counts[part].mean(axis=0) for part in (opened[:MIN_FRAMES], opened[-MIN_FRAMES:]))
        changes = np.stack([last - first, first - medians[row], last - medians[row]]) / hand.noise[session[row]]
        drift[row] = np.sqrt((changes**2).mean(axis=1)).max()
    return drift


def _extremes(hand: OpenHand, recorded: list[np.ndarray]) -> tuple[float, float, np.ndarray]:
    """Smallest and largest reading, and in how many frames each sensor (S,) reads the largest."""
    smallest, largest = (float(end([end(hand.counts[index]) for index in recorded])) for end in (np.min, np.max))
    at_largest = sum((hand.counts[index] == largest).sum(axis=0) for index in recorded)
    return smallest, largest, np.asarray(at_largest)
