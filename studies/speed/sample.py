"""What the study measures on: a part of the frames that is the same size for every source, its views and weights."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import torch

from tactile_viewgcn.classifier import Classifier
from tactile_viewgcn.clustering import cluster_table
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.finetuning import finetune_classifier
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.params import Finetune, Pretrain
from tactile_viewgcn.pretraining import pretrain_backbone
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.split import TEST, TRAIN
from tactile_viewgcn.viewpoints import viewpoints
from tactile_viewgcn.views import Views

PER_FRAME = ("counts", "label", "recording", "session", "group", "side", "anchor", "rest", "time")
OF_A_CLASS = 48  # frames on a side, at most
ANCHORS = 336  # training anchors of the fine-tuning that is timed, at most
PRETRAIN_EPOCHS, FINETUNE_EPOCHS, REUSE = 3, 2, 4  # of the short training, for logits that mean something


@dataclass(frozen=True)
class Sample:
    """A small table, the clusters of its training side, and networks trained on it for a short while.

    Attributes:
        few: the table with the anchors of some classes only; anchors stay in whole pools, as in training.
        pretrained: weights; classifier: in evaluation mode.
    """

    table: Frames
    views: Views
    few: Frames
    pretrained: dict[str, dict[str, torch.Tensor]]
    classifier: Classifier


def sample(table: Frames, params: SimpleNamespace, compute: Compute) -> Sample:
    """The sample of a table.

    Raises:
        ValueError: the table has no anchors to train or to test on.
    """
    table = smaller(table)
    for side, name in ((TRAIN, "training"), (TEST, "test")):
        if not (table.anchor & (table.side == side)).any():
            raise ValueError(f"the frames have no anchors on the {name} side; expected some: see split in params.yaml")
    places = viewpoints(params.views, params.viewpoints, params.seed)
    views = cluster_table(table, places, params.cluster, stream(params.seed, "cluster"))
    short: Pretrain = replace(params.pretrain, epochs=PRETRAIN_EPOCHS)
    few = SimpleNamespace(**vars(params) | {"pretrain": short})
    backbone, classifier, _ = pretrain_backbone(table, few, compute)
    weights = {"backbone": backbone.state_dict(), "classifier": classifier.state_dict()}
    how: Finetune = replace(params.finetune, epochs=FINETUNE_EPOCHS, reuse=REUSE, sizes="full")
    few = SimpleNamespace(**vars(params) | {"finetune": how})
    classifier = finetune_classifier(table, views, weights, few, compute)[0]
    return Sample(table, views, fewer_anchors(table), weights, classifier.eval())


def smaller(table: Frames) -> Frames:
    """At most so many training and test frames of each class, the anchors first, spread evenly over its frames."""
    kept = []
    for side in (TRAIN, TEST):
        for label in np.unique(table.label):
            own = np.flatnonzero((table.side == side) & (table.label == label))
            anchors, others = own[table.anchor[own]], own[~table.anchor[own]]
            taken = _spread(anchors, OF_A_CLASS)
            kept += [taken, _spread(others, OF_A_CLASS - len(taken))]
    index = np.sort(np.concatenate(kept))
    return replace(table, **{name: getattr(table, name)[index] for name in PER_FRAME})


def _spread(index: np.ndarray, count: int) -> np.ndarray:
    return index[np.linspace(0, len(index) - 1, min(count, len(index))).round().astype(int)]


def fewer_anchors(table: Frames) -> Frames:
    """The training anchors of the first classes that make enough of them; none elsewhere on the training side."""
    training = table.anchor & (table.side == TRAIN)
    before = np.cumsum(np.bincount(table.label[training], minlength=len(table.classes)))
    enough = np.searchsorted(before, min(ANCHORS, before[-1]))
    return replace(table, anchor=table.anchor & ((table.side != TRAIN) | (table.label <= enough)))


def tensors(table: Frames, side: int, compute: Compute) -> tuple[torch.Tensor, torch.Tensor]:
    """The frames of a side as they lie in the table, (n, 1, H, W), and their labels (n,), on the device."""
    index = table.on(side)
    frames = torch.from_numpy(table.inputs(index)).unsqueeze(1)
    return frames.to(compute.device), torch.from_numpy(table.label[index].astype(np.int64)).to(compute.device)
