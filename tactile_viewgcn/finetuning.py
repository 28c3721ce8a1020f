"""The whole network, trained on view sets from a pretrained backbone."""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.checkpoint import Checkpoint, Progress
from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.frames import Frames, full_scale
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.nn.view_gcn import shape_and_view_loss
from tactile_viewgcn.params import Finetune, Model
from tactile_viewgcn.randomness import stream, torch_seed
from tactile_viewgcn.split import TRAIN, VALIDATION
from tactile_viewgcn.training import FeatureBank, compounding_cosine, error_rate, fit, generator, parts, set_losses
from tactile_viewgcn.views import Views


class Side:
    """The frames of one side as tensors, and the view sets drawn from them."""

    def __init__(self, side: int, table: Frames, views: Views, compute: Compute, seed: int, assignment: str):
        self._index, self._views, self._assignment = table.on(side), views, assignment
        self.rng = stream(seed, "finetune.draw", side)
        self.anchors = np.flatnonzero(table.anchor[self._index])
        self.frames = compute.frames(torch.from_numpy(table.inputs(self._index)))
        self.labels = torch.from_numpy(table.label[self._index].astype(np.int64)).to(compute.device)

    def draw(self) -> np.ndarray:
        """View sets (A, V) of indices into `frames`, one per anchor."""
        return self._views.on(self._index, self.rng).draw(self.anchors, self.rng, self._assignment)

    def plan(self, drawn: np.ndarray, how: Finetune) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Batches of the view sets drawn, in random order, that differ by one set at most.

        Yields:
            sets (B, k): all V frames of each, or as many for a whole batch as `sizes: random` draws, the anchor first.
            fresh (B, f): the columns whose frames are to pass the backbone, k / `reuse` of them, rounded up; rising,
                the anchor's always among them.
        """
        order = self.rng.permutation(len(drawn))
        for index in np.array_split(order, parts(len(order), how.batch)):
            sets, columns = drawn[index], self._anchor_first(drawn[index], self.anchors[index])
            views = sets.shape[1]
            if how.sizes == "random" and (fewer := int(self.rng.integers(1, views + 1))) < views:
                sets = np.take_along_axis(sets, columns[:, :fewer], axis=1)
                columns, views = np.broadcast_to(np.arange(fewer), sets.shape), fewer
            yield sets, np.sort(columns[:, : math.ceil(views / how.reuse)], axis=1)

    def _anchor_first(self, sets: np.ndarray, anchors: np.ndarray) -> np.ndarray:
        """The columns of each set (B, V) in random order, but its anchor's first."""
        key = self.rng.random(sets.shape)
        key[np.arange(len(sets)), (sets == anchors[:, None]).argmax(axis=1)] = -1
        return np.argsort(key, axis=1)


def finetune_classifier(
    table: Frames,
    views: Views,
    weights: dict[str, Tensor],
    how: Finetune,
    model: Model,
    assignment: str,
    compute: Compute,
    seed: int,
    keep: Path | None = None,
) -> tuple[Classifier, Progress]:
    """The classifier, its backbone started from `weights`, trained on one view set per anchor and epoch.

    Args:
        keep: the file where the training is kept after every epoch, and gone on with if it was.

    Returns:
        classifier, and how it went: per epoch the loss and, where there is a validation side, its error.

    Raises:
        ValueError: the training diverges, or `model` does not fit the number of views.
    """
    torch.manual_seed(torch_seed(seed, "finetune.weights"))  # initial weights and dropout
    width = len(weights["stem.norm.weight"])
    classifier = Classifier(torch.from_numpy(views.viewpoints), len(table.classes), model, width)
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
    on_device = generator(seed, "finetune.noise", compute.device)
    noise = how.noise * full_scale(table.kind, table.scale)
    train, held_out = (Side(side, table, views, compute, seed, assignment) for side in (TRAIN, VALIDATION))
    first, held_out_sets = train.draw(), held_out.draw() if len(held_out.anchors) else None
    state = {"classifier": classifier, "optimiser": optimiser}
    bank = None
    if how.reuse > 1 and len(views.viewpoints) > 1:
        bank = state["bank"] = FeatureBank(len(train.frames), classifier.backbone.features, compute)
    checkpoint = Checkpoint(keep, state, {"noise": on_device}, {"draw": train.rng}, compute.device)

    def losses(epoch: int) -> Iterator[Tensor]:
        classifier.train()
        if bank is not None and epoch == 0:
            bank.fill(classifier.backbone, train.frames, batch=how.batch, noise=noise, on_device=on_device)
        drawn = first if how.redraw == "never" or epoch == 0 else train.draw()
        return set_losses(
            classifier,
            train.frames,
            train.labels,
            train.plan(drawn, how),
            bank=bank,
            noise=noise,
            loss=partial(shape_and_view_loss, view_loss=how.view_loss),
            compute=compute,
            on_device=on_device,
        )

    @torch.inference_mode()
    def validate() -> dict[str, float]:
        if held_out_sets is None:
            return {}
        classifier.eval()
        sets = torch.from_numpy(held_out_sets).to(compute.device)
        with compute.autocast():
            features = features_of(classifier.backbone, held_out.frames)
        logits = logits_of_sets(classifier.head, features, sets)
        return {"validation_error": error_rate(logits, held_out.labels[held_out.anchors])}

    def factor(epoch: int) -> float:
        return compounding_cosine(epoch, epochs=how.epochs) if how.schedule == "compounding_cosine" else 1.0

    steps = how.epochs * parts(len(train.anchors), how.batch)
    with tqdm(total=steps, desc="finetune", unit="batch", disable=None) as bar:
        progress = fit(how.epochs, optimiser, factor, losses, validate, bar, checkpoint)
    return classifier, progress
