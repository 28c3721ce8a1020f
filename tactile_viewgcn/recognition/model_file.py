"""The file of a trained classifier: what it has learnt, and all that is needed to use it on raw counts.

It holds tensors and plain values, read with `weights_only=True`: loading runs no code and checks every value.
"""

import io
import math
import zipfile
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal, Self

import numpy as np
import torch
from annotated_types import Interval, MaxLen, MinLen
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from torch import Tensor

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.params import Model, PreprocessSection
from tactile_viewgcn.recognition.novelty import Array, Novelty, Unit, fit_novelty
from tactile_viewgcn.recognition.sequential import MOST_RECORDINGS, Calibration
from tactile_viewgcn.schema import Unique
from tactile_viewgcn.systems.classifier import Classifier, build_classifier
from tactile_viewgcn.tables.frames import TRAIN, Frames

EXPECTED = "expected what `finetune` or `TactileClassifier.save` has written, such as models/classifier.pt"
FORMAT = 7  # of the file; one written before formats had numbers has none
ARCHIVE_START = b"PK"  # of all that torch saves, of a classifier that was cut short too
STRONG_SHARE = 0.01  # of the readings are above a recording's strong reading
STRONG_FRAMES = 2000
MOST_VIEWS, MOST_SIDE = 1000, 64  # as params.yaml allows
CHECKED = ConfigDict(extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True)


class FittedPreprocessing(BaseModel):
    """The preprocessing of the training, and what its recordings read.

    Attributes:
        params: of the training's frames, without `auto`.
        kept_share: share of the recordings' frames that the filter keeps.
        dtype: of the counts.
        strong_readings: see the function of this name.
        live: bool (H, W) sensors.
        noise: (H, W) standard deviation of the baseline in counts, -1 where it was not measured.
        baselines: (H, W) of each session, by its name.
    """

    model_config = CHECKED
    params: PreprocessSection
    kept_share: Annotated[float, Interval(ge=0, le=1)]
    dtype: Literal["int16", "int32", "float32", "float64"]
    strong_readings: Annotated[list[float], MinLen(2), MaxLen(2)]
    live: Array
    noise: Array
    baselines: Annotated[dict[str, Array], MinLen(1)]

    def mean_baseline(self) -> np.ndarray:
        """Mean (H, W) of the baselines of the training's sessions."""
        return np.mean(list(self.baselines.values()), axis=0)


class Content(BaseModel):
    """What a file holds, see `save_classifier`, each value in its range."""

    model_config = CHECKED
    format: int
    learnt: dict[str, Any]
    viewpoints: Tensor
    model: Model
    classes: Annotated[list[str], MinLen(2), MaxLen(2**15), Unique]
    transform: Literal["clip", "log", "counts"]
    scale: Unit
    precision: Literal["float32", "bfloat16"]
    calibration: Calibration | None
    novelty: Novelty | None
    preprocessing: FittedPreprocessing

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        views, calibration, fitted = len(self.viewpoints), self.calibration, self.preprocessing
        shape, live = fitted.live.shape, fitted.live
        temperatures = calibration.by_frames + calibration.by_recordings if calibration else []
        rules = {
            "params": "auto" not in vars(fitted.params).values(),
            "viewpoints": 1 <= views <= MOST_VIEWS and self.viewpoints.shape == (views, 3),
            "live": len(shape) == 2 and max(shape) <= MOST_SIDE and live.dtype == bool and live.any(),
            "noise": fitted.noise.shape == shape,
            "baselines": all(baseline.shape == shape for baseline in fitted.baselines.values()),
            "strong_readings": fitted.strong_readings == sorted(fitted.strong_readings),
            "calibration": calibration is None
            or (len(calibration.by_frames) == views and len(calibration.by_recordings) <= MOST_RECORDINGS),
            "temperatures": all(1e-6 <= temperature <= 1e6 for temperature in temperatures),
            "most_frames": calibration is None or 1 <= calibration.most_frames <= MOST_VIEWS,
            "novelty": self.novelty is None or self.novelty.maps.shape[1:] == (live.sum(),),
        }
        if wrong := [name for name, right in rules.items() if not right]:
            raise ValueError(f"{', '.join(wrong)}: out of range, or of another shape than the rest")
        return self


def save_classifier(
    path: str | Path,
    classifier: Classifier,
    model: Model,
    frames: Frames,
    precision: str = "float32",
    calibration: Calibration | None = None,
) -> None:
    """Write a classifier to a file, with what a `Recogniser` needs to use it on raw counts.

    Args:
        model: that the classifier was built with; frames: its training data; precision: of its training.
        calibration: with it the classifier takes any number of views up to V.
    """
    learnt = classifier.state_dict()
    if isinstance(classifier, torch.nn.Module):  # of any device, in channels-last order
        learnt = {name: weights.cpu().contiguous() for name, weights in learnt.items()}
    novelty = fit_novelty(frames, classifier.views)
    content = {
        "format": FORMAT,
        "learnt": learnt,
        "viewpoints": classifier.viewpoints.cpu(),
        "model": asdict(model),
        "classes": frames.classes,
        "transform": classifier.transform or frames.transform,
        "scale": frames.scale,
        "precision": precision,
        "calibration": calibration and asdict(calibration),
        "novelty": novelty and vars(novelty) | {"maps": torch.from_numpy(novelty.maps)},
        "preprocessing": {
            "params": frames.preprocess,
            "kept_share": frames.kept_share,
            "dtype": str(frames.counts.dtype),
            "strong_readings": strong_readings(frames),
            "live": torch.from_numpy(frames.live),
            "noise": torch.from_numpy(frames.noise).nan_to_num(nan=-1),
            "baselines": {name: torch.from_numpy(mean) for name, mean in session_baselines(frames).items()},
        },
    }
    with atomic_write(path) as part:
        torch.save(content, part)


