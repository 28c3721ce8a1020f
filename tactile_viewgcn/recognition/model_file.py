"""The file of a trained classifier: what it has learnt, and all that is needed to use it on raw counts.

It holds tensors and plain values, read with `weights_only=True`: loading runs no code and checks every value. Its last
bytes are a digest of all others, so that damage anywhere is noticed: an archive's checksums leave out its headers.
"""

import hashlib
import io
import math
import zipfile
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal, Self

import numpy as np
import torch
from annotated_types import Interval, MaxLen, MinLen
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer, ValidationError, model_validator
from torch import Tensor

from tactile_viewgcn.files import atomic_write, in_one_line
from tactile_viewgcn.messages import EMPTY_HAND
from tactile_viewgcn.params import MAX_NUMBER, MAX_SIDE, Model, PreprocessSection
from tactile_viewgcn.recognition.calibration import Temperature
from tactile_viewgcn.schema import Unique
from tactile_viewgcn.systems.classifier import Classifier, build_classifier
from tactile_viewgcn.tables.frames import TRAIN, Frames

REMEDY = "name a file such as models/classifier.pt, or train again (`dvc repro`, or fit and save)"
STRONG_SHARE = 0.01  # of the readings are above a recording's strong reading
STRONG_FRAMES = 2000  # that are used for the strong readings
MOST_VIEWS = 1000  # as params.yaml allows
DIGEST = hashlib.sha256().digest_size
#: an array in memory, a tensor in a model file
Array = Annotated[
    np.ndarray,
    BeforeValidator(lambda value: value.numpy() if isinstance(value, Tensor) else value),
    PlainSerializer(torch.from_numpy),
]
Unit = Annotated[float, Interval(gt=0, le=1e31)]  # counts
CHECKED = ConfigDict(extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)


class FittedPreprocessing(BaseModel):
    """The preprocessing of the training, and what its recordings read.

    Attributes:
        params: of the training's frames, without `auto`.
        kept_share: share of the training's frames that the filter keeps.
        dtype: of the counts.
        strong_readings: see the function of this name.
        live: bool (H, W) sensors.
        noise: (H, W) standard deviation of the baseline in counts, 0 where it was not measured.
        baselines: (H, W) mean of each session that has training frames, by the session's name.
    """

    model_config = CHECKED
    params: PreprocessSection
    kept_share: Annotated[float, Interval(ge=0, le=1)]
    dtype: Literal["int16", "int32", "float32", "float64"]
    strong_readings: Annotated[list[float], MinLen(2), MaxLen(2)]
    live: Array
    noise: Array
    baselines: Annotated[dict[str, Array], MinLen(1)]

    @classmethod
    def of(cls, frames: Frames) -> Self:
        """The preprocessing that made the frames; a session of several baselines has their mean."""
        train = frames.on(TRAIN)
        pairs = np.unique(np.stack([frames.session[train], frames.baseline[train]], axis=1), axis=0)
        baselines = {
            frames.sessions[session]: frames.baseline_mean[pairs[pairs[:, 0] == session, 1]].mean(axis=0)
            for session in np.unique(pairs[:, 0])
        }
        values = {
            "params": frames.preprocess,
            "kept_share": frames.kept_share,
            "dtype": str(frames.counts.dtype),
            "strong_readings": strong_readings(frames),
            "live": frames.live,
            "noise": np.nan_to_num(frames.noise),
            "baselines": baselines,
        }
        return cls.model_validate(values)

    def mean_baseline(self) -> np.ndarray:
        """Mean (H, W) of the baselines of the training's sessions."""
        return np.mean(list(self.baselines.values()), axis=0)


class Content(BaseModel):
    """What a file holds, each value in its range; see `save_classifier`."""

    model_config = CHECKED
    format: Literal[12] = 12  # add 1 when the content of a file changes
    learnt: dict[str, Any]
    viewpoints: Tensor
    model: Model
    classes: Annotated[list[str], MinLen(2), MaxLen(2**15), Unique]
    transform: Literal["clip", "log", "counts"]
    scale: Unit
    precision: Literal["float32", "bfloat16"]
    temperature: Temperature | None
    preprocessing: FittedPreprocessing

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        views, fitted = len(self.viewpoints), self.preprocessing
        shape, live = fitted.live.shape, fitted.live
        most = max(np.iinfo(fitted.dtype).max + 1, abs(fitted.params.zero)) if "int" in fitted.dtype else MAX_NUMBER
        rules = {
            "params": "auto" not in vars(fitted.params).values(),
            "viewpoints": 1 <= views <= MOST_VIEWS and self.viewpoints.shape == (views, 3),
            "live": len(shape) == 2 and live.size <= MAX_SIDE**2 and live.dtype == bool and live.any(),
            "noise": _real(fitted.noise, shape) and (fitted.noise >= 0).all(),
            "baselines": all(_real(each, shape) and np.abs(each).max() <= most for each in fitted.baselines.values()),
            "strong_readings": fitted.strong_readings == sorted(fitted.strong_readings),
        }
        if wrong := [name for name, right in rules.items() if not right]:
            raise ValueError(f"{', '.join(wrong)}: out of range, or of a different shape than the rest")
        return self


def _real(array: np.ndarray, shape: tuple[int, ...]) -> bool:
    return array.dtype.kind == "f" and array.shape == shape


