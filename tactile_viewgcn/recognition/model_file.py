"""The file of a trained classifier: what it has learnt, and all that is needed to use it on raw counts.

It runs no code when it is loaded. It holds tensors and plain values, read with `weights_only=True`; pipelines of
scikit-learn lie in it as archives of skops, whose types are compared with a list before anything is built.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.names import EMPTY_HAND
from tactile_viewgcn.params import Backbone, Model
from tactile_viewgcn.recognition.archive import check_packed, packed, unpacked, values
from tactile_viewgcn.recognition.fitted_preprocessing import STRONG_SHARE, read_fitted
from tactile_viewgcn.recognition.model_content import check_content
from tactile_viewgcn.recognition.novelty import Novelty, fit_novelty
from tactile_viewgcn.recognition.sequential import Calibration
from tactile_viewgcn.systems.classifier import Classifier, build_classifier
from tactile_viewgcn.tables.frames import TRAIN, Frames

EXPECTED = "expected what `finetune` or `TactileClassifier.save` has written, such as models/classifier.pt"
FORMAT = 5  # of the file; one written before formats had numbers has none
STRONG_FRAMES = 2000
ARCHIVE_START = b"PK"  # of all that torch saves, of a classifier that was cut short too


def save_classifier(
    path: str | Path,
    classifier: Classifier,
    model: Model,
    frames: Frames,
    precision: str = "float32",
    calibration: Calibration | None = None,
) -> None:
    """Write a classifier to a file, with what a `Recogniser` needs to use it on raw counts.

    Args:
        model: that the classifier was built with; frames: its training data; precision: of its training.
        calibration: with it the classifier takes any number of views up to V.
    """
    sessions, baselines = session_baselines(frames)
    novelty = fit_novelty(frames, classifier.views)
    content = {
        "format": FORMAT,
        "learnt": classifier.state_dict(),
        "viewpoints": classifier.viewpoints,
        "model": asdict(model),
        "classes": frames.classes,
        "transform": classifier.transform or frames.transform,
        "scale": frames.scale,
        "shape": list(frames.counts.shape[1:]),
        "baseline_mean": torch.from_numpy(baselines),
        "baseline_names": sessions,
        "precision": precision,
        "calibration": calibration and asdict(calibration),
        "preprocess": frames.preprocess,
        "kept_share": frames.kept_share,
        "dtype": str(frames.counts.dtype),
        "live": torch.from_numpy(frames.live),
        "noise": torch.from_numpy(frames.noise),
        "strong_readings": strong_readings(frames),
        "novelty": novelty and {name: torch.as_tensor(value) for name, value in vars(novelty).items()},
    }
    with atomic_write(path) as part:
        torch.save(packed(content), part)


def session_baselines(frames: Frames) -> tuple[list[str], np.ndarray]:
    """Names (R,) of the sessions that have frames, and their baselines (R, H, W), the mean where one has several."""
    pairs = np.unique(np.stack([frames.session, frames.baseline], axis=1), axis=0)
    used = np.unique(pairs[:, 0])
    means = [frames.baseline_mean[pairs[pairs[:, 0] == session, 1]].mean(axis=0) for session in used]
    return [frames.sessions[session] for session in used], np.stack(means)


def strong_readings(frames: Frames) -> list[float]:
    """Counts above baseline that one in a hundred readings of the live sensors exceeds, of two recordings.

    They are the weakest and the strongest of those of an object, by at most 2,000 of the training anchors.
    """
    empty = frames.classes.index(EMPTY_HAND) if EMPTY_HAND in frames.classes else -1
    anchors = np.flatnonzero(frames.anchor & (frames.side == TRAIN) & (frames.label != empty))
    some = anchors[np.linspace(0, len(anchors) - 1, min(len(anchors), STRONG_FRAMES)).astype(int)]
    readings, recording = frames.inputs(some, "counts")[:, frames.live], frames.recording[some]
    strong = [np.quantile(readings[recording == number], 1 - STRONG_SHARE) for number in np.unique(recording)]
    return [float(min(strong)), float(max(strong))]


def load_classifier(path: str | Path | BinaryIO) -> tuple[Classifier, dict[str, Any]]:
    """The classifier in evaluation mode, and the other content of the file that `save_classifier` wrote.

    Raises:
        UserError: the file is something else, damaged, altered, or of an earlier version.
    """
    name = path if isinstance(path, str | Path) else "the classifier"
    try:
        with _stream(path) as stream:
            if stream.read(2) != ARCHIVE_START:
                raise UserError(f"{name}: no classifier; {EXPECTED}")
            check_packed(stream, stream.seek(0, io.SEEK_END))
            stream.seek(0)
            content = torch.load(stream, map_location="cpu", weights_only=True)
        if not isinstance(content, dict) or not {"model", "classes"} <= content.keys():
            raise UserError(f"{name}: no classifier, but other weights or values; {EXPECTED}")
        if content.get("format") != FORMAT:
            raise UserError(f"{name}: no classifier of this version; train it again (`dvc repro`, or fit and save)")
        check_content(content)
        model = Model(**content["model"] | {"backbone": Backbone(**content["model"]["backbone"])})
        learnt = unpacked(content.pop("learnt"))
        parts = content["viewpoints"], len(content["classes"]), model, tuple(content["shape"])
        with torch.device("meta"):  # where weights take no memory
            _check_weights(build_classifier(*parts), learnt)
        classifier = build_classifier(*parts)
        counts = set(values(learnt, "classes"))
        if not counts - {len(content["classes"])} and isinstance(answered := classifier.load_state_dict(learnt), int):
            counts.add(answered)
        if counts - {len(content["classes"])}:
            raise ValueError("it has learnt another number of classes than it names")
        content["preprocessing"] = read_fitted(content)
        content["calibration"] = content["calibration"] and Calibration(**content["calibration"])
        novelty = content["novelty"]
        content["novelty"] = novelty and Novelty(**{name: value.numpy() for name, value in novelty.items()})
    except (UserError, FileNotFoundError, PermissionError):
        raise
    except Exception as error:  # of a file from outside anything may be wrong
        reason = f"{type(error).__name__}: {' '.join(str(error).split()).partition('. ')[0]}"
        raise UserError(
            f"{name}: damaged, altered, or no classifier of this version ({reason}); train it again"
        ) from error
    if isinstance(classifier, torch.nn.Module):
        classifier.eval()
    return classifier, content


@contextmanager
def _stream(path: str | Path | BinaryIO) -> Iterator[BinaryIO]:
    """The file at a path, opened, or the open one itself."""
    if isinstance(path, str | Path):
        with Path(path).open("rb") as file:
            yield file
    else:
        yield path


def _check_weights(classifier: Classifier, learnt: dict[str, Any]) -> None:
    """A ValueError where weights are not finite, or of other names or shapes than the classifier's."""
    if not all(weights.isfinite().all() for weights in _tensors(learnt)):
        raise ValueError("a weight is no finite number")
    if isinstance(classifier, torch.nn.Module):
        expected = {name: weights.shape for name, weights in classifier.state_dict().items()}
        if {name: weights.shape for name, weights in learnt.items()} != expected:
            raise ValueError("its weights are those of another network")


def _tensors(node: Any) -> Iterator[Tensor]:
    """The tensors in dictionaries and lists."""
    if isinstance(node, Tensor):
        yield node
    for part in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
        yield from _tensors(part)
