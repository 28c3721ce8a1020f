"""The trained recogniser: preprocessing, backbone and the system that joins the views in one, and its file.

A checkpoint holds tensors and plain values alone, so that it loads with `weights_only=True`.
"""

from collections.abc import Iterable
from dataclasses import asdict
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.compute import choose
from tactile_viewgcn.files import readable, whole
from tactile_viewgcn.frames import Frames, transform
from tactile_viewgcn.nn.backbone import build_backbone, features_of
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Backbone, Model

STAG_SHAPE = (32, 32)
FURTHEST = 1e9  # of a viewpoint's coordinates: squares, and what an edge's MLP makes of them, stay inside float32
SETS_AT_ONCE = 1 << 20  # numbers in the nodes of a batch of view sets; more gain no speed


class Classifier(nn.Module):
    """View sets of network input to class logits.

    Args:
        viewpoints: (V, 3).
        classes: number of classes.
        model: which backbone and which system on it, with their options.
        shape: (H, W) of a frame.

    Raises:
        ValueError: the system cannot be built for so many views, or at these viewpoints; viewpoints that are not
            finite, or further out than `FURTHEST`.
    """

    def __init__(self, viewpoints: Tensor, classes: int, model: Model, shape: tuple[int, int] = STAG_SHAPE):
        super().__init__()
        if not (viewpoints.abs() < FURTHEST).all():
            raise ValueError(
                f"viewpoints hold {float(viewpoints.abs().max())}; expected coordinates between -{FURTHEST:g} and "
                f"{FURTHEST:g}"
            )
        system = system_of(model.system)
        maps = system.takes == "maps"
        self.references = np.zeros((len(viewpoints), 0))  # see `assignment.common_references`
        self.register_buffer("viewpoints", viewpoints.float(), persistent=False)
        self.backbone = build_backbone(shape, maps=maps, **asdict(model.backbone))
        self.given = self.backbone.maps_of(shape) if maps else (self.backbone.features,)
        known = asdict(model) | {
            "classes": classes,
            "features": self.given[0],
            "maps": self.given,
            "views": len(viewpoints),
            "viewpoints": viewpoints,
        }
        self.head: ViewSystem = system(**{name: known[name] for name in signature(system).parameters})

    @property
    def views(self) -> int:
        return len(self.viewpoints)

    def forward(self, frames: Tensor, views: int) -> tuple[Tensor, list[Tensor]]:
        """frames (B * k, 1, H, W) -> logits (B, classes) and what else the loss needs."""
        return self.head(self.backbone(frames).unflatten(0, (-1, views)))


def system_of(name: str) -> type[ViewSystem]:
    """The class `System` of the file in nn/ that `model.system` names; no other system's code is loaded."""
    return import_module(f"tactile_viewgcn.nn.{name}").System


def weights_of(module: nn.Module) -> int:
    """How many weights it learns."""
    return sum(weight.numel() for weight in module.parameters())