def save_classifier(
    path: str | Path,
    classifier: Classifier,
    model: Model,
    frames: Frames,
    precision: str = "float32",
    temperature: float | None = None,
) -> None:
    """Write a classifier to a file, with what a `Recogniser` needs to use it on raw counts.

    Args:
        model: the options that the classifier was built with.
        frames: the classifier's training data.
        precision: of the training.
        temperature: of its answers to recordings, if it is calibrated.
    """
    learnt = _converted(classifier.state_dict(), np.ndarray, torch.from_numpy)
    learnt = _converted(learnt, Tensor, lambda weights: weights.cpu().contiguous())  # of any device and order
    values = {
        "learnt": learnt,
        "viewpoints": torch.as_tensor(classifier.viewpoints).cpu(),
        "model": model,
        "classes": frames.classes,
        "transform": classifier.transform or frames.transform,
        "scale": frames.scale,
        "precision": precision,
        "temperature": temperature,
        "preprocessing": FittedPreprocessing.of(frames),
    }
    with atomic_write(path) as part:
        torch.save(Content.model_validate(values).model_dump(), part)
        seal(part)


def _converted(state: Any, kind: type, convert: Callable[[Any], Any]) -> Any:
    """Nested mappings with their values of that kind converted."""
    if isinstance(state, dict):
        return {name: _converted(each, kind, convert) for name, each in state.items()}
    return convert(state) if isinstance(state, kind) else state


def seal(path: Path) -> None:
    """Append the SHA-256 digest of a file to it."""
    with path.open("r+b") as file:
        file.write(hashlib.file_digest(file, "sha256").digest())


def strong_readings(frames: Frames) -> list[float]:
    """The strong readings of the weakest and of the strongest training recording of an object.

    A recording's strong reading is the count above baseline that one in a hundred readings of its live sensors
    exceeds. Up to 2,000 training anchors are used.
    """
    empty = frames.classes.index(EMPTY_HAND) if EMPTY_HAND in frames.classes else -1
    anchors = np.flatnonzero(frames.anchor & (frames.side == TRAIN) & (frames.label != empty))
    used = anchors[np.linspace(0, len(anchors) - 1, min(len(anchors), STRONG_FRAMES)).astype(int)]
    readings, recording = frames.inputs(used, "counts")[:, frames.live], frames.recording[used]
    strong = [np.quantile(readings[recording == number], 1 - STRONG_SHARE) for number in np.unique(recording)]
    return [float(min(strong)), float(max(strong))]


def load_classifier(path: str | Path | BinaryIO) -> tuple[Classifier, Content]:
    """The classifier in evaluation mode, and the content of the file that `save_classifier` wrote.

    Raises:
        UserError: the file is something else, damaged, altered, or of an earlier version.
        OSError: it cannot be opened.
    """
    name = path if isinstance(path, str | Path) else "the classifier"
    with (
        Path(path).open("rb") if isinstance(path, str | Path) else nullcontext(path) as stream,
        in_one_line(name, "no classifier of this version, damaged or altered", REMEDY),
    ):
        if stream.read(2) != b"PK":
            raise ValueError("torch writes archives, and it is none")
        stored = b"PK" + stream.read()
        packed = io.BytesIO(stored[:-DIGEST])
        if hashlib.sha256(packed.getbuffer()).digest() != stored[-DIGEST:]:
            raise ValueError("its bytes and its digest differ")
        with zipfile.ZipFile(packed) as archive:
            if sum(member.file_size for member in archive.infolist()) > len(stored):
                raise ValueError("its archive is compressed, or names a part many times")
        packed.seek(0)
        values = torch.load(packed, map_location="cpu", weights_only=True)
        _check(values, set())
        try:
            content = Content.model_validate(values)
        except ValidationError as error:
            raise ValueError(str(error).partition(" [type=")[0]) from None  # the rest repeats the file's values
        return _built(content), content


def _check(value: Any, containers: set[int]) -> None:
    """A ValueError for a number that is not finite, and where few bytes of a file stand for many numbers.

    These are a tensor that shows the same memory several times, and a list that stands in several places.

    Args:
        containers: ids of the lists and mappings that were checked before.
    """
    if isinstance(value, dict | list):
        if id(value) in containers:
            raise ValueError("a list or mapping stands in several places")
        containers.add(id(value))
        for part in value.values() if isinstance(value, dict) else value:
            _check(part, containers)
    elif isinstance(value, Tensor):
        if not value.is_contiguous():
            raise ValueError("a tensor is not stored number by number")
        if not value.isfinite().all():
            raise ValueError("a number is not finite")
    elif not isinstance(value, int | float | str | None) or (isinstance(value, float) and not math.isfinite(value)):
        raise ValueError(f"{value!r:.40} is no plain value")


def _built(content: Content) -> Classifier:
    """The classifier with what it has learnt; a ValueError for weights of a different network."""
    live, learnt = content.preprocessing.live, content.learnt
    height, width = live.shape
    with torch.device("meta"):  # where weights take no memory and no random numbers
        classifier = build_classifier(content.viewpoints, len(content.classes), content.model, (height, width))
    if not isinstance(classifier, torch.nn.Module):
        classifier.load_state_dict(_converted(learnt, Tensor, Tensor.numpy), live)
        return classifier
    expected, weights = (
        {name: (each.shape, each.dtype) for name, each in state.items()} for state in (classifier.state_dict(), learnt)
    )
    if weights != expected:
        raise ValueError("its weights are those of a different network")
    classifier.load_state_dict(learnt, assign=True)
    return classifier.eval()
