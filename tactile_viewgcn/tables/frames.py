"""The tables of kept frames, data/frames: counts, class, side and group of each; and of views, data/views."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np

from tactile_viewgcn.files import new_files, readable
from tactile_viewgcn.params import SIDES as SIDES  # once for the published split and for this table
from tactile_viewgcn.params import TEST as TEST
from tactile_viewgcn.params import TRAIN as TRAIN
from tactile_viewgcn.params import VALIDATION as VALIDATION
from tactile_viewgcn.progress import steps
from tactile_viewgcn.tables.counts import (
    Counts,
    Gathered,
    read_columns,
    read_counts,
    write_columns,
    write_counts,
)
from tactile_viewgcn.tables.plan import Plan

NO_CLUSTER = -1
PLAN = "plan."  # beginning of the names of a plan's values in a table's folder
BLOCK_FRAMES = 4096  # read or written at once
INPUT_BLOCK = 512  # frames whose network input is computed at once
Table = TypeVar("Table")


@dataclass(frozen=True)
class Frames:
    """The n kept frames in the order of their recordings, with R baselines and C classes.

    Attributes:
        counts: (n, H, W) raw counts, memory-mapped where the table was read.
        label: (n,) class, index into `classes`.
        recording, session: (n,) index into `recordings` and `sessions`.
        grasp: (n,) number of the grasp inside its recording; 0 where grasps are not numbered.
        group: (n,) split group.
        side: (n,) TRAIN, VALIDATION or TEST.
        anchor: bool (n,), anchors: frames around which a view set is drawn each, about equally many
            of every class.
        baseline: (n,) index into `baseline_mean`.
        time: (n,) seconds since the recording's first frame.
        baseline_mean: (R, H, W) counts, in a type that holds `counts` exactly.
        classes, recordings, sessions: names, by index.
        plan: how readings became these frames; new recordings become frames in the same way.
    """

    counts: Counts
    label: np.ndarray
    recording: np.ndarray
    session: np.ndarray
    grasp: np.ndarray
    group: np.ndarray
    side: np.ndarray
    anchor: np.ndarray
    baseline: np.ndarray
    time: np.ndarray
    baseline_mean: np.ndarray
    classes: list[str]
    recordings: list[str]
    sessions: list[str]
    plan: Plan

    def __len__(self) -> int:
        return len(self.label)

    @property
    def live(self) -> np.ndarray:
        """bool (H, W): the sensors whose counts vary in the training set."""
        return self.plan.live

    @property
    def transform(self) -> str:
        """How counts above baseline become network input, see `network_input`."""
        return self.plan.params.transform

    @property
    def scale(self) -> float:
        """Counts at full scale, see `network_input`."""
        return float(self.plan.params.scale)

    def inputs(self, index: np.ndarray, transform: str | None = None) -> np.ndarray:
        """Network input float32 (k, H, W) of the frames in `index` (k,), by the table's or the given transform."""
        inputs = np.empty((len(index), *self.counts.shape[1:]), dtype=np.float32)
        for start in range(0, len(index), INPUT_BLOCK):
            part = index[start : start + INPUT_BLOCK]
            excess = self.counts[part].astype(self.baseline_mean.dtype)
            excess -= self.baseline_mean[self.baseline[part]]
            inputs[start : start + len(part)] = network_input(
                excess, transform or self.transform, self.scale
            )
        return inputs

    def points(self, index: np.ndarray) -> Gathered:
        """Network input float32 (k, S) of the frames in `index` (k,) at the live sensors, computed when indexed."""
        return Gathered(lambda at: self.inputs(at)[:, self.live], index)

    def by_recording(self, index: np.ndarray) -> list[np.ndarray]:
        """Return the frames of each recording among rising indices (n,), as arrays of rising indices."""
        from pandas import Series  # here, since it loads slowly

        parts = Series(index).groupby(self.recording[index])
        return [part.to_numpy() for _, part in parts]

    def on(self, *sides: int) -> np.ndarray:
        """Rising indices of the frames on the given sides."""
        return np.flatnonzero(np.isin(self.side, sides))


@dataclass(frozen=True)
class Views:
    """Result of the stage `cluster`.

    Attributes:
        cluster: int16 (n,) of each kept frame; NO_CLUSTER on the test side, and everywhere if
            nothing is clustered.
        pool: int64 (n,) of each kept frame.
        viewpoints: float64 (V, 3).
    """

    cluster: np.ndarray
    pool: np.ndarray
    viewpoints: np.ndarray

    @property
    def clustered(self) -> bool:
        """Whether any frame has a cluster."""
        return bool((self.cluster != NO_CLUSTER).any())

    def unclustered(self) -> "Views":
        """Copy without clusters."""
        return replace(self, cluster=np.full_like(self.cluster, NO_CLUSTER))


def network_input(excess: np.ndarray, transform: str, scale: float) -> np.ndarray:
    """Network input float32 from counts above baseline, of the same shape.

    Args:
        excess: counts above baseline.
        transform: `clip` (released code): clip(x / scale, 0, 1); `log`: log(1 + max(x, 0));
            `counts`: x, for systems without a network.
        scale: counts at full scale, for `clip` only.
    """
    excess = np.asarray(excess, dtype=np.float32)
    if transform == "clip":
        return np.clip(excess / np.float32(scale), 0, 1)
    return excess if transform == "counts" else np.log1p(np.maximum(excess, 0))


def frame_rates(time: np.ndarray, recording: np.ndarray) -> dict[int, float]:
    """Frames a second of each recording that has times, by its number: one over the median of its steps.

    Args:
        time, recording: (n,) seconds and number of the recording of each frame, in the order of
            time.
    """
    from pandas import Series  # here, since it loads slowly

    steps = Series(time).groupby(recording).diff().groupby(recording).median()
    return (1 / steps[steps > 0]).to_dict()


def save_table(path: str | Path, table: Any) -> None:
    """Write a table, an object of a dataclass, as a folder, see `tables.counts`."""
    values = {field.name: getattr(table, field.name) for field in fields(table)}
    counts = values.pop("counts", None)
    plan = values.pop("plan", None)
    if plan is not None:
        values |= {f"{PLAN}{name}": value for name, value in asdict(plan).items()}
    with new_files(path) as part:
        if counts is not None:
            starts = steps(range(0, len(counts), BLOCK_FRAMES), "writing", "blocks of frames")
            blocks = (counts[start : start + BLOCK_FRAMES] for start in starts)
            write_counts(part, counts.shape, counts.dtype, blocks)
        write_columns(part, values)


def load_table(path: str | Path, kind: Callable[..., Table]) -> Table:
    """Read a table of `save_table`; counts are memory-mapped.

    Raises:
        UserError: the table is damaged, or of a different version of the project.
    """
    with readable(path):
        values = read_columns(Path(path))
        if "counts" in {field.name for field in fields(cast(Any, kind))}:
            values["counts"] = read_counts(Path(path))
            names = [name for name in values if name.startswith(PLAN)]
            values["plan"] = Plan(**{name.removeprefix(PLAN): values.pop(name) for name in names})
        return kind(**values)
