"""Define the plan: how readings become frames, decided on the training set.

`frames/decide.py` makes the plan, and `frames/apply.py` applies it to every recording. The table of
frames and the model file store it.
"""

from typing import Annotated, Literal

import numpy as np
from pydantic import ConfigDict, Field
from pydantic.dataclasses import dataclass

from tactile_viewgcn.params import PreprocessSection

#: The configuration of pydantic's dataclasses that hold arrays.
ARRAYS = ConfigDict(arbitrary_types_allowed=True, extra="forbid", hide_input_in_errors=True)


@dataclass(frozen=True, eq=False, config=ARRAYS)
class Plan:
    """How readings become frames, and the typical readings of the training frames.

    The decisions stand first. They are enough for the training, validation and test set. New
    recordings also need the other attributes, from `noise` on, which `measured_on` adds.

    Attributes:
        params: the settings of `preprocess`, with every `auto` decided.
        live: bool (H, W), the sensors whose counts vary in the training set.
        dtype: the type of the raw counts.
        channel_names: the names of the sensors, row after row, or none.
        shows_open_hand: whether the training recordings show an open hand. If not, no frame counts
            as an open hand for a baseline. The filter still decides which frames are in contact.
        own_open_hand: whether most training recordings of objects show an open hand of their own,
            so that a new recording without one is unusual. It is false if that is not known.
        drift: the standard deviation in counts of the median sensor between the open hands of a
            session. It is 0 if it was not measured.
        kept_share: the share of the training frames that pass the filter.
        noise: (H, W) the mean standard deviation of the training set's baselines in counts. It is
            NaN if it was not measured, and has the shape (0, 0) before `measured_on`.
        sessions: the names of the S sessions that have training frames.
        baselines: (S, H, W) the mean baseline of each of these sessions in counts.
        strong_readings: two pairs, the lowest and the highest strong reading of the training
            recordings in counts. The first pair is above the baseline and the second raw, see
            `frames/training_readings.py`.
        least_change: the smallest `change_between_frames` above 0 of the training recordings in
            counts; 0 if it is not known.
        rates: the lowest and the highest frame rate of the training recordings in Hz; 0 and
            infinity without times.
    """

    params: PreprocessSection
    live: np.ndarray
    dtype: Literal["int16", "int32", "float32", "float64"]
    channel_names: list[str]
    shows_open_hand: bool = True
    own_open_hand: bool = False
    drift: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    kept_share: float = 1.0
    noise: np.ndarray = Field(default_factory=lambda: np.zeros((0, 0)))
    sessions: list[str] = Field(default_factory=list)
    baselines: np.ndarray = Field(default_factory=lambda: np.zeros((0, 0, 0)))
    strong_readings: list[list[float]] = Field(default_factory=list)
    least_change: Annotated[float, Field(ge=0)] = 0.0
    rates: list[float] = Field(default_factory=lambda: [0.0, np.inf])

    def check(self) -> None:
        """Raise a ValueError unless the plan can be applied to new recordings.

        The plan must come from `measured_on`. Its types are checked when it is made.

        Raises:
            ValueError: a setting is not decided, an array or a list has the wrong size or type, or
                the noise of a sensor is below 0 or infinite.
        """
        if "auto" in vars(self.params).values():
            raise ValueError("a setting is not decided")
        if self.live.dtype != bool or self.live.ndim != 2 or not self.live.any():
            raise ValueError("no sensor is live")
        if self.noise.shape != self.live.shape:
            raise ValueError(f"noise of {self.noise.shape}; expected {self.live.shape}")
        if (self.noise < 0).any() or np.isinf(self.noise).any():  # NaN: the noise was not measured
            raise ValueError("the noise of a sensor is below 0 or infinite")
        expected = (len(self.sessions), *self.live.shape)
        if self.baselines.shape != expected or not self.sessions:
            raise ValueError(f"baselines of {self.baselines.shape}; expected {expected}")
        if len(self.channel_names) not in (0, self.live.size):
            raise ValueError(f"{len(self.channel_names)} names of {self.live.size} sensors")
        if [len(pair) for pair in (*self.strong_readings, self.rates)] != [2, 2, 2]:
            raise ValueError("strong readings or rates that are no pairs")

    def mean_baseline(self) -> np.ndarray:
        """Return the mean (H, W) of the baselines of the training set's sessions, in counts."""
        return np.asarray(np.mean(self.baselines, axis=0))
