"""What is measured on: some anchors of each class, their views, and networks trained on them for a short while."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.params import Finetune, Params, Pretrain
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import TEST, TRAIN, Frames
from tactile_viewgcn.tables.transform import full_scale
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.augmentation import Augmentation
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.sampling import ViewSets, random_clusters
from tactile_viewgcn.views.viewpoints import viewpoints

PRETRAIN_EPOCHS, FINETUNE_EPOCHS = 8, 4  # of the short training, for logits that mean something


@dataclass(frozen=True)
class Sample:
    """A small table of anchors alone, its views, and networks trained on it; `rounds` of each timing.

    `pretrained` are the weights that fine-tuning starts with, `classifier` is in evaluation mode.
    """

    params: Params
    compute: Compute
    rounds: int
    table: Frames
    views: Views
    pretrained: dict[str, dict[str, Tensor]]
    classifier: Classifier

    def tensors(self, side: int) -> tuple[Tensor, Tensor]:
        """Network input (n, 1, H, W) of a side's frames, contiguous, and their classes (n,), on the device."""
        index, device = self.table.on(side), self.compute.device
        frames = torch.from_numpy(self.table.inputs(index)).unsqueeze(1)
        return frames.to(device), torch.from_numpy(self.table.label[index].astype(np.int64)).to(device)

    def pool(self, side: int) -> np.ndarray:
        """Pool (n,) of a side's frames: their object."""
        return np.unique(self.table.label[self.table.on(side)], return_inverse=True)[1]

    def view_sets(self, side: int) -> np.ndarray:
        """A view set of indices into a side's frames around each of them, (n, V), in random order."""
        pool, rng = self.pool(side), stream(self.params.seed, "speed.sets")
        sets = ViewSets(random_clusters(pool, self.params.views, rng), pool, self.params.views)
        return sets.draw(rng.permutation(len(pool)), rng)

    def augmentation(self, training: Pretrain | Finetune) -> Augmentation:
        """The changes of a training's frames."""
        noise = training.noise * full_scale(self.table.transform, self.table.scale)
        return Augmentation(noise, self.params.augment, torch.Generator(self.compute.device))


def take_sample(table: Frames, params: Params, compute: Compute, *, per_class: int, rounds: int) -> Sample:
    """The sample of a table."""
    table = anchors_of(table, per_class)
    places = viewpoints(params.views, params.viewpoints, params.seed)
    views = cluster_frames(table, places, params.cluster, stream(params.seed, "cluster"))
    pretrain = replace(params.pretrain, epochs=PRETRAIN_EPOCHS)
    short = replace(params, pretrain=pretrain, finetune=replace(params.finetune, epochs=FINETUNE_EPOCHS))
    backbone, linear, _ = pretrain_backbone(table, short, compute)
    pretrained = {"backbone": backbone.state_dict(), "classifier": linear.state_dict()}
    classifier, _ = finetune_classifier(table, views, pretrained, short, compute)
    return Sample(params, compute, rounds, table, views, pretrained, classifier.eval())


def anchors_of(table: Frames, per_class: int) -> Frames:
    """The table of at most so many training and test anchors of each class, spread evenly over all of its anchors."""
    chosen = []
    for side in (TRAIN, TEST):
        for label in range(len(table.classes)):
            index = np.flatnonzero(table.anchor & (table.side == side) & (table.label == label))
            count = min(per_class, len(index))
            chosen.append(index[np.linspace(0, len(index), count, endpoint=False).astype(int)])
    index = np.sort(np.concatenate(chosen))
    per_frame = ("counts", "label", "recording", "session", "group", "side", "anchor", "baseline", "time")
    return replace(table, **{name: getattr(table, name)[index] for name in per_frame})