def session_baselines(frames: Frames) -> dict[str, np.ndarray]:
    """Baselines (H, W) of the sessions that have frames, by name, the mean where one has several."""
    pairs = np.unique(np.stack([frames.session, frames.baseline], axis=1), axis=0)
    return {
        frames.sessions[session]: frames.baseline_mean[pairs[pairs[:, 0] == session, 1]].mean(axis=0)
        for session in np.unique(pairs[:, 0])
    }


def strong_readings(frames: Frames) -> list[float]:
    """Counts above baseline that one in a hundred readings of the live sensors exceeds, of two recordings.

    They are the weakest and the strongest of those of an object, by at most 2,000 of the training anchors.
    """
    empty = frames.classes.index(EMPTY_HAND) if EMPTY_HAND in frames.classes else -1
    anchors = np.flatnonzero(frames.anchor & (frames.side == TRAIN) & (frames.label != empty))
    some = anchors[np.linspace(0, len(anchors) - 1, min(len(anchors), STRONG_FRAMES)).astype(int)]
    readings, recording = frames.inputs(some, "counts")[:, frames.live], frames.recording[some]
    strong = [np.quantile(readings[recording == number], 1 - STRONG_SHARE) for number in np.unique(recording)]
    return [float(min(strong)), float(max(strong))]


def load_classifier(path: str | Path | BinaryIO) -> tuple[Classifier, Content]:
    """The classifier in evaluation mode, and the content of the file that `save_classifier` wrote.

    Raises:
        UserError: the file is something else, damaged, altered, or of an earlier version.
    """
    name = path if isinstance(path, str | Path) else "the classifier"
    try:
        with Path(path).open("rb") if isinstance(path, str | Path) else nullcontext(path) as stream:
            if stream.read(2) != ARCHIVE_START:
                raise UserError(f"{name}: no classifier; {EXPECTED}")
            size = stream.seek(0, io.SEEK_END)
            with zipfile.ZipFile(stream) as archive:
                if sum(member.file_size for member in archive.infolist()) > size:
                    raise ValueError("its archive is compressed, or names a part many times")
            stream.seek(0)
            content = torch.load(stream, map_location="cpu", weights_only=True)
        if not isinstance(content, dict) or not {"model", "classes"} <= content.keys():
            raise UserError(f"{name}: no classifier, but other weights or values; {EXPECTED}")
        if content.get("format") != FORMAT:
            raise UserError(f"{name}: no classifier of this version; train it again (`dvc repro`, or fit and save)")
        _check(content, set())
        checked = Content(**content)
        return _built(checked), checked
    except (UserError, FileNotFoundError, PermissionError):
        raise
    except Exception as error:  # of a file from outside anything may be wrong
        reason = f"{type(error).__name__}: {' '.join(str(error).split()).partition('. ')[0]}"
        if isinstance(error, ValidationError):
            first = error.errors(include_url=False, include_input=False)[0]
            reason = ": ".join(filter(None, (".".join(map(str, first["loc"])), first["msg"])))
        raise UserError(
            f"{name}: damaged, altered, or no classifier of this version ({reason}); train it again"
        ) from error


def _built(content: Content) -> Classifier:
    """The classifier; a ValueError where it has learnt something else than its kind does."""
    live = content.preprocessing.live
    height, width = live.shape
    parts = content.viewpoints, len(content.classes), content.model, (height, width)
    with torch.device("meta"):  # where weights take no memory
        expected = build_classifier(*parts)
    if isinstance(expected, torch.nn.Module):
        shapes = {name: weights.shape for name, weights in expected.state_dict().items()}
        if {name: weights.shape for name, weights in content.learnt.items()} != shapes:
            raise ValueError("its weights are those of another network")
    elif not np.array_equal(content.learnt["live"], live):
        raise ValueError("it has learnt other sensors")
    classifier = build_classifier(*parts)
    classifier.load_state_dict(content.learnt)
    return classifier.eval() if isinstance(classifier, torch.nn.Module) else classifier


def _check(value: Any, seen: set[int]) -> None:
    """A ValueError for a number that is not finite, and where few bytes of a file stand for many numbers.

    Such are a tensor that shows the same memory several times, and a list that stands in several places.
    """
    if isinstance(value, dict | list):
        if id(value) in seen:
            raise ValueError("a list or mapping stands in several places")
        seen.add(id(value))
        for part in value.values() if isinstance(value, dict) else value:
            _check(part, seen)
    elif isinstance(value, Tensor):
        if not value.is_contiguous():
            raise ValueError("a tensor is not stored number by number")
        if not value.isfinite().all():
            raise ValueError("a number is not finite")
    elif not isinstance(value, int | float | str | None) or (isinstance(value, float) and not math.isfinite(value)):
        raise ValueError(f"{value!r:.40} is no plain value")
