"""Define the table of kept frames, data/frames, and the table of views, data/views."""

from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd

from tactile_viewgcn.files import new_files, readable
from tactile_viewgcn.params import SIDES as SIDES  # the published split has the same codes
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
WRITTEN_FRAMES = 4096  # frames that are written at once
INPUT_FRAMES = 512  # frames whose network input is computed at once
PLAN = "plan."  # the names of a plan's values in a table's folder begin with this
#: The columns of the table of frames.
FRAME_COLUMNS = (
    "label",
    "recording",
    "session",
    "grasp",
    "group",
    "side",
    "anchor",
    "baseline",
    "time",
)


@dataclass(frozen=True, eq=False)
class Frames:
    """The n kept frames in the order of their recordings, with R baselines and C classes.

    Each column can be read as an attribute: `frames.label` is `frames.columns["label"].to_numpy()`.

    Attributes:
        counts: (n, H, W) raw counts, memory-mapped if the table was read from a folder.
        columns: a row for each frame. Its columns are listed below as attributes.
        baseline_mean: (R, H, W) the baselines in counts, in a type that holds `counts` exactly.
        classes: the names of the classes, by `label`.
        recordings: the names of the recordings, by `recording`.
        sessions: the names of the sessions, by `session`.
        plan: how readings became these frames; new recordings become frames in the same way.
        label: (n,) the class.
        recording: (n,) the number of the recording.
        session: (n,) the number of the session.
        grasp: (n,) the number of the grasp inside its recording; 0 if grasps are not numbered.
        group: (n,) the split group.
        side: (n,) TRAIN, VALIDATION or TEST.
        anchor: bool (n,), the anchors. A view set is drawn around each anchor. Every class has
            about equally many.
        baseline: (n,) the index into `baseline_mean`.
        time: (n,) seconds since the recording's first frame; NaN if the source has no times.
    """

    counts: Counts
    columns: pd.DataFrame
    baseline_mean: np.ndarray
    classes: list[str]
    recordings: list[str]
    sessions: list[str]
    plan: Plan

    def __len__(self) -> int:
        return len(self.columns)

    @cached_property
    def label(self) -> np.ndarray:
        """Return the class (n,) of each frame."""
        return self._column("label")

    @cached_property
    def recording(self) -> np.ndarray:
        """Return the number (n,) of each frame's recording."""
        return self._column("recording")

    @cached_property
    def session(self) -> np.ndarray:
        """Return the number (n,) of each frame's session."""
        return self._column("session")

    @cached_property
    def grasp(self) -> np.ndarray:
        """Return the number (n,) of each frame's grasp inside its recording."""
        return self._column("grasp")

    @cached_property
    def group(self) -> np.ndarray:
        """Return the split group (n,) of each frame."""
        return self._column("group")

    @cached_property
    def side(self) -> np.ndarray:
        """Return the set (n,) of each frame: TRAIN, VALIDATION or TEST."""
        return self._column("side")

    @cached_property
    def anchor(self) -> np.ndarray:
        """Return which frames are anchors, bool (n,)."""
        return self._column("anchor")

    @cached_property
    def baseline(self) -> np.ndarray:
        """Return the index (n,) of each frame's baseline in `baseline_mean`."""
        return self._column("baseline")

    @cached_property
    def time(self) -> np.ndarray:
        """Return the time (n,) of each frame in seconds since its recording's first frame."""
        return self._column("time")

    def _column(self, name: str) -> np.ndarray:
        values: np.ndarray = self.columns[name].to_numpy()
        return values

    @property
    def live(self) -> np.ndarray:
        """Return the sensors whose counts vary in the training set, bool (H, W)."""
        return self.plan.live

    @property
    def transform(self) -> str:
        """Return how counts above baseline become network input, see `network_input`."""
        return self.plan.params.transform

    @property
    def scale(self) -> float:
        """Return the counts at full scale, see `network_input`."""
        return float(self.plan.params.scale)

    def with_columns(self, **columns: np.ndarray) -> "Frames":
        """Return the same table with other values (n,) in some columns."""
        return replace(self, columns=self.columns.assign(**columns))

    def values(self) -> dict[str, Any]:
        """Return all but the counts as arrays and plain values, for `save_table`."""
        values: dict[str, Any] = {name: getattr(self, name) for name in FRAME_COLUMNS}
        for name in ("baseline_mean", "classes", "recordings", "sessions"):
            values[name] = getattr(self, name)
        for name, value in asdict(self.plan).items():
            values[f"{PLAN}{name}"] = value
        return values

    @classmethod
    def of_values(cls, folder: Path, values: dict[str, Any]) -> "Frames":
        """Return the table that `values` describes, with memory-mapped counts from the folder."""
        columns = pd.DataFrame({name: values.pop(name) for name in FRAME_COLUMNS})
        names = [name for name in values if name.startswith(PLAN)]
        plan = Plan(**{name.removeprefix(PLAN): values.pop(name) for name in names})
        return cls(read_counts(folder), columns, plan=plan, **values)

    def inputs(self, index: np.ndarray, transform: str | None = None) -> np.ndarray:
        """Return the network input float32 (k, H, W) of frames.

        Args:
            index: (k,) the indices of the frames.
            transform: the transform, see `network_input`; None for the transform of the table.
        """
        inputs = np.empty((len(index), *self.counts.shape[1:]), dtype=np.float32)
        for start in range(0, len(index), INPUT_FRAMES):
            part = index[start : start + INPUT_FRAMES]
            excess = self.counts[part].astype(self.baseline_mean.dtype)
            excess -= self.baseline_mean[self.baseline[part]]
            inputs[start : start + len(part)] = network_input(
                excess, transform or self.transform, self.scale
            )
        return inputs

    def points(self, index: np.ndarray) -> Gathered:
        """Return the network input float32 (k, S) of frames at the live sensors.

        It is computed when it is indexed.

        Args:
            index: (k,) the indices of the frames.
        """
        return Gathered(self._inputs_of_live_sensors, index)

    def _inputs_of_live_sensors(self, index: np.ndarray) -> np.ndarray:
        return self.inputs(index)[:, self.live]

    def by_recording(self, index: np.ndarray) -> list[np.ndarray]:
        """Divide rising indices (n,) of frames by recording; the parts are rising too."""
        parts = pd.Series(index).groupby(self.recording[index])
        return [part.to_numpy() for _, part in parts]

    def on(self, *sides: int) -> np.ndarray:
        """Return the rising indices of the frames in the given sets, such as TRAIN."""
        return np.flatnonzero(np.isin(self.side, sides))


