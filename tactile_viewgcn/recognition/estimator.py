"""The interface of scikit-learn: a classifier of recordings in memory, trained as the stages do."""

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
from sklearn.utils.validation import check_consistent_length, check_is_fitted, column_or_1d

from tactile_viewgcn.device import select_device
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.live.stream import LONGEST, LiveStream
from tactile_viewgcn.messages import (
    EMPTY_HAND,
    Note,
    UserError,
    listed,
    shown,
    warnings_of,
)
from tactile_viewgcn.params import Params, SensorMember, default_params, on_sensors, preset_changes
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.readers.source import FRAMES_LAST, Recording
from tactile_viewgcn.recognition.arguments import check_params, distinct_labels, numbers_by_name
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.raw_counts import check_layouts
from tactile_viewgcn.recognition.recogniser import Recogniser, recording_of
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.tables.look import groups_together, look_at
from tactile_viewgcn.tables.recordings import NO_SESSION, Recordings, in_memory
from tactile_viewgcn.tables.remarks import remarks
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints


class TactileClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # has no types
    """A classifier of objects in tactile recordings: any system or preset, trained in memory.

    X holds recordings of raw counts. As in the pipeline, the baseline is subtracted and the frames
    in contact are found. X is one of these:

    - a list of arrays (T_i, H, W), or of channels over time (T_i, C);
    - one array (n, T, H, W) or (n, T, C);
    - a list of DataFrames. Columns named as times, numbers or labels are left out, as they are of a
      file. So are the columns that `data.columns` leaves out.

    If you set the parameter `data.shape` to `frames_last`, time is the last axis, as in an array
    (n, C, T) of aeon and sktime.

    Args:
        preset: a name that `tactile-viewgcn preset` takes. It is `best` if neither a preset nor a
            system is named.
        system: a value of `model.system`, or a member of `sensors`. It changes the preset, or the
            paper's recipe if no preset is named. `network` is the preset of this name, which trains
            for minutes; in memory `best` does not use it. No other preset can be named with it.
        views: V, the number of frames in a network's view set.
        params: values by dotted key of params.yaml, such as `{"preprocess.transform": "log"}`. They
            replace all other values.
        random_state: the source of every random choice: an integer, a `RandomState` of NumPy, or
            None.

    Attributes:
        classes_: (Y,) labels, sorted.
        params_: all parameters of the training.
        notes_: what was chosen for the training data, what was left out, and what spoils the
            result, each with its reason.
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

    def fit(self, X: Any, y: Any, groups: Any = None, sessions: Any = None) -> "TactileClassifier":
        """Train on recordings and their labels.

        Like the stages, it warns you of what spoils the result: recordings that are copies of each
        other, channels that are no sensors, an offset of a recording that predicts its object.

        Args:
            X: n recordings.
            y: (n,) labels.
            groups: (n,) group of each recording. A group is held out as a whole: for the choice of
                `best`, for the calibration and for `split.validation`. None means that each
                recording is a group of its own.
            sessions: (n,) session of each recording, such as a day. The recordings of a session
                share the empty hand, whose label is `empty_hand`. None means that all are of one
                session.

        Returns:
            The classifier itself.

        Raises:
            UserError, ValueError: an argument is wrong; the message is one line.
        """
        params = self._parameters()
        recorded = self._recordings(X)
        y = column_or_1d(y, warn=True)
        check_consistent_length(recorded, y)
        classes, labels = distinct_labels(y)
        group = np.arange(len(y))
        if groups is not None:
            group, _ = numbers_by_name("group", groups, len(y))
        session = np.zeros(len(y), dtype=np.int64)
        session_names = [NO_SESSION]
        if sessions is not None:
            session, session_names = numbers_by_name("session", sessions, len(y))
        check_layouts(recorded)
        recordings = in_memory(recorded, list(map(str, classes)), labels, session, session_names)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "classifier.pt"
            notes = train(recordings, params, group[recordings.columns["recording"]], path)
            self.recogniser_ = Recogniser(path)
        self.classes_ = classes
        self.params_ = params
        self.notes_ = notes
        for note in warnings_of(notes):
            warnings.warn(shown(note.text), stacklevel=2)
        return self

    def predict_proba(self, X: Any, empty_hand: Any = None) -> np.ndarray:
        """Return class probabilities float32 (n, Y) of recordings, a column for each of `classes_`.

        It refuses the same things as the command `predict`, and repeats its warnings. A recording
        without contact is answered with the empty hand, also if an object is held so weakly, or
        from the first frame to the last, that it is taken for an open hand. If the empty hand is no
        class, you are warned.

        Args:
            X: n recordings.
            empty_hand: recordings of the empty hand in the session of X, with five frames or more.
                They are needed if the open hand does not read as in the training, as on a new day.
                Fewer frames are not used, and you are warned.
                With None each recording is answered from its own frames.

        Raises:
            NotFittedError: `fit` was not called.
            UserError: X or the empty hand has another form, layout or scale than in training.
        """
        check_is_fitted(self, "recogniser_")
        recogniser = self.recogniser_
        recordings = self._new_recordings(X, "X")
        of_empty_hand = list[Recording]()
        if empty_hand is not None:
            of_empty_hand = self._new_recordings(empty_hand, "empty_hand")
        answers, notes = recogniser.answer_recordings(recordings, of_empty_hand)
        texts = [note.text for note in warnings_of(notes)]
        without = [answer.recording for answer in answers if not answer.contact]
        if without and EMPTY_HAND not in recogniser.classes:
            texts.append(
                f"no frame in contact: {listed(without)}; their classes are equally probable"
            )
        for text in texts:
            warnings.warn(shown(text), stacklevel=2)
        names = list(map(str, self.classes_))
        probabilities = np.zeros((len(recordings), len(names)), dtype=np.float32)
        columns = [names.index(name) for name in recogniser.classes]
        probabilities[:, columns] = [answer.probabilities for answer in answers]
        return probabilities

    def predict(self, X: Any, empty_hand: Any = None) -> np.ndarray:
        """Return the most probable of `classes_` (n,) for recordings; see `predict_proba`."""
        best = self.predict_proba(X, empty_hand).argmax(axis=1)
        labels: np.ndarray = self.classes_[best]
        return labels

    def stream(
        self,
        *,
        sure: float | None = None,
        longest: int = LONGEST,
        every: int = 1,
        tare: bool = False,
    ) -> LiveStream:
        """Return a stream that answers frames as they come, while the hand still holds the object.

        The updates name objects as texts.

        Args:
            sure: an answer of this probability or more is final and closes the grasp early. With
                None no grasp is closed early.
            longest: a grasp is closed after this number of frames in contact.
            every: number of frames in contact from one provisional answer to the next.
            tare: whether the first five frames that read alike count as the open hand, whatever the
                open hand read in the training.

        Raises:
            NotFittedError: `fit` was not called.
            UserError: an option is out of its range.
        """
        check_is_fitted(self, "recogniser_")
        return self.recogniser_.stream(sure=sure, longest=longest, every=every, tare=tare)

    def save(self, path: str | Path) -> None:
        """Write a file like the pipeline's models/classifier.pt, for `load` and `predict`.

        The file holds the classes as texts.

        Args:
            path: of the file.

        Raises:
            NotFittedError: `fit` was not called.
        """
        check_is_fitted(self, "recogniser_")
        self.recogniser_.content.write(path)

    @classmethod
    def load(cls, path: str | Path) -> "TactileClassifier":
        """Return the classifier of a file that `save` or the pipeline wrote, to predict with.

        Its labels are texts.

        Args:
            path: of the file.

        Raises:
            UserError, OSError: there is no such file, or this version cannot read it.
        """
        classifier = cls()
        classifier.recogniser_ = Recogniser(path)
        classifier.classes_ = np.array(classifier.recogniser_.classes)
        return classifier

    def _new_recordings(self, X: Any, name: str) -> list[Recording]:
        """Return the recordings of an argument of `predict`, which must not be a single one."""
        recordings = self._recordings(X, name)
        shape = self.recogniser_.shape
        is_one_recording = isinstance(X, np.ndarray) and X.shape[1:] == shape
        # with one row of sensors, X is n recordings of one frame, as in `fit`
        if is_one_recording and shape[0] > 1:
            raise UserError(
                f"{name} {X.shape} is one recording; "
                f"expected a list: [{name}], or [*{name}] of single frames"
            )
        return recordings

    def _recordings(self, X: Any, name: str = "X") -> list[Recording]:
        """Return the recordings of the argument of this name, one or more; see `recording_of`."""
        is_array = isinstance(X, np.ndarray) and X.ndim > 0
        if not (is_array or isinstance(X, list | tuple)) or not len(X):
            raise UserError(
                f"{name} is of type {type(X).__name__} and holds no recordings; expected a list of "
                "arrays or DataFrames, each (frames, rows, columns) or (frames, channels)"
            )
        params = self.params or {}
        shape = params.get("data.shape", "auto")
        if shape not in ("auto", FRAMES_LAST):
            raise UserError(
                f"data.shape is {shape}; here expected auto or {FRAMES_LAST}. "
                "Reshape each recording to (frames, rows, columns) instead"
            )
        frames_last = shape == FRAMES_LAST
        columns = params.get("data.columns", ())
        return [
            recording_of(row, f"{name}[{number}]", frames_last=frames_last, columns=columns)
            for number, row in enumerate(X)
        ]

    def _parameters(self) -> Params:
        """Return all parameters of the training."""
        check_params(self.params)
        seed = self.random_state
        if seed is None or isinstance(seed, np.random.RandomState):
            seed = check_random_state(seed).randint(2**31 - 1)
        changes = {"seed": seed, "views": self.views}
        if self.system in get_args(SensorMember):
            changes["model.system"] = "sensors"
            changes["model.members"] = [self.system]
        elif self.system not in (None, "network"):
            changes["model.system"] = self.system
        changes |= self.params or {}
        texts = self._preset_changes()
        for key, value in changes.items():
            if isinstance(value, np.generic):
                value = value.item()
            texts.append(as_change(key, value))
        return default_params(tuple(texts), type(self).__name__)

    def _preset_changes(self) -> list[str]:
        """Return what the preset changes in the paper's recipe; nothing if a system is named."""
        if self.preset is not None:
            is_another = self.preset != "network"
            if self.system == "network" and is_another:
                raise UserError(
                    f"preset is {self.preset!r} and system is 'network', which is a preset too; "
                    "leave one of them out"
                )
            return list(preset_changes(self.preset))
        if self.system is None:
            return list(preset_changes("best"))
        if self.system == "network":
            return list(preset_changes("network"))
        return []


def train(recordings: Recordings, params: Params, groups: np.ndarray, path: Path) -> list[Note]:
    """Train a classifier on all recordings and write its file.

    It makes the same remarks and the same leak check as the stages. torch's default generator stays
    as it was.

    Args:
        recordings: T frames.
        params: all parameters.
        groups: (T,) split group of each frame. A group is held out as a whole: for the choice of
            `best`, for the calibration and for `split.validation`. Groups whose recordings have
            frames in common become one group.
        path: of the file.

    Returns:
        Notes on what was chosen for the recordings, what was left out, and what spoils the result,
            each with its reason.

    Raises:
        UserError: no sensor varies; the recordings lack the baseline or the flags that the
            parameters want; fewer than two classes are left; or the training diverges.
    """
    seed = params.seed
    compute = select_device(params.device, params.precision)
    look = look_at(recordings)
    notes = remarks(recordings, look)
    groups = groups_together(recordings, look, groups)
    made = preprocess_recordings(recordings, params.preprocess, params.split, groups=groups)
    notes += made.notes
    frames = made.frames
    with_backbone = not on_sensors(params.model.system)
    clustering = params.cluster
    if not with_backbone:
        clustering = replace(clustering, method="none")
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
