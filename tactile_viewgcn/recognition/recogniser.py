"""The trained recogniser: class probabilities of raw counts."""

from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.device import select_device
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import on_sensors
from tactile_viewgcn.recognition.array_input import check_finite
from tactile_viewgcn.recognition.calibration import recording_answer
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.recognition.preprocessing import check_counts
from tactile_viewgcn.tables.frames import network_input

MOST_FRAMES = 1024  # frames that are classified at once; a request may hold any number
Baseline = np.ndarray | Literal["subtracted"] | None


class Recogniser:
    """A trained classifier for raw counts.

    Methods take raw counts and a baseline: (H, W) counts of the empty hand in the same session; None for the mean of
    the training's sessions; or "subtracted" where they are above their baseline, and in the model's units, already.
    They raise a UserError for counts or a baseline of a different shape, for values that are not finite or too large,
    and for raw counts that the training's integer type cannot hold.

    Args:
        path: a file that `save_classifier` wrote, or that file open for reading.

    Attributes:
        classes: names.
        shape: (H, W) of a frame.
        temperature: of answers to recordings; None where the classifier is not calibrated.
        system: name of the system, or of the members of `sensors`.
        preprocessing: that of the training.
    """

    def __init__(self, path: str | Path | BinaryIO):
        self.classifier, content = load_classifier(path)
        model, self.preprocessing = content.model, content.preprocessing
        self.classes, self.temperature = content.classes, content.temperature
        self.system = " + ".join(model.members) if on_sensors(model.system) else model.system
        self.shape = self.preprocessing.live.shape
        self._transform, self._scale = content.transform, content.scale
        self.classifier.prepare(select_device("cpu", content.precision))

    def baseline(self, name: str = "") -> np.ndarray:
        """Baseline (H, W) in counts of a session of the training; without a name, the mean over its sessions.

        Where the baseline drifts, give the mean of your own open-hand frames right before the grasp instead.

        Raises:
            UserError: an unknown session.
        """
        baselines = self.preprocessing.baselines
        if name and name not in baselines:
            raise UserError(
                f"session is {name!r}; expected one of {', '.join(baselines)}, or give the empty hand's baseline itself"
            )
        return baselines[name] if name else self.preprocessing.mean_baseline()

    def probabilities(self, counts: np.ndarray, baseline: Baseline = None) -> np.ndarray:
        """Class probabilities float32 (B, classes), a column for each of `classes`.

        Args:
            counts: (B, V, H, W) of B view sets. Frame i of a set stands at viewpoint i; the systems that read frames
                in the order of time (cnn_lstm, conv_lstm) take the earliest first.
        """
        views, parts = self.classifier.views, [np.empty((0, len(self.classes)), dtype=np.float32)]
        if counts.ndim != 4 or counts.shape[1:] != (views, *self.shape):
            raise UserError(
                f"counts has shape {counts.shape}; expected (sets, views, rows, columns) = "
                f"(any, {views}, {', '.join(map(str, self.shape))})"
            )
        step = max(1, MOST_FRAMES // views)
        for start in range(0, len(counts), step):
            parts.append(self._of_sets(self._values(counts[start : start + step], baseline), views))
        return np.concatenate(parts)

    def of_recording(self, counts: np.ndarray, baseline: Baseline = None) -> tuple[np.ndarray, int]:
        """Class probabilities (classes,) of a whole recording, and the number of distinct frames that were used.

        Args:
            counts: (n, H, W) of its frames in contact, in the order of time.
        """
        asked = self.classifier, self.temperature, lambda index: self._values(counts[index], baseline), len(counts)
        logarithms, used = recording_answer(*asked)
        return np.exp(logarithms), used

    def _values(self, counts: np.ndarray, baseline: Baseline) -> Any:
        """The classifier's values (n, ...) of the n frames in counts (..., H, W)."""
        if isinstance(baseline, str) and baseline != "subtracted":
            raise UserError(f"baseline is {baseline!r}; expected an array, None or 'subtracted'")
        check_finite(counts, "counts")
        check_counts(self.preprocessing, counts, "counts", raw=not isinstance(baseline, str))
        if not isinstance(baseline, str):
            baseline = self.baseline() if baseline is None else baseline
            if baseline.shape != self.shape:
                raise UserError(f"baseline has shape {baseline.shape}; expected {self.shape}")
            check_finite(baseline, "baseline")
            counts = np.subtract(counts, baseline, dtype=np.float64)
        inputs = network_input(counts.reshape(-1, *self.shape), self._transform, self._scale)
        return self.classifier.frame_values(inputs)

    def _of_sets(self, values: Any, views: int) -> np.ndarray:
        """Class probabilities (B, classes) of view sets, from the values (B `views`, ...) of their frames in order."""
        return softmax(self.classifier.view_sets(values, np.arange(len(values)).reshape(-1, views)), axis=1)
