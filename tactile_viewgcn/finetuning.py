"""The whole network, trained on view sets from a pretrained backbone."""

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.frames import Frames, full_scale
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.nn.view_gcn import shape_and_view_loss
from tactile_viewgcn.params import Finetune, Model
from tactile_viewgcn.randomness import stream, torch_seed
from tactile_viewgcn.split import TRAIN, VALIDATION
from tactile_viewgcn.training import compounding_cosine, error_rate, fit, generators, set_losses
from tactile_viewgcn.views import Views


class Side:
    """The frames of one side as tensors, and the view sets drawn from them."""

    def __init__(self, side: int, table: Frames, views: Views, compute: Compute, seed: int, assignment: str):
        self._index, self._views, self._assignment = table.on(side), views, assignment
        self._rng = stream(seed, "finetune.draw", side)
        self.anchors = np.flatnonzero(table.anchor[self._index])
        self.frames = compute.frames(torch.from_numpy(table.inputs(self._index)))
        self.labels = torch.from_numpy(table.label[self._index].astype(np.int64)).to(compute.device)

    def draw(self) -> np.ndarray:
        """View sets (A, V) of indices into `frames`, one per anchor."""
        return self._views.on(self._index, self._rng).draw(self.anchors, self._rng, self._assignment)


def finetune_classifier(
    table: Frames,
    views: Views,
    weights: dict[str, Tensor],
    how: Finetune,
    model: Model,
    assignment: str,
    compute: Compute,
    seed: int,
) -> tuple[Classifier, dict[str, list[float]]]:
    """The classifier, its backbone started from `weights`, trained on one view set per anchor and epoch.

    Returns:
        classifier, and per epoch the loss and, where there is a validation side, its error.

    Raises:
        ValueError: the training diverges, or `model` does not fit the number of views.
    """
    torch.manual_seed(torch_seed(seed, "finetune.weights"))  # initial weights and dropout
    classifier = Classifier(torch.from_numpy(views.viewpoints), len(table.classes), model)
    classifier.backbone.load_state_dict(weights)
    if not how.backbone_dropout:
        classifier.backbone.dropout.p = 0.0
    classifier.to(compute.device, memory_format=torch.channels_last)
    optimiser = torch.optim.SGD(
        [{"params": classifier.backbone.parameters(), "lr": how.lr_backbone}, {"params": classifier.head.parameters()}],
        how.lr,
        momentum=how.momentum,
        weight_decay=how.weight_decay,
    )
    order, on_device = generators(seed, "finetune", compute.device)
    train, held_out = (Side(side, table, views, compute, seed, assignment) for side in (TRAIN, VALIDATION))
    kept = {"train": train.draw(), "validation": held_out.draw() if len(held_out.anchors) else None}

    def losses(epoch: int) -> Iterator[Tensor]:
        classifier.train()
        sets = kept["train"] if how.redraw == "never" or epoch == 0 else train.draw()
        return set_losses(
            classifier,
            train.frames,
            train.labels,
            sets,
            batch=how.batch,
            noise=how.noise * full_scale(table.kind, table.scale),
            loss=partial(shape_and_view_loss, view_loss=how.view_loss),
            compute=compute,
            order=order,
            on_device=on_device,
        )

    @torch.inference_mode()
    def validate() -> dict[str, float]:
        if kept["validation"] is None:
            return {}
        classifier.eval()
        sets = torch.from_numpy(kept["validation"]).to(compute.device)
        with compute.autocast():
            features = features_of(classifier.backbone, held_out.frames)
        logits = logits_of_sets(classifier.head, features, sets)
        return {"validation_error": error_rate(logits, held_out.labels[held_out.anchors])}

    def factor(epoch: int) -> float:
        return compounding_cosine(epoch, epochs=how.epochs) if how.schedule == "compounding_cosine" else 1.0

    steps = how.epochs * math.ceil(len(train.anchors) / how.batch)
    with tqdm(total=steps, desc="finetune", unit="batch", disable=None) as bar:
        curves = fit(how.epochs, optimiser, factor, losses, validate, bar)
    return classifier, curves
