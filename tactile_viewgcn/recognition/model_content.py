"""What the file of a classifier may hold: plain values in their ranges, tensors that go together."""

from typing import Annotated, Any, Literal

import torch
from annotated_types import Interval, MaxLen, MinLen
from pydantic import BaseModel, ConfigDict, InstanceOf, ValidationError
from torch import Tensor

from tactile_viewgcn.params import PreprocessSection, Side
from tactile_viewgcn.schema import Unique

MOST_VIEWS = 1000  # as params.yaml allows
Temperature = Annotated[float, Interval(ge=1e-6, le=1e6)]
Readings = Annotated[float, Interval(ge=-1e31, le=1e31)]  # counts
Unit = Annotated[float, Interval(gt=0, le=1e31)]
Stored = InstanceOf[Tensor]
STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)


class CalibrationContent(BaseModel):
    """See `Calibration`."""

    model_config = STRICT
    by_frames: Annotated[list[Temperature], MinLen(1), MaxLen(MOST_VIEWS)]
    by_recordings: Annotated[list[Temperature], MaxLen(3)]
    most_frames: Annotated[int, Interval(ge=1, le=MOST_VIEWS)]


class NoveltyContent(BaseModel):
    """See `Novelty`."""

    model_config = STRICT
    maps: Stored
    unit: Stored
    threshold: Stored
    live: Stored


class Content(BaseModel):
    """See `save_classifier`."""

    model_config = STRICT
    format: int
    learnt: dict[str, Any]
    viewpoints: Stored
    model: dict[str, Any]
    classes: Annotated[list[str], MinLen(2), MaxLen(2**15), Unique]
    transform: Literal["clip", "log", "counts"]
    scale: Unit
    shape: Annotated[list[Side], MinLen(2), MaxLen(2)]
    baseline_mean: Stored
    baseline_names: Annotated[list[str], MinLen(1)]
    precision: Literal["float32", "bfloat16"]
    calibration: CalibrationContent | None
    preprocess: dict[str, Any]
    kept_share: Annotated[float, Interval(ge=0, le=1)]
    dtype: Literal["int16", "int32", "float32", "float64"]
    live: Stored
    noise: Stored
    strong_readings: Annotated[list[Readings], MinLen(2), MaxLen(2)]
    novelty: NoveltyContent | None


def check_content(content: dict[str, Any]) -> None:
    """Raise a ValueError for values out of range, or tensors that do not go together."""
    try:
        of = Content(**content)
        PreprocessSection(**of.preprocess)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        raise ValueError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    _check_once(content, set())
    views, shape = len(of.viewpoints), tuple(of.shape)
    rules = {
        "preprocess": "auto" not in of.preprocess.values(),
        "viewpoints": 1 <= views <= MOST_VIEWS and of.viewpoints.shape == (views, 3) and _finite(of.viewpoints),
        "live": of.live.shape == shape and of.live.dtype == torch.bool and bool(of.live.any()),
        "noise": of.noise.shape == shape and not (of.noise < 0).any() and not of.noise.isinf().any(),
        "baseline_mean": of.baseline_mean.shape == (len(of.baseline_names), *shape) and _finite(of.baseline_mean),
        "strong_readings": of.strong_readings == sorted(of.strong_readings),
        "calibration": of.calibration is None or len(of.calibration.by_frames) == views,
        "novelty": of.novelty is None or _fits(of.novelty, of.live),
    }
    if wrong := [name for name, right in rules.items() if not right]:
        raise ValueError(f"{', '.join(wrong)}: out of range, or of another shape than the rest")


def _fits(novelty: NoveltyContent, live: Tensor) -> bool:
    numbers = novelty.unit, novelty.threshold
    return (
        torch.equal(novelty.live, live)
        and novelty.maps.ndim == 2
        and novelty.maps.shape[1] == int(live.sum())
        and len(novelty.maps) > 0
        and _finite(novelty.maps)
        and all(one.shape == () and _finite(one) and bool(one > 0) for one in numbers)
    )


def _finite(tensor: Tensor) -> bool:
    return bool(tensor.isfinite().all())


def _check_once(value: Any, seen: set[int]) -> None:
    """A ValueError where a tensor shows the same memory several times, or a list stands in several places.

    The file is small then, and its numbers are many.
    """
    if isinstance(value, dict | list):
        if id(value) in seen:
            raise ValueError("a list or mapping stands in several places")
        seen.add(id(value))
    if isinstance(value, Tensor) and not value.is_contiguous():
        raise ValueError("a tensor is not stored number by number")
    for part in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        _check_once(part, seen)
