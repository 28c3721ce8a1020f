"""The whole network, trained on view sets from a pretrained backbone."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.checkpoint import Checkpoint, Progress
from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.epochs import fit
from tactile_viewgcn.frames import Frames, full_scale
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.params import Finetune, Params
from tactile_viewgcn.randomness import stream, torch_seed
from tactile_viewgcn.split import TRAIN, VALIDATION
from tactile_viewgcn.training import (
    Disturbance,
    FeatureBank,
    error_rate,
    factor_of,
    generator,
    optimiser_of,
    parts,
    set_losses,
)
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
    pretrained: dict[str, dict[str, Tensor]],
    params: Params,
    compute: Compute,
    keep: Path | None = None,
) -> tuple[Classifier, Progress]:
    """The classifier, begun with the pretrained weights and trained on one view set per anchor and epoch.

    A system that does not learn stays as it begins.

    Args:
        pretrained: weights of the `backbone` and of its linear `classifier`.
        params: their `seed`, `cluster.assignment`, `model`, `finetune` and `augment` are read.
        keep: the file where the training is kept after every epoch, and gone on with if it was.

    Returns:
        classifier, and how it went: per epoch the loss and, where there is a validation side, its error.

    Raises:
        ValueError: the training diverges in its first epoch, or `model` does not fit the number of views.
    """
    how, seed = params.finetune, params.seed
    torch.manual_seed(torch_seed(seed, "finetune.weights"))  # initial weights and dropout
    classifier = begun(table, views, pretrained, params)
    classifier.to(compute.device, memory_format=torch.channels_last)
    if not classifier.head.learns:
        return classifier, Progress()
    optimiser = optimiser_of(
        how,
        [{"params": classifier.backbone.parameters(), "lr": how.lr_backbone}, {"params": classifier.head.parameters()}],
    )
    on_device = generator(seed, "finetune.noise", compute.device)
    disturb = Disturbance(how.noise * full_scale(table.kind, table.scale), params.augment, on_device)
    drawn_from = views.unclustered() if how.draw == "random" else views
    train, held_out = (
        Side(side, table, of, compute, seed, params.cluster.assignment)
        for side, of in ((TRAIN, drawn_from), (VALIDATION, views))
    )
    first, held_out_sets = train.draw(), held_out.draw() if len(held_out.anchors) else None
    state = {"classifier": classifier, "optimiser": optimiser}
    bank = None
    if how.reuse > 1 and len(views.viewpoints) > 1:
        bank = state["bank"] = FeatureBank(len(train.frames), classifier.given, compute)
    checkpoint = Checkpoint(keep, state, {"noise": on_device}, {"draw": train.rng}, compute.device)

    def losses(epoch: int) -> Iterator[Tensor]:
        classifier.train()
        if bank is not None and epoch == 0:
            bank.fill(classifier.backbone, train.frames, batch=how.batch, disturb=disturb)
        drawn = first if how.redraw == "never" or epoch == 0 else train.draw()
        plan = train.plan(drawn, how)
        return set_losses(classifier, train.frames, train.labels, plan, bank=bank, disturb=disturb, compute=compute)

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

    steps = how.epochs * parts(len(train.anchors), how.batch)
    with tqdm(total=steps, desc="finetune", unit="batch", disable=None) as bar:
        progress = fit(how.epochs, optimiser, factor_of(how), losses, validate, bar, checkpoint)
    return classifier, progress


def begun(table: Frames, views: Views, pretrained: dict[str, dict[str, Tensor]], params: Params) -> Classifier:
    """The classifier as it is before its training, see `finetune_classifier`."""
    places = torch.from_numpy(views.viewpoints)
    classifier = Classifier(places, len(table.classes), params.model, table.counts.shape[1:])
    classifier.references = views.references
    classifier.backbone.load_state_dict(pretrained["backbone"])
    classifier.head.begin(pretrained["classifier"])
    if not params.finetune.backbone_dropout:
        classifier.backbone.dropout.p = 0.0
    return classifier
