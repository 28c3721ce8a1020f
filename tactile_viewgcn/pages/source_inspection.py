"""What an inspection shows: a rehearsal of `preprocess`, recommended settings, and further facts of the recordings."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactile_viewgcn.frames.auto import Choice, choose
from tactile_viewgcn.frames.empty_hand import MIN_FRAMES
from tactile_viewgcn.frames.filter import SENSORS_IN_CONTACT
from tactile_viewgcn.frames.leak import QuickError, check_first_frames, quick_error
from tactile_viewgcn.frames.open_hand import HandStates
from tactile_viewgcn.frames.split import has_published_split, split_groups
from tactile_viewgcn.messages import Note, UserError, several
from tactile_viewgcn.params import CONTACT_SIGMAS, PreprocessSection
from tactile_viewgcn.readers.source import AUTO, Form
from tactile_viewgcn.tables.counts import evenly
from tactile_viewgcn.tables.recordings import Recordings, frames_by_recording, recordings_of
from tactile_viewgcn.tables.remarks import originals, remarks

SAMPLE = 2000  # frames for the variation of a sensor
STUCK = 0.1  # of the median sensor's noise
SATURATED = 0.01  # share of frames at the largest reading of all sensors
GAP = 2.5  # median intervals: frames are missing
MOST_FOLDS = 5
FEW_FRAMES = 50_000  # of contact


@dataclass
class Overview:
    """What an inspection shows of R recordings with frames, of O objects.

    Attributes:
        recordings: the table; its frames stay mapped after its file is gone.
        form: as which the source was read.
        settings: recommended values with reasons, of level `choice`.
        choice: what `auto` becomes on all recordings, where `preprocess` looks at the training side alone.
        remarks: notes on the source and its table, see `tables.remarks`.
        groups: by `split.by`, each object's number of groups (O,), 0 for the empty hand; copies of a recording are one.
        label, session: (R,) index of each recording's object and session.
        counts: (R,) number of each recording's frames by kind: `frames`, `in contact`, `open hand` and, where the
            source flags that an object is held, `flagged`; `recordings` are ones.
        empty: (sessions,) frames of the empty states.
        error, leak: of the quick classifier above the chosen baseline, on contact and without it; None where no two
            objects have two groups.
        first_frame: error on the first frame of each recording; None where all frames are contact.
        interval: median seconds between frames, or None; gaps: number of intervals of more than 2.5 times that.
        seconds: (R,) from first to last frame; NaN where the source has no time.
        stuck: bool (H, W) sensors that vary by less than a tenth of the median noise; none without an open hand.
        saturated: bool (H, W) sensors that read the largest number that any does in more than 1 % of the frames; none
            where only one reading is that large.
    """

    recordings: Recordings
    form: Form
    settings: list[Note]
    choice: Choice
    remarks: list[Note]
    groups: dict[str, np.ndarray]
    label: np.ndarray
    session: np.ndarray
    counts: dict[str, np.ndarray]
    empty: np.ndarray
    error: QuickError | None
    leak: QuickError | None
    first_frame: QuickError | None
    interval: float | None
    gaps: int
    seconds: np.ndarray
    stuck: np.ndarray
    saturated: np.ndarray

    @property
    def states(self) -> HandStates:
        """The frames of contact, and those of the open states."""
        return self.choice.states

    @property
    def unit(self) -> str:
        """The unit of readings, noise and baselines."""
        return "counts" if self.recordings.dtype.kind in "iu" else "the readings' unit"

    def setting(self, key: str) -> str:
        """The recommended value of a parameter."""
        return next(str(note.value) for note in self.settings if note.key == key)


def inspect_source(path: str | Path, form: Form = AUTO) -> Overview:
    """Inspect a source in any form that `ingest` reads, see `open_source`.

    Raises:
        UserError: lists the mistakes of the source.
        FileNotFoundError: nothing at that path.
    """
    with recordings_of(path, form) as recordings:
        return inspect_table(recordings, PreprocessSection(), form)


def inspect_table(recordings: Recordings, asked: PreprocessSection, form: Form = AUTO) -> Overview:
    """Inspect a table of raw counts: choose as `preprocess` does, but on all recordings.

    Args:
        asked: settings of `preprocess`; `auto` where this chooses.
        form: as which the source was read.
    """
    columns, original, recorded = recordings.columns, originals(recordings), frames_by_recording(recordings)
    groups, first = _groups(recordings, original), np.array([index[0] for index in recorded])
    split = split_settings(groups)
    group = split_groups(columns, str(split[0].value))
    choice = choose(recordings, np.arange(len(recordings)), asked, group)
    states = choice.states
    stuck, saturated = _faulty(recordings, states, recorded)
    interval, gaps, seconds = _sampling([columns["time"][index] for index in recorded])
    return Overview(
        recordings=recordings,
        form=form,
        settings=[*preprocess_settings(recordings, choice), *split],
        choice=choice,
        remarks=remarks(recordings, original),
        groups=groups,
        label=columns["object"][first],
        session=columns["session"][first],
        counts=_counts(columns, states, recorded),
        empty=np.bincount(columns["session"][recordings.empty_hand], minlength=len(recordings.sessions)),
        error=_contact_error(recordings, choice, group),
        leak=choice.leak,
        first_frame=None if states.all_contact else check_first_frames(recordings, states),
        interval=interval,
        gaps=gaps,
        seconds=seconds,
        stuck=stuck,
        saturated=saturated,
    )


def _contact_error(recordings: Recordings, choice: Choice, group: np.ndarray) -> QuickError | None:
    """Error of recognising the objects on contact, by log(1 + excess) in units of the weakest contact."""
    states, baseline = choice.states, choice.baseline
    unit = CONTACT_SIGMAS * np.median(states.noise[np.unique(recordings.columns["session"])])

    def readings(index: np.ndarray) -> np.ndarray:
        excess = states.counts[index] - baseline.mean[baseline.of_frame[index]][:, recordings.live]
        return np.log1p(np.maximum(excess / unit, 0))

    usable = states.contact & ~recordings.empty_hand
    return quick_error(readings, usable, recordings.columns["object"], group)


def _counts(columns: dict[str, np.ndarray], states: HandStates, recorded: list[np.ndarray]) -> dict[str, np.ndarray]:
    """See `Overview.counts`."""
    kinds = {"frames": np.ones_like(states.open), "in contact": states.contact, "open hand": states.open}
    if flags := [columns[name] for name in ("grasp_valid", "valid") if name in columns]:
        kinds["flagged"] = flags[0]
    counts = {name: np.array([mask[index].sum() for index in recorded]) for name, mask in kinds.items()}
    return {"recordings": np.ones(len(recorded), dtype=np.int64)} | counts


def _faulty(recordings: Recordings, states: HandStates, recorded: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """`stuck` and `saturated` of an `Overview`."""
    sample = states.counts[evenly(np.arange(len(recordings)), SAMPLE)]
    noise = np.median(states.noise[np.unique(recordings.columns["session"])])
    stuck = (sample.std(axis=0, dtype=np.float64) < STUCK * noise) & (states.open.sum() >= MIN_FRAMES)
    largest = max(states.counts[index].max() for index in recorded)
    at_largest = np.sum([(states.counts[index] == largest).sum(axis=0) for index in recorded], axis=0)
    saturated = (at_largest / len(recordings) > SATURATED) & (at_largest.sum() > 1)
    layouts = np.zeros((2, *recordings.shape), dtype=bool)
    layouts[:, recordings.live] = stuck, saturated
    return layouts[0], layouts[1]


def _groups(recordings: Recordings, original: np.ndarray) -> dict[str, np.ndarray]:
    """See `Overview.groups`; of `source` the groups are its two sides."""
    of_object = ~recordings.empty_hand
    columns = {name: values[of_object] for name, values in recordings.columns.items()}
    columns["recording"], groups = original[columns["recording"]], {}
    for by in ("source", "recording", "grasp"):
        with suppress(UserError):  # no such column
            group = split_groups(columns, by)
            pairs = np.unique(np.stack([columns["object"], columns["split"] if by == "source" else group]), axis=1)
            groups[by] = np.bincount(pairs[0], minlength=len(recordings.objects))
    return groups


def _sampling(times: list[np.ndarray]) -> tuple[float | None, int, np.ndarray]:
    """Median interval in seconds, number of gaps, and the length of each recording, from the times of its frames."""
    seconds = np.array([time[-1] - time[0] for time in times])
    steps = np.concatenate([np.diff(time) for time in times])
    if not len(steps) or not np.isfinite(steps).all() or not (interval := float(np.median(steps))) > 0:
        return None, 0, np.where(seconds > 0, seconds, np.nan)
    return interval, int((steps > GAP * interval).sum()), seconds


def _choice(key: str, value: str | int, reason: str) -> Note:
    return Note(reason, "choice", key.split(".")[0], key, value)


def split_settings(groups: dict[str, np.ndarray]) -> list[Note]:
    """Hold out recordings, or grasps where more objects have two of them."""
    if "source" in groups and (groups["source"][groups["recording"] > 0] == 2).all():
        return [_choice("split.by", "source", "every object is on both published sides")]
    counts = {by: groups[by][groups["recording"] > 0] for by in ("recording", "grasp") if by in groups}
    by = max(counts, key=lambda by: (counts[by] >= 2).sum())  # recordings, if as many objects have two of them
    if (counts["recording"] >= 2).sum() >= 0.5 * len(counts["recording"]):
        by = "recording"
    repeated = counts[by] >= 2
    if repeated.sum() < 2:
        few = "one recording an object" if not repeated.any() else "only one object has two recordings"
        return [_choice("split.by", by, f"{few}: no whole recording can be held out: record each twice")]
    single, fewest = int((~repeated).sum()), int(counts[by][repeated].min())
    alone = f"; {several(single, 'object')} {'has' if single == 1 else 'have'} one and cannot be tested" * (single > 0)
    each_is_needed = by == "recording" and fewest < 2 * MOST_FOLDS  # to learn from, so one at a time is held out
    folds = fewest if each_is_needed else min(MOST_FOLDS, fewest)
    return [
        _choice("split.by", by, f"an object has {fewest} {by}s or more, of which whole ones are held out{alone}"),
        _choice("split.folds", folds, f"{by}s in {folds} parts; split.fold says which is tested"),
    ]


def preprocess_settings(recordings: Recordings, choice: Choice) -> list[Note]:
    """What `auto` becomes, number of views and preset, but no setting that the preset does not read."""
    settings, states = [note for note in choice.notes if note.level == "choice"], choice.states
    if states.contact_sensors == SENSORS_IN_CONTACT or states.all_contact:
        settings = [note for note in settings if note.key != "preprocess.contact_sensors"]
    if len(np.unique(recordings.columns["recording"])) == len(recordings):
        settings.append(_choice("views", 1, "every recording is one frame"))
    if not has_published_split(recordings) or states.contact.sum() <= FEW_FRAMES:  # unlike STAG's `classification`
        reason = (
            "it compares classifiers on your training recordings and takes the first within a standard error of the "
            "lowest"
        )
        settings.append(_choice("preset", "best", reason))
        settings = [note for note in settings if note.key != "preprocess.scale"]  # networks alone read it
    return settings
