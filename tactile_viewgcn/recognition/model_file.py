"""The file of a trained classifier: what it has learnt, and what it needs to answer raw counts.

The file holds tensors and plain values, and is read with `weights_only=True`, so loading runs no
code. Its last bytes are a digest of all other bytes, so any damage is noticed. It has a format
number, see `model_format`.

The file also holds a few frames of three training recordings, and the answers to them. These are
answers to whole recordings; a classifier on the sensors also answers view sets of every size. When
the file is loaded, the same answers must come out again. A file is therefore refused if its values
were altered so that one of these answers changes, or if this version's code reads it differently.
An altered value that changes none of these answers is not noticed.
"""

import hashlib
import io
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import numpy as np
import torch
from pydantic import Field
from pydantic.dataclasses import dataclass
from scipy.special import softmax
from torch import Tensor

from tactile_viewgcn.device import select_device
from tactile_viewgcn.files import readable, write_file
from tactile_viewgcn.members.network import NETWORK
from tactile_viewgcn.nn.network import ViewNetwork, spread_frames
from tactile_viewgcn.params import (
    Cluster,
    Model,
    default_params,
    on_sensors,
    preset_changes,
)
from tactile_viewgcn.recognition.calibration import Classifier, recording_answer
from tactile_viewgcn.recognition.model_format import FORMAT, package_version, upgraded
from tactile_viewgcn.systems import load_system, system_class
from tactile_viewgcn.tables.frames import TRAIN, Frames, network_input
from tactile_viewgcn.tables.plan import ARRAYS, Plan
from tactile_viewgcn.views.recording_clusters import RecordingClusters
from tactile_viewgcn.views.sampling import powers_of_two

if TYPE_CHECKING:
    from tactile_viewgcn.systems.sensors import SensorClassifier

UNFIT = (
    "no classifier of this version, damaged or altered",
    "name a file such as models/classifier.pt, "
    "or train again by the line that `tactile-viewgcn inspect` prints",
)
EXAMPLES = 3  # stored recordings
EXAMPLE_FRAMES = 8  # of each
# by precision, how much probabilities can differ between two processors
CLOSE = {"float32": 1e-3, "bfloat16": 0.1}
DIGEST = hashlib.sha256().digest_size


def build_classifier(
    viewpoints: Tensor, classes: int, model: Model, shape: tuple[int, int]
) -> ViewNetwork:
    """Return the network of a system on the backbone, with torch's default weights.

    Args:
        viewpoints: (V, 3).
        classes: number of classes.
        model: the options of the network.
        shape: (H, W) of a frame.
    """
    return ViewNetwork(system_class(model.system), viewpoints, classes, model, shape)


