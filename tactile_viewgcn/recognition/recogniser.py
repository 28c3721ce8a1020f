"""The trained recogniser: class probabilities of raw counts."""

from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import select_device
from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.params import on_sensors
from tactile_viewgcn.recognition.array_input import check_finite
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.recognition.preprocessing import check_counts
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.features import every_few
from tactile_viewgcn.tables.frames import network_input
from tactile_viewgcn.views.sampling import spread_frames

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
        calibration: temperatures for 1 to V frames and for whole recordings; None for a classifier of V views alone.
        system: name of the system, or of the members of `sensors`.
        preprocessing: that of the training.
    """

    def __init__(self, path: str | Path | BinaryIO):
        self.classifier, content = load_classifier(path)
        model, self.preprocessing = content.model, content.preprocessing
        self.classes, self.calibration = content.classes, content.calibration
        self.system = " + ".join(model.members) if on_sensors(model.system) else model.system
        self.shape = self.preprocessing.live.shape
        self._transform, self._scale = content.transform, content.scale
        self._compute = select_device("cpu", content.precision)

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

    @torch.inference_mode()
    def probabilities(self, counts: np.ndarray, baseline: Baseline = None) -> np.ndarray:
        """Class probabilities float32 (B, classes), a column for each of `classes`.

        Args:
            counts: (B, V, H, W) of B view sets. Frame i of a set stands at viewpoint i; the systems that read frames
                in the order of time (cnn_lstm, conv_lstm) take the earliest first. A calibrated classifier also takes
                fewer frames, (B, k, H, W); its probabilities are calibrated for random frames of a recording.
        """
        most, least = self.classifier.views, 1 if self.calibration else self.classifier.views
        if counts.ndim != 4 or counts.shape[2:] != self.shape or not least <= counts.shape[1] <= most:
            raise UserError(
                f"counts has shape {counts.shape}; expected (sets, views, rows, columns) = "
                f"(any, {f'{least} to ' * (least < most)}{most}, {', '.join(map(str, self.shape))})"
            )
        views, parts = counts.shape[1], [np.empty((0, len(self.classes)), dtype=np.float32)]
        step = max(1, MOST_FRAMES // views)
        for start in range(0, len(counts), step):
            parts.append(self._of_sets(self._values(counts[start : start + step], baseline), views))
        return np.concatenate(parts)

    @torch.inference_mode()
    def of_recording(self, counts: np.ndarray, baseline: Baseline = None) -> tuple[np.ndarray, int]:
        """Class probabilities (classes,) of a whole recording, and the number of distinct frames that were used.

        Args:
            counts: (n, H, W) of its frames in contact, in the order of time.
        """
        views, calibration, temperature = self.classifier.views, self.calibration, None
        if isinstance(self.classifier, SensorClassifier):
            index = used = every_few(np.arange(len(counts)))
            whole = self.classifier.is_whole(len(used))
            logits = self.classifier.recording_logits(self._values(counts[index], baseline))
        else:
            index = spread_frames(len(counts), views)
            used = np.unique(index)
            index = used if calibration else index  # it takes fewer frames too, so that none is repeated
            logits = self.classifier.logits(self._values(counts[index], baseline), torch.arange(len(index))[None])
            whole = len(used) >= views
        if calibration and calibration.by_recordings and whole:
            temperature = calibration.by_recordings[0]
        return self._calibrated(logits, len(index), temperature)[0], len(used)

    def check_sequential(self, confidence_threshold: float) -> None:
        """Raise a UserError for a classifier that takes V views alone, or a threshold that is no probability."""
        if not self.calibration:
            raise UserError(
                f"the classifier takes {several(self.classifier.views, 'view')} and no fewer; fine-tune it with "
                "finetune.num_views random and split.validation above 0"
            )
        if not 0 <= confidence_threshold <= 1:
            raise UserError(f"confidence threshold is {confidence_threshold:g}; expected a probability, 0 to 1")

    @torch.inference_mode()
    def predict_sequential(
        self, frames: Iterable[np.ndarray], confidence_threshold: float, baseline: Baseline = None
    ) -> tuple[np.ndarray, int]:
        """Class probabilities (classes,) and the number of frames used: as few as the confidence threshold needs.

        The probabilities are calibrated for random frames of a recording: leave time between frames. Where the
        threshold is not reached, a second grasp helps more than further frames, see `answer.answer_together`.

        Args:
            frames: (H, W) each. None is asked for once the threshold is reached, or after V.
            confidence_threshold: probability of the most probable class.

        Raises:
            UserError: no frames; or see `check_sequential`.
        """
        self.check_sequential(confidence_threshold)
        values: list[Tensor] = []
        for frame in frames:
            if np.shape(frame) != self.shape:
                raise UserError(f"a frame has shape {np.shape(frame)}; expected {self.shape}")
            values.append(self._values(np.asarray(frame)[None], baseline))
            (probabilities,) = self._of_sets(torch.cat(values), len(values))
            if probabilities.max() >= confidence_threshold or len(values) == self.classifier.views:
                break
        if not values:
            raise UserError("frames is empty; expected one frame or more")
        return probabilities, len(values)

    def _values(self, counts: np.ndarray, baseline: Baseline) -> Tensor:
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
        with self._compute.autocast():
            return self.classifier.frame_values(self._compute.frames(torch.from_numpy(inputs)))

    def _of_sets(self, values: Tensor, views: int) -> np.ndarray:
        """Class probabilities (B, classes) of view sets, from the values (B `views`, ...) of their frames in order."""
        return self._calibrated(self.classifier.logits(values, torch.arange(len(values)).view(-1, views)), views)

    def _calibrated(self, logits: Tensor, views: int, temperature: float | None = None) -> np.ndarray:
        """Class probabilities (B, classes), by the temperature of a number of views if none is given."""
        if temperature is None:
            by_frames = self.calibration.by_frames if self.calibration else [1.0]
            temperature = by_frames[min(views, len(by_frames)) - 1]
        return (logits / temperature).softmax(dim=-1).numpy()
