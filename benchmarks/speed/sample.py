"""What is measured on: some anchors of each class, and the pipeline's trained network."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.params import Finetune, Params, Pretrain
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.frames import TEST, TRAIN, Frames, full_scale
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.inputs import Augmentation
from tactile_viewgcn.views.sampling import random_clusters, sets_of

PER_FRAME = ("counts", "label", "recording", "session", "grasp", "group", "side", "anchor", "baseline", "time")


@dataclass(frozen=True)
class Sample:
    """A small table of anchors alone, and a network in evaluation mode; `rounds` of each timing."""

    classifier: Classifier
    table: Frames
    params: Params
    compute: Compute
    rounds: int

    @property
    def views(self) -> Views:
        """Random clusters of the frames of an object on one side."""
        pool = np.unique(np.stack([self.table.side, self.table.label]), axis=1, return_inverse=True)[1].ravel()
        clusters = random_clusters(pool, self.classifier.views, stream(self.params.seed, "speed.clusters"))
        return Views(clusters, pool, self.classifier.viewpoints.cpu().numpy())

    def tensors(self, side: int) -> tuple[Tensor, Tensor]:
        """Network input (n, 1, H, W) of a side's frames, contiguous, and their classes (n,), on the device."""
        index, device = self.table.on(side), self.compute.device
        frames = torch.from_numpy(self.table.inputs(index)).unsqueeze(1)
        return frames.to(device), torch.from_numpy(self.table.label[index].astype(np.int64)).to(device)

    def view_sets(self, side: int) -> np.ndarray:
        """A view set of indices into a side's frames around each of them, (n, V), in random order."""
        index, rng = self.table.on(side), stream(self.params.seed, "speed.sets")
        return sets_of(self.views, index, rng).draw(rng.permutation(len(index)), rng)

    def augmentation(self, training: Pretrain | Finetune) -> Augmentation:
        """The changes of a training's frames."""
        noise = training.noise * full_scale(self.table.transform, self.table.scale)
        return Augmentation(noise, self.params.augment, torch.Generator(self.compute.device))


def anchors_of(table: Frames, per_class: int) -> Frames:
    """The table of at most `per_class` training and test anchors of each class, spread evenly over its anchors."""
    chosen = []
    for side in (TRAIN, TEST):
        for label in range(len(table.classes)):
            index = np.flatnonzero(table.anchor & (table.side == side) & (table.label == label))
            count = min(per_class, len(index))
            chosen.append(index[np.linspace(0, len(index), count, endpoint=False).astype(int)])
    index = np.sort(np.concatenate(chosen))
    return replace(table, **{name: getattr(table, name)[index] for name in PER_FRAME})