@dataclass(config=ARRAYS)
class Content:
    """What a file holds, see `save_classifier`; in the file the arrays are tensors.

    Attributes:
        examples: counts (R, T, H, W) of frames in contact of a few training recordings.
        answers: (R, S, classes) class probabilities of the examples, from their counts above the
            training's mean baseline. They are of one frame, of two and so on up to V, and of all
            frames.
        set_answers: (R, S - 1, classes) class probabilities of view sets of one frame, of two and
            so on up to V. None for a network, which has no further weights for view sets, and in a
            file of an earlier version.
        clusters: how a network clusters a whole recording, the same way as in its training. None if
            it does not cluster, and in a file of an earlier version. The networks of such a file
            were given sets that are spread over the recording.
        format: number of the file's layout, see `model_format`.
        version: the version of this package that wrote the file.
    """

    learnt: dict[str, Any]
    viewpoints: np.ndarray
    model: Model
    classes: list[str]
    transform: Literal["clip", "log", "counts"]
    scale: float
    precision: Literal["float32", "bfloat16"]
    temperature: Annotated[float, Field(ge=1e-3, le=1e3)] | None
    plan: Plan
    examples: np.ndarray
    answers: np.ndarray
    set_answers: np.ndarray | None = None
    clusters: Cluster | None = None
    format: int = FORMAT
    version: str = ""

    def answer(self, classifier: Classifier, excess: np.ndarray) -> np.ndarray:
        """Return the `recording_answer` (classes,) to frames in contact.

        Args:
            classifier: of this file.
            excess: counts (n, H, W) above baseline, in the order of time.
        """
        with np.errstate(all="ignore"):  # the caller checks whether the answer is finite
            inputs = self.inputs(excess)
            return self.answer_values(classifier, inputs, classifier.frame_values(inputs))

    def inputs(self, excess: np.ndarray) -> np.ndarray:
        """Return the network input float32 of counts above baseline, in their shape."""
        return network_input(excess, self.transform, self.scale)

    def answer_values(self, classifier: Classifier, inputs: np.ndarray, values: Any) -> np.ndarray:
        """Return the `recording_answer` (classes,) to frames whose values are known.

        Args:
            classifier: of this file.
            inputs: network input (n, H, W) of the frames, in the order of time.
            values: the classifier's values of these inputs.
        """
        points = inputs[:, self.plan.live]
        return recording_answer(classifier, self.temperature, values, points)

    def answers_now(self, classifier: Classifier) -> np.ndarray:
        """Return the `answers` that the classifier gives now.

        The frames of an example are repeated until they are as many as a whole recording has.
        """
        count = max(EXAMPLE_FRAMES, int(np.ceil(getattr(classifier, "short", 0))))
        parts = [
            spread_frames(EXAMPLE_FRAMES, size)
            for size in (*powers_of_two(classifier.views), count)
        ]
        excess = self.examples - self.plan.mean_baseline()
        return np.exp([[self.answer(classifier, each[part]) for part in parts] for each in excess])

    def set_answers_now(self, classifier: Classifier) -> np.ndarray | None:
        """Return the `set_answers` that the classifier gives now; None for a network."""
        if not on_sensors(self.model.system):
            return None
        sets = [
            spread_frames(EXAMPLE_FRAMES, size)[None] for size in powers_of_two(classifier.views)
        ]
        excess = self.examples - self.plan.mean_baseline()
        answers = list[list[np.ndarray]]()
        with np.errstate(all="ignore"):
            for frames in excess:
                values: Any = classifier.frame_values(
                    network_input(frames, self.transform, self.scale)
                )
                answers.append([softmax(classifier.view_sets(values, each)[0]) for each in sets])
        return np.array(answers)

    def check_answers(self, classifier: Classifier) -> None:
        """Raise an error unless every stored answer comes out again.

        Args:
            classifier: of this file.

        Raises:
            ValueError: an answer differs.
        """
        self._check(self.answers, self.answers_now(classifier))
        if self.set_answers is not None:
            self._check(self.set_answers, self.set_answers_now(classifier))

    def _check(self, stored: np.ndarray, now: np.ndarray | None) -> None:
        """Raise a ValueError unless two arrays of probabilities are about equal."""
        is_close = False
        if now is not None and stored.shape == now.shape:
            is_close = bool(np.abs(stored - now).max() <= CLOSE[self.precision])  # NaN gives False
        if not is_close:
            raise ValueError("the answers to its own recordings do not come out again")

    def classifier(self) -> Classifier:
        """Return the trained classifier, ready for answers.

        Raises:
            Exception: parts of the file do not fit together; any exception is possible.
        """
        classifier: Classifier
        if on_sensors(self.model.system):
            classifier = self._members()
        else:
            classifier = self._empty_network(self.model)
            learnt = _converted(self.learnt, np.ndarray, torch.from_numpy)
            classifier.load_state_dict(learnt, assign=True)
            classifier.transform = self.transform
            if self.clusters is not None:
                classifier.clusters = RecordingClusters(self.clusters)
        classifier.prepare(select_device("cpu", self.precision))
        return classifier

    def _members(self) -> "SensorClassifier":
        """Return the classifier on the sensors."""
        network = None
        if NETWORK in self.model.members:
            preset = default_params(tuple(preset_changes(NETWORK)))
            network = self._empty_network(preset.model)
        classifier: SensorClassifier = load_system(self.model.system).SensorClassifier.loaded(
            self.learnt,
            self.model.members,
            live=self.plan.live,
            viewpoints=self.viewpoints,
            classes=len(self.classes),
            network=network,
        )
        return classifier

    def _empty_network(self, model: Model) -> ViewNetwork:
        """Return a network to load weights into, without memory or random numbers for them."""
        viewpoints = torch.from_numpy(self.viewpoints)
        shape = self.plan.live.shape
        with torch.device("meta"):
            return build_classifier(viewpoints, len(self.classes), model, shape)

    def write(self, path: str | Path) -> None:
        """Write the file, and its digest at the end."""
        file = io.BytesIO()  # since `torch.save` would write a file's name into the file
        torch.save(_converted(asdict(self), np.ndarray, torch.from_numpy), file)
        content = file.getvalue()
        write_file(path, content + hashlib.sha256(content).digest())


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
        path: of the file.
        classifier: the trained classifier.
        model: the options that the classifier was built with.
        frames: the classifier's training data.
        precision: of the training.
        temperature: calibrates its answers to recordings; None if it is not calibrated.
    """
    clusters = None
    if isinstance(classifier, ViewNetwork) and classifier.clusters is not None:
        clusters = classifier.clusters.params
    content = Content(
        learnt=_converted(classifier.state_dict(), Tensor, _array),
        viewpoints=_array(torch.as_tensor(classifier.viewpoints)),
        model=model,
        classes=frames.classes,
        transform=cast(Any, classifier.transform or frames.transform),
        scale=frames.scale,
        precision=cast(Any, precision),
        temperature=temperature,
        clusters=clusters,
        plan=frames.plan,
        examples=_examples(frames),
        answers=np.zeros(0),
        version=package_version(),
    )
    trained = content.classifier()
    content.answers = content.answers_now(trained)
    content.set_answers = content.set_answers_now(trained)
    content.write(path)


def _array(weights: Tensor) -> np.ndarray:
    """Return weights, on any device and in any order of memory, as a contiguous array."""
    return weights.cpu().contiguous().numpy()


def _converted(state: Any, kind: type, convert: Callable[[Any], Any]) -> Any:
    """Return nested mappings in which the values of that kind are converted."""
    if isinstance(state, dict):
        return {name: _converted(value, kind, convert) for name, value in state.items()}
    if isinstance(state, kind):
        return convert(state)
    return state


def _examples(frames: Frames) -> np.ndarray:
    """Return counts (3, 8, H, W): eight frames of three training recordings, evenly spread."""
    recordings = frames.by_recording(frames.on(TRAIN))
    chosen = [recordings[number] for number in spread_frames(len(recordings), EXAMPLES)]
    return np.stack(
        [frames.counts[index[spread_frames(len(index), EXAMPLE_FRAMES)]] for index in chosen]
    )


def load_classifier(path: str | Path) -> tuple[Classifier, Content]:
    """Return the classifier, ready for answers, and the content of its file.

    Args:
        path: of a file that `save_classifier` wrote.

    Raises:
        UserError: the file is no classifier, is damaged or altered, or has an unknown format.
        OSError: the file cannot be opened.
    """
    stored = Path(path).read_bytes()
    with readable(path, *UNFIT):
        if hashlib.sha256(stored[:-DIGEST]).digest() != stored[-DIGEST:]:
            raise ValueError("its bytes and its digest differ")
        tensors = torch.load(io.BytesIO(stored), map_location="cpu", weights_only=True)
        values = upgraded(_converted(tensors, Tensor, Tensor.numpy), path)
        content = Content(**values)
        content.plan.check()
        classifier = content.classifier()
        content.check_answers(classifier)
        return classifier, content
