"""scikit-learn's interface: a classifier of arrays, which are recordings, view sets, or rows of sensors."""

import io
import warnings
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, get_args

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.utils import check_random_state
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_consistent_length, check_is_fitted, column_or_1d, validate_data

from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.frames.preprocessing import one_class
from tactile_viewgcn.messages import EMPTY_HAND, UserError, shown, warnings_of
from tactile_viewgcn.params import MAX_SIDE, Member, Params, default_params, preset_changes
from tactile_viewgcn.readers.source import FRAMES_LAST
from tactile_viewgcn.recognition.array_input import RECORDINGS, ROWS, checked_arrays, form_of, recordings_by_row
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.tables.recordings import ArrayRecordings

#: parameters for view sets and rows, which are frames in contact, above baseline
CHOSEN = {
    "preprocess.baseline": "none",
    "preprocess.zero": 0,
    "preprocess.filter": "none",
    "preprocess.contact_sensors": 1,
    "cluster.scope": "recording",
}


class TactileClassifier(ClassifierMixin, BaseEstimator):
    """A classifier of objects in tactile recordings: any system or preset of the pipeline, trained in memory.

    X is one of

    - a list of recordings, each raw counts (T_i, H, W): the baseline is subtracted and the frames in contact are found
      as in the pipeline; a row may be a list of several recordings of one object, which are answered together;
    - a list of channels over time (T_i, C); with the parameter `data.shape` `frames_last` (C, T_i), or an array
      (n, C, T), as aeon and sktime have them;
    - an array of view sets (n, V, H, W), counts above baseline of frames in contact;
    - an array (n, S), or anything that scikit-learn turns into one: each row is a frame of 1 x S sensors in contact,
      counts above baseline, up to 64 * 64 of them.

    Args:
        preset: a name of `tactile-viewgcn preset`; `best` if `system` is None too.
        system: a value of `model.system`, or a member of `sensors`; on top of the preset, else of the paper's recipe.
        views: V, frames by which a recording is classified; an array of view sets has its own V.
        params: values by dotted key of params.yaml, on top of all others, such as `{"preprocess.transform": "log"}`.
        random_state: source of every random choice: an integer, a `RandomState` of NumPy, or None.

    Attributes:
        classes_: (Y,) labels, sorted.
        params_: all parameters of the training.
        notes_: what was chosen for the training data, what was left out, and why.
        recogniser_: the trained `Recogniser`, which answers one view set or recording at a time.
        n_features_in_: S, for rows alone.
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
        """Train on rows of X and their labels y (n,).

        Args:
            groups: (n,) group of each row; a group is held out as a whole, for the choice of `best`, calibration and
                `split.validation`. None: each row is a group.

        Raises:
            UserError, ValueError: a wrong argument, in one line.
        """
        from tactile_viewgcn.recognition.training import train

        form = form_of(X, frames_last=self._frames_last)
        if form == ROWS:
            X, y = validate_data(self, X, y, dtype=(np.float64, np.float32))
            if X.shape[1] > MAX_SIDE**2:
                raise UserError(f"X has {X.shape[1]:,} columns; expected at most {MAX_SIDE**2:,} sensors")
            arrays, row = list(X[:, None, None]), np.arange(len(X))
        else:
            arrays, row = checked_arrays(recordings_by_row(X, frames_last=self._frames_last))
            y = column_or_1d(y, warn=True)
            check_consistent_length(X, y)
        classes, labels = _distinct(y)
        groups = np.arange(len(y)) if groups is None else np.asarray(groups)
        if groups.shape != (len(y),):
            raise UserError(f"groups has shape {groups.shape}; expected ({len(y)},), a group for each row of X")
        group, params = np.unique(groups, return_inverse=True)[1][row], self._parameters(form, arrays)
        session = np.zeros(len(arrays), dtype=int)
        recordings = ArrayRecordings(arrays, list(map(str, classes)), labels[row], session)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "classifier.pt"
            notes = train(recordings, params, group[recordings.columns["recording"]], path)
            self._file = path.read_bytes()
        self.classes_, self.params_, self.notes_, self._form = classes, params, notes, form
        self._load()
        for note in warnings_of(notes):
            warnings.warn(shown(note.text), stacklevel=2)
        return self

    def predict_proba(self, X: Any) -> np.ndarray:
        """Class probabilities float32 (n, Y) of rows of X, a column for each of `classes_`.

        Raises:
            NotFittedError: before `fit`.
            UserError, ValueError: X of a different form or layout than in training.
        """
        check_is_fitted(self, "recogniser_")
        if (form := form_of(X, frames_last=self._frames_last)) != self._form:
            raise UserError(f"X holds {form}; expected {self._form}, as in training")
        if form == ROWS:
            X = validate_data(self, X, reset=False, dtype=(np.float64, np.float32))[:, None, None]
        answers = self._of_recordings(X) if form == RECORDINGS else self.recogniser_.probabilities(np.asarray(X))
        names = list(map(str, self.classes_))
        probabilities = np.zeros((len(answers), len(names)), dtype=np.float32)
        probabilities[:, [names.index(name) for name in self.recogniser_.classes]] = answers
        return probabilities

    def predict(self, X: Any) -> np.ndarray:
        """The most probable of `classes_` (n,) for rows of X; see `predict_proba`."""
        best = self.predict_proba(X).argmax(axis=1)
        return self.classes_[best]

    def save(self, path: str | Path) -> None:
        """Write a file like the pipeline's models/classifier.pt, which `Recogniser` and `predict` read.

        Its classes are the texts of `classes_`.

        Raises:
            NotFittedError: before `fit`.
        """
        check_is_fitted(self, "recogniser_")
        with atomic_write(path) as part:
            part.write_bytes(self._file)

    def __getstate__(self) -> dict[str, Any]:
        """All but the recogniser, which `__setstate__` loads again from the classifier's file."""
        return {name: value for name, value in super().__getstate__().items() if name != "recogniser_"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        if hasattr(self, "_file"):
            self._load()

    def _load(self) -> None:
        from tactile_viewgcn.recognition.recogniser import Recogniser

        self.recogniser_ = Recogniser(io.BytesIO(self._file))

    @property
    def _frames_last(self) -> bool:
        return isinstance(self.params, Mapping) and self.params.get("data.shape") == FRAMES_LAST

    def _parameters(self, form: str, arrays: list[np.ndarray]) -> Params:
        """All parameters for rows of this form."""
        if not isinstance(self.params, Mapping | None):
            raise UserError(f"params is {self.params!r}; expected a mapping of keys of params.yaml to values, or None")
        seed, chosen = self.random_state, {} if form == RECORDINGS else CHOSEN
        if seed is None or isinstance(seed, np.random.RandomState):
            seed = check_random_state(seed).randint(2**31 - 1)
        changes = {"seed": seed, "views": len(arrays[0]) if chosen else self.views}
        if self.system in get_args(Member):
            changes |= {"model.system": "sensors", "model.members": [self.system]}
        elif self.system is not None:
            changes["model.system"] = self.system
        if chosen:
            changes |= chosen | {"preprocess.scale": _strongest(arrays)}
        changes |= self.params or {}
        plain = {key: value.item() if isinstance(value, np.generic) else value for key, value in changes.items()}
        preset = "best" if self.preset is None and self.system is None else self.preset
        texts = preset_changes(preset) if preset is not None else []
        params = default_params((*texts, *(as_change(*item) for item in plain.items())), type(self).__name__)
        for key in ("preprocess.baseline", "preprocess.filter"):
            value = getattr(params.preprocess, key.removeprefix("preprocess."))
            if chosen and value != chosen[key]:
                raise UserError(
                    f"{key} is {value}, and X holds {form}, frames in contact above baseline: expected {chosen[key]}, "
                    "or a list of recordings"
                )
        return params

    def _of_recordings(self, X: Any) -> np.ndarray:
        """Probabilities (n, classes) of rows by their recordings of raw counts.

        A row without contact is the empty hand; where that is no class, a warning says so.
        """
        from tactile_viewgcn.recognition.answer import answer_recording, answer_together

        recogniser, of_rows = self.recogniser_, []
        for number, recordings in enumerate(recordings_by_row(X, frames_last=self._frames_last)):
            answers = [answer_recording(recogniser, counts, name=f"X[{number}]") for counts in recordings]
            answer = answer_together(recogniser, answers) if len(answers) > 1 else answers[0]
            if not answer.contact and EMPTY_HAND not in recogniser.classes:
                warnings.warn(f"X[{number}] has no frame in contact: its classes are equally probable", stacklevel=3)
            of_rows.append(answer.probabilities)
        return np.stack(of_rows)


def _distinct(y: Any) -> tuple[np.ndarray, np.ndarray]:
    """Distinct labels (Y,), sorted, and the index (n,) of each row's label."""
    try:
        check_classification_targets(y)
        classes, labels = np.unique(y, return_inverse=True)
    except TypeError:  # the labels have no order
        raise UserError("y holds labels of different kinds; expected texts, or whole numbers") from None
    if len(classes) < 2:
        raise UserError(one_class(classes[0], "y has"))
    return classes, labels


def _strongest(arrays: list[np.ndarray]) -> float:
    """Full scale of frames in contact: the reading, to two digits, that one in a hundred positive readings exceeds."""
    readings = np.concatenate([array[array > 0] for array in arrays])
    return float(f"{np.percentile(readings, 99):.2g}") if len(readings) else 1.0
