"""Batches of view sets and their loss: which frames pass through the backbone, and where the others' features are from.

Fine-tuning changes features slowly, so most views of a set take the feature that their frame had when it last passed.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.params import Finetune, Params
from tactile_viewgcn.randomness import stream, torch_generator
from tactile_viewgcn.tables.frames import Frames, Views
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.training.optim import num_batches
from tactile_viewgcn.views.sampling import anchor_first, sets_of


class Batch(NamedTuple):
    """B view sets of k frames each, f of which pass through the backbone.

    Two sets around the anchors 7 and 3, with k = 4 and f = 2:

        sets      [[2, 7, 5, 9],      indices of frames, by cluster
                   [3, 8, 5, 7]]
        fresh     [[1, 3],            columns that pass: the anchor's, and one at random
                   [0, 3]]
        frames    of 7, 9, 3 and 7    the others, 2, 5, 8 and 5, are taken from the bank
        first     [0, 1, 2, 0]        frame 7 passes twice: its first feature is the one that the bank keeps

    Attributes:
        frames: (B * f, 1, H, W) that pass, with noise.
        labels: (B,) classes.
        sets: (B, k) indices of frames.
        fresh: (B, f) columns of `sets` that pass, sorted.
        first: (B * f,) for each frame that passes, its first place among them.
    """

    frames: Tensor
    labels: Tensor
    sets: Tensor
    fresh: Tensor
    first: Tensor


class SideViewSets:
    """The frames of one side, with the noise of fine-tuning, and the view sets drawn from their clusters `views`."""

    def __init__(self, side: int, table: Frames, views: Views, params: Params, compute: Compute):
        self._index, self._views, self._params, self._compute = table.on(side), views, params, compute
        self.rng = stream(params.seed, "finetune.draw", side)
        self.noise_rng = torch_generator(params.seed, "finetune.noise", compute.device)
        self.anchors = np.flatnonzero(table.anchor[self._index])
        self.frames = FrameInputs(table, self._index, compute, noise=params.finetune.noise, rng=self.noise_rng)

    def draw(self) -> np.ndarray:
        """View sets (A, V) of indices into `frames`, one per anchor."""
        sets = sets_of(self._views, self._index, self.rng)
        return sets.draw(self.anchors, self.rng, self._params.cluster.assignment)

    def batches(self, drawn: np.ndarray, *, in_time_order: bool = False) -> Iterator[Batch]:
        """Batches of the drawn view sets (A, V) in random order; their sizes differ by one at most.

        Args:
            in_time_order: frames of a set are sorted; they are numbered in the order of time inside a recording.
        """
        config, order = self._params.finetune, self.rng.permutation(len(drawn))
        for index in np.array_split(order, num_batches(len(order), config.batch)):
            sets, fresh = choose_fresh(drawn[index], self.anchors[index], config, self.rng)
            if in_time_order:
                sets, fresh = sort_by_time(sets, fresh)
            passing = np.take_along_axis(sets, fresh, axis=1).ravel()
            frames = self.frames.noisy(torch.from_numpy(passing))
            labels = self.frames.labels[self._compute.to_device(torch.from_numpy(sets[:, 0]))]
            parts = (sets, fresh, first_places(passing))
            yield Batch(frames, labels, *(self._compute.to_device(torch.from_numpy(part)) for part in parts))


def choose_fresh(
    sets: np.ndarray, anchors: np.ndarray, config: Finetune, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The `sets` and the columns `fresh` of a `Batch`, from view sets (B, V) around anchors (B,).

    With `num_views: full` k is V; with `random` it is drawn from 1 to V, one number for the batch, and a set of fewer
    than V frames begins with its anchor. k / `feature_reuse` columns are fresh, rounded up, the anchor's among them.
    """
    columns, views = anchor_first(sets, anchors, rng), sets.shape[1]
    if config.num_views == "random" and (fewer := int(rng.integers(1, views + 1))) < views:
        sets = np.take_along_axis(sets, columns[:, :fewer], axis=1)
        columns, views = np.broadcast_to(np.arange(fewer), sets.shape), fewer
    return sets, np.sort(columns[:, : math.ceil(views / config.feature_reuse)], axis=1)


def first_places(index: np.ndarray) -> np.ndarray:
    """For each entry of `index` (n,) the first place with that value."""
    _, first, place = np.unique(index, return_index=True, return_inverse=True)
    return first[place]


def sort_by_time(sets: np.ndarray, fresh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """View sets (B, k) sorted by index, and where their columns `fresh` (B, f) are then, sorted too."""
    order = np.argsort(sets, axis=1, kind="stable")
    place = np.argsort(order, axis=1)
    return np.take_along_axis(sets, order, axis=1), np.sort(np.take_along_axis(place, fresh, axis=1), axis=1)


class SetLoss(nn.Module):
    """A network's loss of a batch of view sets, with a bank of the latest features, or maps, of training frames.

    The bank's features are from training mode, with noise and dropout.

    Args:
        bank_size: number of training frames; 0: no bank, all frames of a set pass through the backbone.
    """

    bank: Tensor

    def __init__(self, network: ViewNetwork, compute: Compute, bank_size: int = 0):
        super().__init__()
        self.network, self.compute, shape = network, compute, network.feature_shape
        dtype = torch.bfloat16 if len(shape) > 1 and compute.precision == "bfloat16" else torch.float32
        self.register_buffer("bank", torch.zeros((bank_size, *shape), dtype=dtype, device=compute.device))

    @torch.no_grad()
    def fill_bank(self, frames: FrameInputs, batch: int) -> None:
        """Store the features of all frames, in batches in random order, from torch's default generator.

        The backbone is left in training mode, and the running moments of its batch normalisation are updated.
        """
        self.network.backbone.train()
        with self.compute.autocast():
            for index in torch.randperm(len(frames)).tensor_split(num_batches(len(frames), batch)):
                self.bank[self.compute.to_device(index)] = self.network.backbone(frames.noisy(index))

    def forward(self, frames: Tensor, labels: Tensor, sets: Tensor, fresh: Tensor, first: Tensor) -> Tensor:
        """The loss of a `Batch`, a scalar; the features of its frames are stored."""
        with self.compute.autocast():
            views = self.network.backbone(frames).unflatten(0, fresh.shape)
        if len(self.bank):
            views = self.with_bank(views, sets, fresh, first)
        logits, aux = self.network.head(views)
        return self.network.head.loss(logits, aux, labels)

    def with_bank(self, features: Tensor, sets: Tensor, fresh: Tensor, first: Tensor) -> Tensor:
        """Features (B, k, ...) of view sets: `features` (B, f, ...) in the fresh columns, stored ones in the others."""
        rows = torch.arange(len(sets), device=sets.device)[:, None].expand_as(fresh)
        views = self.bank[sets].index_put((rows, fresh), features)
        self.bank[sets.gather(1, fresh).flatten()] = features.detach().flatten(0, 1)[first]
        return views
