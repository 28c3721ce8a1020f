"""The file of a trained classifier: its weights and all that is needed to use them on raw counts.

It holds tensors and plain values alone, so that it loads with `weights_only=True`. The weights of a system without a
network are a pickled estimator, which runs code when it is loaded, see `sensors/sensor_system.py`.
"""

from dataclasses import asdict
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch

from tactile_viewgcn.files import atomic_write, readable
from tactile_viewgcn.frames.split import TRAIN
from tactile_viewgcn.params import Backbone, Model
from tactile_viewgcn.recognition.fitted_preprocessing import STRONG_SHARE, read_fitted
from tactile_viewgcn.recognition.novelty import Novelty, fit_novelty
from tactile_viewgcn.systems.classifier import Classifier, build_classifier
from tactile_viewgcn.tables.frames import Frames

STRONG_FRAMES = 2000


def save_classifier(
    path: str | Path,
    classifier: Classifier,
    model: Model,
    frames: Frames,
    precision: str = "float32",
    temperatures: list[float] | None = None,
) -> None:
    """Write a classifier to a file, with what a `Recogniser` needs to use it on raw counts.

    Args:
        model: the parameters that the classifier was built with.
        frames: its training data, whose classes, sessions' baselines and preprocessing are written too.
        precision: of its training, in which a `Recogniser` also computes.
        temperatures: for 1 to V frames, see `calibration.calibrate`; with them it takes any number of views up to V.
    """
    sessions, baselines = session_baselines(frames)
    novelty = fit_novelty(frames, classifier.views)
    content = {
        "weights": {name: value.cpu().contiguous() for name, value in classifier.state_dict().items()},
        "viewpoints": classifier.viewpoints.cpu(),
        "model": asdict(model),
        "classes": frames.classes,
        "transform": classifier.head.transform or frames.transform,
        "scale": frames.scale,
        "shape": list(frames.counts.shape[1:]),
        "baseline_mean": torch.from_numpy(baselines),
        "baseline_names": sessions,
        "precision": precision,
        "temperatures": temperatures,
        "preprocess": frames.preprocess,
        "kept_share": frames.kept_share,
        "dtype": str(frames.counts.dtype),
        "live": torch.from_numpy(frames.live),
        "noise": torch.from_numpy(frames.noise),
        "strong_reading": strong_reading(frames),
        "novelty": novelty and {name: torch.as_tensor(value) for name, value in vars(novelty).items()},
    }
    with atomic_write(path) as part:
        torch.save(content, part)


def session_baselines(frames: Frames) -> tuple[list[str], np.ndarray]:
    """Names (R,) of the sessions that have frames, and their baselines (R, H, W).

    It is the mean where a session has several, one a recording or a grasp: those are of the past, and a user has none.
    """
    pairs = np.unique(np.stack([frames.session, frames.baseline], axis=1), axis=0)
    used = np.unique(pairs[:, 0])
    means = [frames.baseline_mean[pairs[pairs[:, 0] == session, 1]].mean(axis=0) for session in used]
    return [frames.sessions[session] for session in used], np.stack(means)


def strong_reading(frames: Frames) -> float:
    """Counts above baseline that one in a hundred readings of the live sensors exceeds, of at most 2,000 anchors."""
    anchors = np.flatnonzero(frames.anchor & (frames.side == TRAIN))
    some = anchors[np.linspace(0, len(anchors) - 1, min(len(anchors), STRONG_FRAMES)).astype(int)]
    return float(np.quantile(frames.inputs(some, "counts")[:, frames.live], 1 - STRONG_SHARE))


def load_classifier(path: str | Path | BinaryIO) -> tuple[Classifier, dict[str, Any]]:
    """The classifier in evaluation mode, and the other content of the file that `save_classifier` wrote."""
    with readable(path):
        content = torch.load(path, map_location="cpu", weights_only=True)
        weights, _ = content.pop("weights"), content["temperatures"]
        model = Model(**content["model"] | {"backbone": Backbone(**content["model"]["backbone"])})
        classifier = build_classifier(content["viewpoints"], len(content["classes"]), model, tuple(content["shape"]))
        classifier.load_state_dict(weights)
        content["preprocessing"] = read_fitted(content)
        novelty = content["novelty"]
        content["novelty"] = novelty and Novelty(**{name: value.numpy() for name, value in novelty.items()})
    return classifier.eval(), content