def logits_of_sets(head: ViewSystem, features: Tensor, sets: Tensor) -> Tensor:
    """Logits (A, classes) of view sets (A, k) of indices into features (n, ...), in batches that fit memory.

    Rising indices are the order of time.
    """
    batch = max(1, SETS_AT_ONCE // (sets.shape[1] * features[0].numel()))
    if head.in_time_order:
        sets = sets.sort(dim=1).values
    return torch.cat([head(features[part])[0] for part in sets.split(batch)])


def save_classifier(
    path: str | Path,
    classifier: Classifier,
    model: Model,
    frames: Frames,
    precision: str = "float32",
    temperatures: list[float] | None = None,
) -> None:
    """Write the weights and all that is needed to use them on raw counts, in the precision they were trained in.

    Temperatures, see `touches.calibrate`, make it a classifier of any number of views up to V.
    """
    used = np.unique(frames.rest)  # a session without frames has no rest
    content = {
        "weights": {name: value.cpu().contiguous() for name, value in classifier.state_dict().items()},
        "viewpoints": classifier.viewpoints.cpu(),
        "references": torch.from_numpy(classifier.references),
        "model": asdict(model),
        "classes": frames.classes,
        "kind": frames.kind,
        "scale": frames.scale,
        "shape": list(frames.counts.shape[1:]),
        "rest_mean": torch.from_numpy(frames.rest_mean[used]),
        "rest_names": [frames.rest_names[i] for i in used],
        "precision": precision,
        "temperatures": temperatures,
    }
    with whole(path) as part:
        torch.save(content, part)


def load_classifier(path: str | Path) -> tuple[Classifier, dict[str, Any]]:
    """The classifier in evaluation mode, and the rest of its checkpoint, see `save_classifier`."""
    with readable(path):
        content = torch.load(path, map_location="cpu", weights_only=True)
        weights, _ = content.pop("weights"), content["temperatures"]
        model = Model(**content["model"] | {"backbone": Backbone(**content["model"]["backbone"])})
        classifier = Classifier(content["viewpoints"], len(content["classes"]), model, tuple(content["shape"]))
        classifier.load_state_dict(weights)
        classifier.references = content["references"].numpy()
    return classifier.eval(), content


class Recogniser:
    """Class probabilities of raw view sets, as a user of a trained classifier has them.

    Args:
        path: a checkpoint of `save_classifier`.
    """

    def __init__(self, path: str | Path):
        self.classifier, content = load_classifier(path)
        self.classes, self.shape = content["classes"], tuple(content["shape"])
        self._kind, self._scale, self.temperatures = content["kind"], content["scale"], content["temperatures"]
        self._compute = choose("cpu", content["precision"])
        self._rest = dict(zip(content["rest_names"], content["rest_mean"].numpy(), strict=True))

    def rest(self, name: str = "") -> np.ndarray:
        """Rest (H, W) in counts of a session that the classifier knows (with baseline `quiet`, of a recording).

        Without a name it is the mean of all of them.

        Raises:
            ValueError: an unknown session.
        """
        if not name:
            return np.mean(list(self._rest.values()), axis=0)
        if name not in self._rest:
            raise ValueError(
                f"session is {name!r}; expected one of {', '.join(self._rest)}, "
                "or give the rest of the empty hand itself"
            )
        return self._rest[name]

    @torch.inference_mode()
    def probabilities(self, counts: np.ndarray, rest: np.ndarray | None = None) -> np.ndarray:
        """Class probabilities float32 (B, classes), a column for each of `classes`.

        Args:
            counts: raw counts (B, V, H, W), the views of a set at viewpoints 0 to V - 1, or from the earliest on for
                a system in the order of time; of a classifier with temperatures also (B, k, H, W) with fewer views, and
                the probabilities are calibrated, for frames of a recording at random.
            rest: of the empty hand in the same session, (H, W) counts; the mean of the known rests if None.

        Raises:
            ValueError: counts or rest of another shape, or counts that are not finite.
        """
        most, any_number = self.classifier.views, self.temperatures is not None
        fits = counts.ndim == 4 and counts.shape[2:] == self.shape
        if not fits or not (1 if any_number else most) <= counts.shape[1] <= most:
            raise ValueError(
                f"counts has shape {counts.shape}; expected (sets, views, rows, columns) = "
                f"(any, {f'1 to {most}' if any_number else most}, {', '.join(map(str, self.shape))})"
            )
        features = self._features(counts.reshape(-1, *self.shape), rest)
        return self._answers(features.unflatten(0, counts.shape[:2]))

    def _features(self, counts: np.ndarray, rest: np.ndarray | None) -> Tensor:
        """Features (n, C) of raw counts (n, H, W)."""
        rest = self.rest() if rest is None else rest
        if rest.shape != self.shape:
            raise ValueError(f"rest has shape {rest.shape}; expected {self.shape}")
        if not (np.isfinite(counts).all() and np.isfinite(rest).all()):
            raise ValueError("counts or rest holds values that are not finite; expected a number from every sensor")
        inputs = transform(np.subtract(counts, rest, dtype=np.float64), self._kind, self._scale)
        if not len(counts):
            return torch.empty(0, self.classifier.backbone.features)
        with self._compute.autocast():
            return features_of(self.classifier.backbone, self._compute.frames(torch.from_numpy(inputs)))

    def _answers(self, features: Tensor) -> np.ndarray:
        """Class probabilities (B, classes) of view sets of features (B, k, ...)."""
        count, views = features.shape[:2]
        if not count:
            return np.empty((0, len(self.classes)), dtype=np.float32)
        sets = torch.arange(count * views).view(count, views)
        logits = logits_of_sets(self.classifier.head, features.flatten(0, 1), sets)
        heat = self.temperatures[views - 1] if self.temperatures is not None else 1.0
        return (logits / heat).softmax(dim=-1).numpy()

    @torch.inference_mode()
    def until_certain(
        self, frames: Iterable[np.ndarray], stop_at: float, rest: np.ndarray | None = None
    ) -> tuple[np.ndarray, int]:
        """Class probabilities (classes,) and the number of touches they took: no more than are needed.

        The probabilities are calibrated for frames of a recording at random: leave time between touches, since frames
        that follow one another say nearly the same.

        Args:
            frames: raw counts (H, W), one after another; none is taken after the answer is certain, or after V.
            stop_at: the probability that is certain enough.
            rest: see `probabilities`.

        Raises:
            ValueError: the classifier takes V views alone; `stop_at` is no probability; no frames, or of another shape,
                or not finite.
        """
        if self.temperatures is None:
            raise ValueError(
                f"the classifier takes {self.classifier.views} views and no fewer; fine-tune it with finetune.sizes "
                "random and split.validation above 0"
            )
        if not 0 <= stop_at <= 1:
            raise ValueError(f"stop_at is {stop_at}; expected a probability, 0 to 1")
        taken, found = [], None
        for frame in frames:
            if np.shape(frame) != self.shape:
                raise ValueError(f"a frame has shape {np.shape(frame)}; expected {self.shape}")
            taken.append(self._features(np.asarray(frame)[None], rest))
            (found,) = self._answers(torch.stack(taken, dim=1))
            if found.max() >= stop_at or len(taken) == self.classifier.views:
                break
        if found is None:
            raise ValueError("frames holds none; expected one touch or more")
        return found, len(taken)
