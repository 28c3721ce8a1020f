"""The trained recogniser: class probabilities of raw counts."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
import torch
from scipy.special import softmax
from torch import Tensor

from tactile_viewgcn.device import select_device
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.notes import several
from tactile_viewgcn.recognition.array_input import check_finite
from tactile_viewgcn.recognition.fitted_preprocessing import FittedPreprocessing
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.recognition.novelty import Novelty, spread_sets
from tactile_viewgcn.systems import on_sensors
from tactile_viewgcn.tables.transform import network_input

MOST_FRAMES = 1024  # that are classified at once; a request may hold any number


class Recogniser:
    """A trained classifier for raw counts.

    Args:
        path: a file of `save_classifier`, or one that is open for reading.

    Attributes:
        classes: names; shape: (H, W) of a frame.
        calibration: None for a classifier of V views alone; temperatures: its for 1 to V frames.
        system: name of the system, or of the members of `sensors`; preprocessing: that of the training.
        novelty: tells frames that are unlike the training's; None where it could not be fitted.
    """

    def __init__(self, path: str | Path | BinaryIO):
        self.classifier, content = load_classifier(path)
        self.classes, self.shape = content["classes"], tuple(content["shape"])
        self.calibration, model = content["calibration"], content["model"]
        self.system = " + ".join(model["members"]) if on_sensors(model["system"]) else model["system"]
        self.temperatures = self.calibration.by_frames if self.calibration else None
        self._transform, self._scale = content["transform"], content["scale"]
        self._compute = select_device("cpu", content["precision"])
        self.preprocessing: FittedPreprocessing = content["preprocessing"]
        self.novelty: Novelty | None = content["novelty"]

    def baseline(self, name: str = "") -> np.ndarray:
        """Baseline (H, W) in counts of a session of the training data; without a name, the mean of all sessions.

        Where the baseline drifts, rather give the mean of your own open-hand frames, right before the grasp.

        Raises:
            UserError: an unknown session.
        """
        if not name:
            return self.preprocessing.mean_baseline()
        if name not in self.preprocessing.baselines:
            raise UserError(
                f"session is {name!r}; expected one of {', '.join(self.preprocessing.baselines)}, "
                "or give the baseline of the empty hand itself"
            )
        return self.preprocessing.baselines[name]

    def probabilities(self, counts: np.ndarray, baseline: np.ndarray | None = None) -> np.ndarray:
        """Class probabilities float32 (B, classes), a column for each of `classes`.

        Args:
            counts: raw counts (B, V, H, W) of B view sets. Frame i of a set stands at viewpoint i; the systems that
                read frames in the order of time (cnn_lstm, conv_lstm) take the earliest first. A classifier with
                temperatures also takes fewer frames, (B, k, H, W); its probabilities are calibrated for random
                frames of a recording.
            baseline: of the empty hand in the same session, (H, W) counts; the mean of the known baselines if None.

        Raises:
            UserError: counts or baseline of another shape, values that are not finite or too large, or fractions
                where the training's counts are integers.
        """
        max_views, any_number = self.classifier.views, self.temperatures is not None
        fits = counts.ndim == 4 and counts.shape[2:] == self.shape
        if not fits or not (1 if any_number else max_views) <= counts.shape[1] <= max_views:
            raise UserError(
                f"counts has shape {counts.shape}; expected (sets, views, rows, columns) = "
                f"(any, {f'1 to {max_views}' if any_number else max_views}, {', '.join(map(str, self.shape))})"
            )
        step = max(1, MOST_FRAMES // counts.shape[1])
        parts = [counts[start : start + step] for start in range(0, max(1, len(counts)), step)]
        return np.concatenate([self.probabilities_above(self._excess(part, baseline)) for part in parts])

    @torch.inference_mode()
    def probabilities_above(self, excess: np.ndarray) -> np.ndarray:
        """The same as `probabilities` of counts above baseline (B, V, H, W), or (B, k, H, W)."""
        count, views = excess.shape[:2]
        if not count:
            return np.empty((0, len(self.classes)), dtype=np.float32)
        return self._probabilities(self._values(excess.reshape(-1, *self.shape)), views)

    @torch.inference_mode()
    def recording_above(self, excess: np.ndarray) -> tuple[np.ndarray, int]:
        """Class probabilities (classes,) of a recording as a whole, and the number of frames that were used.

        Args:
            excess: (n, H, W) counts above baseline of its frames in contact, in the order of time.
        """
        views, calibration = self.classifier.views, self.calibration
        (index,) = spread_sets(len(excess), calibration.most_frames if calibration else views)
        if calibration:
            index = np.unique(index)
        logits = self.classifier.logits(self._values(excess[index]), torch.arange(len(index))[None])
        temperature = 1.0
        if calibration:
            few = len(index) < views or not calibration.by_recordings
            temperature = calibration.by_frames[min(len(index), views) - 1] if few else calibration.by_recordings[0]
        return (logits[0] / temperature).softmax(dim=-1).numpy(), len(np.unique(index))

    def together(self, answers: list[np.ndarray]) -> np.ndarray:
        """Class probabilities (classes,) of one object that was recorded several times: the answers' logarithms, added.

        They are calibrated for one to three recordings, if the training had as many of an object.

        Args:
            answers: of `recording_above` to each.
        """
        temperatures = (self.calibration and self.calibration.by_recordings) or [1.0]
        first, last = temperatures[0], temperatures[min(len(answers), len(temperatures)) - 1]
        logarithms = np.log(np.maximum(answers, np.finfo(np.float32).tiny)).sum(axis=0)
        return softmax(logarithms * first / last)

    def _excess(self, counts: np.ndarray, baseline: np.ndarray | None) -> np.ndarray:
        """Counts above baseline float64 (..., H, W) of raw counts; UserError where they are not fit for it."""
        baseline = self.baseline() if baseline is None else baseline
        if baseline.shape != self.shape:
            raise UserError(f"baseline has shape {baseline.shape}; expected {self.shape}")
        check_finite(baseline, "baseline")
        check_finite(counts, "counts")
        self.preprocessing.check_counts(counts, "counts")
        return np.subtract(counts, baseline, dtype=np.float64)

    def _values(self, excess: np.ndarray) -> Tensor:
        """The classifier's values (n, ...) of counts above baseline (n, H, W)."""
        inputs = network_input(excess, self._transform, self._scale)
        with self._compute.autocast():
            return self.classifier.frame_values(self._compute.frames(torch.from_numpy(inputs)))

    def _probabilities(self, values: Tensor, views: int) -> np.ndarray:
        """Class probabilities (B, classes) of view sets of k `views` each, by the values (B k, ...) of their frames."""
        logits = self.classifier.logits(values, torch.arange(len(values)).view(-1, views))
        temperature = self.temperatures[views - 1] if self.temperatures is not None else 1.0
        return (logits / temperature).softmax(dim=-1).numpy()

    def check_sequential(self, confidence_threshold: float) -> None:
        """Raise a UserError if the classifier takes V views alone, or the threshold is no probability."""
        if self.temperatures is None:
            raise UserError(
                f"the classifier takes {several(self.classifier.views, 'view')} and no fewer; fine-tune it with "
                "finetune.num_views random and split.validation above 0"
            )
        if not 0 <= confidence_threshold <= 1:
            raise UserError(f"confidence threshold is {confidence_threshold:g}; expected a probability, 0 to 1")

    def predict_sequential(
        self, frames: Iterable[np.ndarray], confidence_threshold: float, baseline: np.ndarray | None = None
    ) -> tuple[np.ndarray, int]:
        """Class probabilities (classes,) and the number of frames used: as few as the confidence threshold needs.

        The probabilities are calibrated for random frames of a recording: leave time between frames. Where the
        threshold is not reached, another grasp helps more than further frames, see `together`.

        Args:
            frames: raw counts (H, W), one after another; none is asked for once the threshold is reached, or after V.
            confidence_threshold: of the most probable class.
            baseline: see `probabilities`.

        Raises:
            UserError: see `check_sequential`; no frames, or of another shape, or not finite.
        """

        def above() -> Iterator[np.ndarray]:
            for frame in frames:
                if np.shape(frame) != self.shape:
                    raise UserError(f"a frame has shape {np.shape(frame)}; expected {self.shape}")
                yield self._excess(np.asarray(frame), baseline)

        return self.sequential_above(above(), confidence_threshold)

    @torch.inference_mode()
    def sequential_above(self, frames: Iterable[np.ndarray], confidence_threshold: float) -> tuple[np.ndarray, int]:
        """The same as `predict_sequential` of counts above baseline (H, W)."""
        self.check_sequential(confidence_threshold)
        values: list[Tensor] = []
        for frame in frames:
            values.append(self._values(frame[None]))
            (probabilities,) = self._probabilities(torch.cat(values), len(values))
            if probabilities.max() >= confidence_threshold or len(values) == self.classifier.views:
                return probabilities, len(values)
        if not values:
            raise UserError("frames holds none; expected one frame or more")
        return probabilities, len(values)
