"""scikit-learn's interface: a classifier of recordings in memory, trained by the steps of the stages."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args

import numpy as np
import torch
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import check_random_state
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_consistent_length, check_is_fitted, column_or_1d

from tactile_viewgcn.device import select_device
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.frames.split import one_class
from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, shown, warnings_of
from tactile_viewgcn.params import Params, SensorMember, default_params, on_sensors, preset_changes
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.readers.source import FRAMES_LAST, Recording, tidy
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.raw_counts import check_layouts
from tactile_viewgcn.recognition.recogniser import Recogniser, recording_of
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.tables.look import groups_together, look_at
from tactile_viewgcn.tables.recordings import Recordings, in_memory
from tactile_viewgcn.tables.remarks import remarks
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints


class TactileClassifier(ClassifierMixin, BaseEstimator):
    """A classifier of objects in tactile recordings: any system or preset of the pipeline, trained in memory.

    X holds recordings of raw counts, whose baseline is subtracted and whose frames in contact are
    found as in the pipeline. It is a list of arrays (T_i, H, W), or of channels over time (T_i, C);
    or one array (n, T, H, W) or (n, T, C). Of a DataFrame the columns that are called times,
    numbers or labels are left out, as of a file, and those that `data.columns` leaves out. With the
    parameter `data.shape` `frames_last` time is the last axis, as in an array (n, C, T) of aeon and
    sktime.

    Args:
        preset: a name of `tactile-viewgcn preset`; `best` if `system` is None too.
        system: a value of `model.system`, or a member of `sensors`; on top of the preset, else of
            the paper's recipe. `network` is the preset of this name, which trains for minutes: in
            memory `best` does not ask it.
        views: V, the frames of a network's view set.
        params: values by dotted key of params.yaml, on top of all others, such as
            `{"preprocess.transform": "log"}`.
        random_state: source of every random choice: an integer, a `RandomState` of NumPy, or None.

    Attributes:
        classes_: (Y,) labels, sorted.
        params_: all parameters of the training.
        notes_: what was chosen for the training data, what was left out, what spoils the result,
            and why.
        recogniser_: the trained `Recogniser`.
    """

    def __init__(
        self,
        preset: str | None = None,
        system: str | None = None,
        *,
        views: int = 8,
        params: Mapping[str, Any] | None = None,
        random_state: Any = 0,
    ):
        self.preset = preset
        self.system = system
        self.views = views
        self.params = params
        self.random_state = random_state

    def fit(self, X: Any, y: Any, groups: Any = None) -> "TactileClassifier":
        """Train on recordings X and their labels y (n,).

        What spoils the result is warned of as by the stages: recordings that are copies, channels
        that are no sensors, an offset of a recording that predicts its object.

        Args:
            groups: (n,) group of each recording; a group is held out as a whole, for the choice of
                `best`, calibration and `split.validation`. None: each recording is a group.

        Raises:
            UserError, ValueError: a wrong argument, in one line.
        """
        params = self._parameters()
        recorded, y = self._recordings(X), column_or_1d(y, warn=True)
        check_consistent_length(recorded, y)
        classes, labels = _distinct(y)
        groups = np.arange(len(y)) if groups is None else np.asarray(groups)
        if groups.shape != (len(y),):
            raise UserError(
                f"groups has shape {groups.shape}; expected ({len(y)},), a group for each recording of X"
            )
        group = np.unique(groups, return_inverse=True)[1]
        check_layouts(recorded)
        recordings = in_memory(recorded, list(map(str, classes)), labels, 0 * labels)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "classifier.pt"
            notes = train(recordings, params, group[recordings.columns["recording"]], path)
            self.recogniser_ = Recogniser(path)
        self.classes_, self.params_, self.notes_ = classes, params, notes
        for note in warnings_of(notes):
            warnings.warn(shown(note.text), stacklevel=2)
        return self

    def predict_proba(self, X: Any) -> np.ndarray:
        """Class probabilities float32 (n, Y) of recordings X, a column for each of `classes_`.

        What the command `predict` refuses or warns of, this does too. A recording without contact
        is the empty hand; where that is no class, a warning says so.

        Raises:
            NotFittedError: before `fit`.
            UserError: X of a different form, layout or scale than in training.
        """
        check_is_fitted(self, "recogniser_")
        recogniser, names = self.recogniser_, list(map(str, self.classes_))
        recordings = self._recordings(X)
        is_one_recording = isinstance(X, np.ndarray) and X.shape[1:] == recogniser.shape
        # else it is n recordings of one frame, as in `fit`
        if is_one_recording and recogniser.shape[0] > 1:
            raise UserError(
                f"X {X.shape} is one recording; expected a list: [X], or [*X] of single frames"
            )
        answers, notes = recogniser.answer_recordings(recordings)
        none = [
            answer.recording
            for answer in answers
            if not answer.contact and EMPTY_HAND not in recogniser.classes
        ]
        texts = [note.text for note in warnings_of(notes)]
        texts += [
            f"no frame in contact: {listed(none)}; their classes are equally probable"
        ] * bool(none)
        for text in texts:
            warnings.warn(shown(text), stacklevel=2)
        probabilities = np.zeros((len(recordings), len(names)), dtype=np.float32)
        columns = [names.index(name) for name in recogniser.classes]
        probabilities[:, columns] = [answer.probabilities for answer in answers]
        return probabilities

    def predict(self, X: Any) -> np.ndarray:
        """The most probable of `classes_` (n,) for recordings X; see `predict_proba`."""
        best = self.predict_proba(X).argmax(axis=1)
        return self.classes_[best]

    def save(self, path: str | Path) -> None:
        """Write a file like the pipeline's models/classifier.pt, which `load` and the command `predict` read.

        Its classes are the texts of `classes_`.

        Raises:
            NotFittedError: before `fit`.
        """
        check_is_fitted(self, "recogniser_")
        self.recogniser_.content.write(path)

    @classmethod
    def load(cls, path: str | Path) -> "TactileClassifier":
        """The classifier of a file of `save` or of the pipeline, to predict with; its labels are texts.

        Raises:
            UserError, OSError: no such file, or none of this version.
        """
        classifier = cls()
        classifier.recogniser_ = Recogniser(path)
        classifier.classes_ = np.array(classifier.recogniser_.classes)
        return classifier

    def _recordings(self, X: Any) -> list[Recording]:
        """The recordings of X, one or more, see `recording_of`."""
        rows = [*X] if isinstance(X, list | tuple) or (isinstance(X, np.ndarray) and X.ndim) else []
        if not rows:
            raise UserError(
                f"X is of type {type(X).__name__} and holds no recordings; expected a list of arrays or DataFrames, "
                "each (frames, rows, columns) or (frames, channels)"
            )
        params = self.params or {}
        last, columns = params.get("data.shape") == FRAMES_LAST, params.get("data.columns", ())
        return [
            recording_of(row, f"X[{number}]", frames_last=last, columns=columns)
            for number, row in enumerate(rows)
        ]

    def _parameters(self) -> Params:
        """All parameters of the training."""
        if not isinstance(self.params, Mapping | None):
            raise UserError(
                f"params is {self.params!r}; expected a mapping of keys of params.yaml to values, or None"
            )
        seed = self.random_state
        if seed is None or isinstance(seed, np.random.RandomState):
            seed = check_random_state(seed).randint(2**31 - 1)
        changes = {"seed": seed, "views": self.views}
        if self.system in get_args(SensorMember):
            changes |= {"model.system": "sensors", "model.members": [self.system]}
        elif self.system not in (None, "network"):
            changes["model.system"] = self.system
        changes |= self.params or {}
        plain = {
            key: value.item() if isinstance(value, np.generic) else value
            for key, value in changes.items()
        }
        preset = (
            {None: "best", "network": "network"}.get(self.system)
            if self.preset is None
            else self.preset
        )
        texts = preset_changes(preset) if preset is not None else []
        return default_params(
            (*texts, *(as_change(*item) for item in plain.items())), type(self).__name__
        )


def train(recordings: Recordings, params: Params, groups: np.ndarray, path: Path) -> list[Note]:
    """Train a classifier on all recordings and write its file; torch's default generator is left as it was.

    The remarks on the recordings and the leak check are those of the stages.

    Args:
        groups: (T,) split group of each frame; a group is held out as a whole, for the choice of
            `best`, calibration and `split.validation`. Groups whose recordings have frames in
            common are one group.

    Returns:
        Notes on what was chosen for the recordings, what was left out, what spoils the result, and
            why.

    Raises:
        UserError: no sensor that varies; a baseline or flags that the recordings cannot give; fewer
            than two classes left; a training that diverges.
    """
    seed, compute = params.seed, select_device(params.device, params.precision)
    with_backbone = not on_sensors(params.model.system)
    look = look_at(recordings)
    notes = remarks(recordings, look)
    groups = groups_together(recordings, look, groups)
    made = preprocess_recordings(recordings, params.preprocess, params.split, groups=groups)
    frames, notes = made.frames, notes + made.notes
    clustering = params.cluster if with_backbone else replace(params.cluster, method="none")
    places = viewpoints(params.views, params.viewpoints, seed)
    views = cluster_frames(frames, places, clustering, stream(seed, "cluster"))
    pretrained: dict[str, Any] = {}
    with torch.random.fork_rng():
        if with_backbone:
            backbone, linear, _ = pretrain_backbone(frames, params, compute)
            pretrained = {
                "backbone": backbone.cpu().state_dict(),
                "classifier": linear.cpu().state_dict(),
            }
        fitted = fit_classifier(frames, views, pretrained, params, compute, ask_network=False)
    save_classifier(
        path, fitted.classifier, fitted.model, frames, compute.precision, fitted.temperature
    )
    return notes + fitted.notes


def _distinct(y: Any) -> tuple[np.ndarray, np.ndarray]:
    """Distinct labels (Y,), sorted, and the index (n,) of each recording's label."""
    try:
        # of many objects of two recordings each
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            check_classification_targets(y)
        if y.dtype.kind in "UO":
            y = np.array(
                [tidy(label) if isinstance(label, str) else label for label in y], y.dtype.kind
            )
        classes, labels = np.unique(y, return_inverse=True)
    except TypeError:  # the labels have no order
        raise UserError(
            "y holds labels of different kinds; expected texts, or whole numbers"
        ) from None
    if len(classes) < 2:
        raise UserError(one_class(classes[0], "y has"))
    return classes, labels
