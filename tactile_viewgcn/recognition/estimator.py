"""scikit-learn's interface: a classifier of recordings, of view sets, or of rows of sensors, given as arrays."""

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

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.frames.preprocessing import one_class
from tactile_viewgcn.names import EMPTY_HAND, shown
from tactile_viewgcn.notes import warnings_of
from tactile_viewgcn.params import DEFAULTS, Params, load, preset_changes
from tactile_viewgcn.recognition.array_input import RECORDINGS, ROWS, checked_arrays, form_of, recordings_by_row
from tactile_viewgcn.schema import as_change
from tactile_viewgcn.systems import Member
from tactile_viewgcn.tables.array_recordings import ArrayRecordings

#: view sets and rows are chosen frames above baseline
CHOSEN = {
    "preprocess.baseline": "none",
    "preprocess.zero": 0,
    "preprocess.filter": "none",
    "preprocess.contact_sensors": 1,
    "cluster.scope": "recording",
}


class TactileClassifier(ClassifierMixin, BaseEstimator):
    """Recognises objects in tactile recordings; any system or preset of the pipeline, trained in memory.

    X is one of

    - a list of recordings, each raw counts (T_i, H, W): the baseline is subtracted and the frames in contact are found
      as the pipeline does it; a row may be a list of several recordings of one object, which are answered together;
    - an array of view sets (n, V, H, W), counts above baseline, frames in contact;
    - an array (n, S), or what scikit-learn makes one of: each row is one frame of 1 x S sensors, counts above baseline.

    Args:
        preset: a name of `tactile-viewgcn preset`; `best` if `system` is None too.
        system: a value of `model.system`, or a member of `sensors`; on top of the preset, else of params.yaml.
        views: V, frames that a recording is classified by; an array of view sets has its own.
        params: changes of params.yaml by dotted key, on top of all others, such as `{"preprocess.transform": "log"}`.
        random_state: of every random choice: an integer, a generator of NumPy (RandomState), or None.

    Attributes:
        classes_: (Y,) labels, sorted.
        params_: all parameters that it was trained with.
        notes_: on what was chosen for the training data and left out of them, and why.
        recogniser_: the trained `Recogniser`, which answers one set or recording at a time.
        n_features_in_: S, of rows alone.
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
            groups: (n,) rows of one group are held out together, for the choice of `best`, for calibration and for
                `split.validation`; None: each row is a group.

        Raises:
            UserError, ValueError: an argument that is wrong, in one line.
        """
        from tactile_viewgcn.recognition.training import train

        form = form_of(X)
        if form == ROWS:
            X, y = validate_data(self, X, y, dtype=(np.float64, np.float32))
            arrays, row = list(X[:, None, None]), np.arange(len(X))
        else:
            arrays, row = checked_arrays(recordings_by_row(X))
            y = column_or_1d(y, warn=True)
            check_consistent_length(X, y)
        classes, labels = _classes(y)
        group, params = _groups(groups, len(y))[row], self._parameters(form, arrays)
        names, session = [str(label) for label in classes], np.zeros(len(arrays), dtype=int)
        recordings = ArrayRecordings(arrays, names, labels[row], session)
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
            UserError, ValueError: X of another form or layout than in training.
        """
        check_is_fitted(self, "recogniser_")
        if (form := form_of(X)) != self._form:
            raise UserError(f"X holds {form}; expected {self._form}, as in training")
        if form == ROWS:
            X = validate_data(self, X, reset=False, dtype=(np.float64, np.float32))[:, None, None]
        of_rows = self._of_recordings(X) if form == RECORDINGS else self.recogniser_.probabilities(np.asarray(X))
        names = [str(label) for label in self.classes_]
        probabilities = np.zeros((len(of_rows), len(names)), dtype=np.float32)
        probabilities[:, [names.index(name) for name in self.recogniser_.classes]] = of_rows
        return probabilities

    def predict(self, X: Any) -> np.ndarray:
        """The most probable of `classes_` (n,) for rows of X; see `predict_proba`."""
        best = self.predict_proba(X).argmax(axis=1)
        return self.classes_[best]

    def save(self, path: str | Path) -> None:
        """Write the classifier's file, as the pipeline's models/classifier.pt: `Recogniser` and `predict` read it.

        Its classes are the texts of `classes_`.

        Raises:
            NotFittedError: before `fit`.
        """
        check_is_fitted(self, "recogniser_")
        with atomic_write(path) as part:
            part.write_bytes(self._file)

    def __getstate__(self) -> dict[str, Any]:
        """All but the recogniser, which is loaded anew from the classifier's file."""
        return {name: value for name, value in super().__getstate__().items() if name != "recogniser_"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        if hasattr(self, "_file"):
            self._load()

    def _load(self) -> None:
        import torch

        from tactile_viewgcn.recognition.recogniser import Recogniser

        with torch.random.fork_rng():  # building a network draws weights
            self.recogniser_ = Recogniser(io.BytesIO(self._file))

    def _parameters(self, form: str, arrays: list[np.ndarray]) -> Params:
        """All parameters, for rows of this form."""
        if not isinstance(self.params, Mapping | None):
            raise UserError(f"params is {self.params!r}; expected a mapping of keys of params.yaml to values, or None")
        preset = "best" if self.preset is None and self.system is None else self.preset
        seed = self.random_state
        if seed is None or isinstance(seed, np.random.RandomState):
            seed = check_random_state(seed).randint(2**31 - 1)
        changes = {"seed": seed, "views": self.views if form == RECORDINGS else len(arrays[0])}
        if self.system in get_args(Member):
            changes |= {"model.system": "sensors", "model.members": [self.system]}
        elif self.system is not None:
            changes["model.system"] = self.system
        changes |= CHOSEN | {"preprocess.scale": _strongest(arrays)} if form != RECORDINGS else {}
        changes |= self.params or {}
        plain = {key: value.item() if isinstance(value, np.generic) else value for key, value in changes.items()}
        texts = preset_changes(preset) if preset is not None else []
        params = load(DEFAULTS, (*texts, *(as_change(*item) for item in plain.items())), type(self).__name__)
        for key in ("baseline", "filter") if form != RECORDINGS else ():
            value, expected = getattr(params.preprocess, key), CHOSEN[f"preprocess.{key}"]
            if value != expected:
                raise UserError(
                    f"preprocess.{key} is {value}, and X holds {form}, which are chosen frames above baseline: "
                    f"expected {expected}, or a list of recordings"
                )
        return params

    def _of_recordings(self, X: Any) -> np.ndarray:
        """Probabilities (n, classes) of rows, by the frames in contact of their recordings of raw counts.

        Without any it is the empty hand, or where that is no class, each class is as probable as any other.
        """
        from tactile_viewgcn.recognition.answer import NO_CONTACT, answer_recording, answer_together

        recogniser, of_rows = self.recogniser_, []
        without_contact = np.full(len(recogniser.classes), 1 / len(recogniser.classes))
        if EMPTY_HAND in recogniser.classes:
            without_contact = np.array([float(name == EMPTY_HAND) for name in recogniser.classes])
        for number, recordings in enumerate(recordings_by_row(X)):
            answers = [answer_recording(recogniser, counts, name=f"X[{number}]") for counts in recordings]
            answer = answer_together(recogniser, answers) if len(answers) > 1 else answers[0]
            of_rows.append(without_contact if answer.status == NO_CONTACT else answer.probabilities)
            if answer.status == NO_CONTACT and EMPTY_HAND not in recogniser.classes:
                warnings.warn(f"X[{number}] has no frame in contact: its classes are equally probable", stacklevel=3)
        return np.stack(of_rows)


def _classes(y: Any) -> tuple[np.ndarray, np.ndarray]:
    """Distinct labels (Y,), sorted, and the index of each row's (n,)."""
    try:
        check_classification_targets(y)
        classes, labels = np.unique(y, return_inverse=True)
    except TypeError:  # they have no order
        raise UserError("y holds labels of different kinds; expected texts, or whole numbers") from None
    if len(classes) < 2:
        raise UserError(one_class(classes[0], "y has"))
    return classes, labels


def _strongest(arrays: list[np.ndarray]) -> float:
    """The reading above 0 that one in a hundred exceeds, of two digits: full scale of frames that have been chosen."""
    readings = np.concatenate([array[array > 0] for array in arrays])
    return float(f"{np.percentile(readings, 99):.2g}") if len(readings) else 1.0


def _groups(groups: Any, rows: int) -> np.ndarray:
    """Group (n,) of each row, from 0."""
    groups = np.arange(rows) if groups is None else np.asarray(groups)
    if groups.shape != (rows,):
        raise UserError(f"groups has shape {groups.shape}; expected ({rows},), a group for each row of X")
    return np.unique(groups, return_inverse=True)[1]
