"""The file of a trained classifier: what it has learnt, and all that is needed to use it on raw counts.

It holds tensors and plain values, read with `weights_only=True`: loading runs no code. Its last bytes are a digest of
all others, so that damage anywhere is noticed. It also holds a few recordings of the training and the answers to them,
which must come out again when it is loaded: a file whose values were altered, or which this version's code reads
differently, is refused.
"""

import hashlib
import io
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, BinaryIO, Literal, Self, cast

import numpy as np
import torch
from annotated_types import Interval, MaxLen, MinLen
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer, ValidationError, model_validator
from torch import Tensor

from tactile_viewgcn.device import select_device
from tactile_viewgcn.files import atomic_write, in_one_line
from tactile_viewgcn.messages import EMPTY_HAND
from tactile_viewgcn.nn.network import spread_frames
from tactile_viewgcn.params import MAX_NUMBER, Model, PreprocessSection
from tactile_viewgcn.recognition.calibration import Temperature, recording_answer
from tactile_viewgcn.recognition.classifier import Classifier, build_classifier
from tactile_viewgcn.schema import Unique
from tactile_viewgcn.tables.frames import TRAIN, Frames, network_input

REMEDY = "name a file such as models/classifier.pt, or train again (`dvc repro`, or fit and save)"
EXAMPLES, EXAMPLE_FRAMES = 3, 8  # stored recordings, and frames of each
MOST_FRAMES = 2**14  # of an example whose frames are repeated
CLOSE = {"float32": 1e-3, "bfloat16": 0.1}  # by precision, difference of probabilities between two processors
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


@dataclass(frozen=True)
class FittedPreprocessing:
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

    params: PreprocessSection
    kept_share: float
    dtype: Literal["int16", "int32", "float32", "float64"]
    strong_readings: list[float]
    live: Array
    noise: Array
    baselines: dict[str, Array]

    @classmethod
    def of(cls, frames: Frames) -> Self:
        """The preprocessing that made the frames; a session of several baselines has their mean."""
        train, dtype = frames.on(TRAIN), cast(Any, str(frames.counts.dtype))
        pairs = np.unique(np.stack([frames.session[train], frames.baseline[train]], axis=1), axis=0)
        baselines = {
            frames.sessions[session]: frames.baseline_mean[pairs[pairs[:, 0] == session, 1]].mean(axis=0)
            for session in np.unique(pairs[:, 0])
        }
        params, noise = PreprocessSection(**frames.preprocess), np.nan_to_num(frames.noise)
        return cls(params, frames.kept_share, dtype, strong_readings(frames), frames.live, noise, baselines)

    def mean_baseline(self) -> np.ndarray:
        """Mean (H, W) of the baselines of the training's sessions."""
        return np.mean(list(self.baselines.values()), axis=0)