@dataclass(frozen=True)
class Views:
    """The result of the stage `cluster`.

    Attributes:
        cluster: int16 (n,) the cluster of each kept frame. It is NO_CLUSTER in the test set, and
            everywhere if nothing is clustered.
        pool: int64 (n,) the pool in which each kept frame is clustered.
        viewpoints: float64 (V, 3), the viewpoints.
    """

    cluster: np.ndarray
    pool: np.ndarray
    viewpoints: np.ndarray

    @property
    def clustered(self) -> bool:
        """Return whether any frame has a cluster."""
        return bool((self.cluster != NO_CLUSTER).any())

    def unclustered(self) -> "Views":
        """Return a copy without clusters."""
        return replace(self, cluster=np.full_like(self.cluster, NO_CLUSTER))

    def values(self) -> dict[str, Any]:
        """Return the arrays by name, for `save_table`."""
        return dict(vars(self))

    @classmethod
    def of_values(cls, _: Path, values: dict[str, Any]) -> "Views":
        """Return the table that `values` describes."""
        return cls(**values)


Table = TypeVar("Table", Frames, Views)


def network_input(excess: np.ndarray, transform: str, scale: float) -> np.ndarray:
    """Return the network input float32, of the same shape as the counts.

    Args:
        excess: the counts x above the baseline.
        transform: `clip` returns clip(x / scale, 0, 1), as the released code does. `log` returns
            log(1 + max(x, 0)). `counts` returns x, for systems without a network.
        scale: the counts at full scale, which only `clip` needs.
    """
    excess = np.asarray(excess, dtype=np.float32)
    if transform == "clip":
        clipped: np.ndarray = np.clip(excess / np.float32(scale), 0, 1)
        return clipped
    if transform == "counts":
        return excess
    logarithms: np.ndarray = np.log1p(np.maximum(excess, 0))
    return logarithms


def frame_rates(time: np.ndarray, recording: np.ndarray) -> dict[int, float]:
    """Return the frame rate in Hz of each recording that has times, by its number.

    The rate is one over the median of the time steps between frames.

    Args:
        time: (n,) the seconds of each frame, in the order of time.
        recording: (n,) the number of each frame's recording.
    """
    steps_of_time = pd.Series(time).groupby(recording).diff()
    step = steps_of_time.groupby(recording).median()
    rates: dict[int, float] = (1 / step[step > 0]).to_dict()
    return rates


def save_table(path: str | Path, table: Frames | Views) -> None:
    """Write a table as a folder, see `tables/counts.py`."""
    with new_files(path) as part:
        if isinstance(table, Frames):
            counts = table.counts
            starts = steps(range(0, len(counts), WRITTEN_FRAMES), "writing", "blocks of frames")
            blocks = (counts[start : start + WRITTEN_FRAMES] for start in starts)
            write_counts(part, counts.shape, counts.dtype, blocks)
        write_columns(part, table.values())


def load_table(path: str | Path, kind: type[Table]) -> Table:
    """Return a table that `save_table` wrote, with memory-mapped counts.

    Args:
        path: the folder of the table.
        kind: the class of the table.

    Raises:
        UserError: the table is damaged, or another version of the project wrote it.
    """
    folder = Path(path)
    with readable(folder):
        return kind.of_values(folder, read_columns(folder))
