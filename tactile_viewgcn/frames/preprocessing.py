"""From the table of raw counts to the frames that are learned from: baseline, selection, table of frames."""

from dataclasses import asdict, dataclass

import numpy as np

from tactile_viewgcn.frames.automatic import decide
from tactile_viewgcn.frames.baseline import Baseline
from tactile_viewgcn.frames.inspection import Inspection
from tactile_viewgcn.frames.measurement import Measurement, measure_baseline
from tactile_viewgcn.frames.selection import Selection, select
from tactile_viewgcn.frames.setting_check import preprocessing_warnings
from tactile_viewgcn.frames.split import SPLIT_SEED
from tactile_viewgcn.notes import Note
from tactile_viewgcn.params import Preprocess, PreprocessSection, Split
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.tables.recordings import Recordings


@dataclass(frozen=True)
class Preprocessed:
    """The table of frames, and how it came about.

    Attributes:
        selection: what became of every frame.
        params: without `auto`.
        inspection: of the recordings; None where nothing was to be decided.
        measurement: of the settings that were `auto`; None where nothing was measured.
        notes: on what `auto` chose, on the baseline and on what was left out, and warnings.
    """

    frames: Frames
    selection: Selection
    params: Preprocess
    baseline: Baseline
    inspection: Inspection | None
    measurement: Measurement | None
    notes: list[Note]


def preprocess_recordings(
    recordings: Recordings, asked: PreprocessSection, split: Split, *, groups: np.ndarray | None = None
) -> Preprocessed:
    """Decide what is `auto`, measure the baseline, select the frames, and look for what that took from them.

    Args:
        groups: see `select`.

    Raises:
        UserError: see `prepare`.
    """
    decision = decide(recordings, asked, split, groups)
    params, inspection = decision.params, decision.inspection
    baseline = decision.baseline or measure_baseline(recordings, params)
    frames, selection = prepare(recordings, params, split, stream(SPLIT_SEED, "preprocess"), baseline, groups)
    notes = [*decision.choices, *baseline.notes, *selection.notes]
    if inspection:
        notes += preprocessing_warnings(inspection, frames, asked)
    return Preprocessed(frames, selection, params, baseline, inspection, decision.measurement, notes)


def prepare(
    recordings: Recordings,
    preprocess: Preprocess,
    split: Split,
    rng: np.random.Generator,
    baseline: Baseline | None = None,
    groups: np.ndarray | None = None,
) -> tuple[Frames, Selection]:
    """The kept frames, whose classes are numbered by their order in the recordings, and what became of every frame.

    Args:
        baseline: what `measure_baseline` returns; None measures it.
        groups: see `select`.

    Raises:
        UserError: no sensor that varies; a baseline, flags or groups that the recordings cannot give; fewer than two
            classes left; an empty side.
    """
    baseline = baseline or measure_baseline(recordings, preprocess)
    selection = select(recordings, baseline, preprocess, split, rng, groups)
    index = np.flatnonzero(selection.keep)
    columns = {name: values[index] for name, values in recordings.columns.items()}
    objects, label = np.unique(columns["object"], return_inverse=True)
    unknown = np.full(recordings.shape, np.nan)
    frames = Frames(
        counts=recordings.kept_counts(index),
        label=label.astype(np.int16),
        recording=columns["recording"],
        session=columns["session"],
        grasp=columns.get("grasp", np.zeros_like(columns["recording"])),
        group=selection.group[index],
        side=selection.side[index],
        anchor=selection.anchor[index],
        baseline=baseline.of_frame[index],
        time=columns["time"],
        baseline_mean=baseline.mean,
        live=recordings.live,
        classes=[recordings.objects[i] for i in objects],
        recordings=recordings.recordings,
        sessions=recordings.sessions,
        baseline_names=baseline.names,
        transform=preprocess.transform,
        scale=preprocess.scale,
        noise=unknown if baseline.noise is None else baseline.noise[np.unique(baseline.of_frame)].mean(axis=0),
        preprocess=asdict(preprocess),
        kept_share=float(selection.filtered.mean()),
    )
    return frames, selection