class Content(BaseModel):
    """What a file holds, see `save_classifier`.

    Attributes:
        examples: counts (R, T, H, W) of frames in contact of a few training recordings.
        answers: (R, classes) class probabilities of the examples, above the training's mean baseline.
    """

    model_config = ConfigDict(extra="forbid", arbitrary_types_allowed=True, hide_input_in_errors=True)
    format: Literal[14] = 14  # add 1 when the content of a file changes
    learnt: dict[str, Any]
    viewpoints: Annotated[Tensor, MinLen(1), MaxLen(MOST_VIEWS)]
    model: Model
    classes: Annotated[list[str], MinLen(2), MaxLen(2**15), Unique]
    transform: Literal["clip", "log", "counts"]
    scale: Annotated[float, Interval(gt=0, le=MAX_NUMBER)]
    precision: Literal["float32", "bfloat16"]
    temperature: Temperature | None
    preprocessing: FittedPreprocessing
    examples: Array
    answers: Array

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        """What the examples do not show: how contact is found."""
        fitted, (weak, strong) = self.preprocessing, self.preprocessing.strong_readings
        decided = "auto" not in vars(fitted.params).values() and weak <= strong
        if not (decided and fitted.noise.shape == fitted.live.shape and (fitted.noise >= 0).all()):
            raise ValueError("preprocessing: not decided, or out of range")
        return self

    def answer(self, classifier: Classifier, excess: np.ndarray) -> tuple[np.ndarray, int]:
        """`recording_answer` of frames in contact, counts (n, H, W) above baseline, in the order of time."""

        def values_of(index: np.ndarray) -> Any:
            return classifier.frame_values(network_input(excess[index], self.transform, self.scale))

        return recording_answer(classifier, self.temperature, values_of, len(excess))

    def answers_now(self, classifier: Classifier) -> np.ndarray:
        """The classifier's `answers` to the examples, whose frames are repeated until they are a whole recording."""
        count = EXAMPLE_FRAMES
        while count < min(getattr(classifier, "short", 0), MOST_FRAMES):
            count *= 2
        frames = self.examples[:, spread_frames(EXAMPLE_FRAMES, count)]
        excess = frames - self.preprocessing.mean_baseline()
        return np.exp([self.answer(classifier, each)[0] for each in excess])

    def classifier(self) -> Classifier:
        """The classifier with what it has learnt, ready for answers; any exception for parts that do not fit."""
        live, (height, width) = self.preprocessing.live, self.preprocessing.live.shape
        with torch.device("meta"):  # where weights take no memory and no random numbers
            classifier = build_classifier(self.viewpoints, len(self.classes), self.model, (height, width))
        if isinstance(classifier, torch.nn.Module):
            classifier.load_state_dict(self.learnt, assign=True)
        else:
            classifier.load_state_dict(_converted(self.learnt, Tensor, Tensor.numpy), live)
        classifier.prepare(select_device("cpu", self.precision))
        return classifier


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
    values = {
        "learnt": _converted(learnt, Tensor, lambda weights: weights.cpu().contiguous()),  # of any device and order
        "viewpoints": torch.as_tensor(classifier.viewpoints).cpu(),
        "model": model,
        "classes": frames.classes,
        "transform": classifier.transform or frames.transform,
        "scale": frames.scale,
        "precision": precision,
        "temperature": temperature,
        "preprocessing": FittedPreprocessing.of(frames),
        "examples": _examples(frames),
        "answers": np.zeros(0),
    }
    content = Content.model_validate(values)
    content.answers = content.answers_now(content.classifier())
    write_content(path, content)


def write_content(path: str | Path, content: Content) -> None:
    """Write a classifier's file, and its digest at the end."""
    file = io.BytesIO()  # a file's name would be written into it
    torch.save(content.model_dump(), file)
    with atomic_write(path) as part:
        part.write_bytes(file.getvalue() + hashlib.sha256(file.getbuffer()).digest())


def _converted(state: Any, kind: type, convert: Callable[[Any], Any]) -> Any:
    """Nested mappings with their values of that kind converted."""
    if isinstance(state, dict):
        return {name: _converted(each, kind, convert) for name, each in state.items()}
    return convert(state) if isinstance(state, kind) else state


def _examples(frames: Frames) -> np.ndarray:
    """Counts (3, 8, H, W) of recordings that are evenly spread over the training side, and of frames over each."""
    train = frames.on(TRAIN)
    numbers = np.unique(frames.recording[train])
    rows = (train[frames.recording[train] == number] for number in numbers[spread_frames(len(numbers), EXAMPLES)])
    return np.stack([frames.counts[index[spread_frames(len(index), EXAMPLE_FRAMES)]] for index in rows])


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
        try:
            content = Content.model_validate(torch.load(packed, map_location="cpu", weights_only=True))
        except ValidationError as error:
            raise ValueError(str(error).partition(" [type=")[0]) from None
        classifier = content.classifier()
        if not np.abs(content.answers_now(classifier) - content.answers).max() <= CLOSE[content.precision]:
            raise ValueError("the answers to its own recordings do not come out again")
        return classifier, content
