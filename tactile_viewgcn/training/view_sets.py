"""Batches of view sets and their loss: which frames pass through the backbone, and where the others' features are from.

Fine-tuning changes features slowly, so most views of a set take the feature that their frame had
when it last passed.
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
    """B view sets of k frames each, and the n of their frames that pass through the backbone.

    An example of two sets with k = 4 and `feature_reuse: 2`. Their anchors are the frames 7 and 3:

        sets      [[2, 7, 5, 9],
                   [3, 8, 5, 7]]
        passing   [1, 3, 4, 7]     places in `sets`, counted row by row: in each set the anchor's
        and one more frames    7, 9, 3, 7       what stands there; the others, 2, 5, 8 and 5, have
        their features from the bank

    Attributes:
        frames: (n, 1, H, W) with noise.
        labels: (B,) classes.
        sets: (B, k) indices of frames.
        passing: (n,) places of `frames` in `sets`, rising.
    """

    frames: Tensor
    labels: Tensor
    sets: Tensor
    passing: Tensor


class SideViewSets:
    """The frames of one side, with the noise of fine-tuning, and the view sets drawn from their clusters `views`."""

    def __init__(self, side: int, table: Frames, views: Views, params: Params, compute: Compute):
        self._index, self._views, self._params, self._compute = (
            table.on(side),
            views,
            params,
            compute,
        )
        self.rng = stream(params.seed, "finetune.draw", side)
        self.noise_rng = torch_generator(params.seed, "finetune.noise", compute.device)
        self.anchors = np.flatnonzero(table.anchor[self._index])
        self.frames = FrameInputs(
            table, self._index, compute, noise=params.finetune.noise, rng=self.noise_rng
        )

    def draw(self) -> np.ndarray:
        """View sets (A, V) of indices into `frames`, one per anchor."""
        sets = sets_of(self._views, self._index, self.rng)
        return sets.draw(self.anchors, self.rng, self._params.cluster.assignment)

    def batches(self, drawn: np.ndarray, *, in_time_order: bool = False) -> Iterator[Batch]:
        """Batches of the drawn view sets (A, V) in random order; their sizes differ by one at most.

        Args:
            in_time_order: frames of a set are sorted; they are numbered in the order of time inside
                a recording.
        """
        config, order = self._params.finetune, self.rng.permutation(len(drawn))
        for index in np.array_split(order, num_batches(len(order), config.batch)):
            sets, passes = choose_passing(drawn[index], self.anchors[index], config, self.rng)
            if in_time_order:
                by_time = np.argsort(sets, axis=1, kind="stable")
                sets, passes = (
                    np.take_along_axis(each, by_time, axis=1) for each in (sets, passes)
                )
            frames = self.frames.noisy(torch.from_numpy(sets[passes]))
            on_device = self._compute.to_device(torch.from_numpy(sets))
            passing = self._compute.to_device(torch.from_numpy(np.flatnonzero(passes)))
            yield Batch(frames, self.frames.labels[on_device[:, 0]], on_device, passing)


def choose_passing(
    sets: np.ndarray, anchors: np.ndarray, config: Finetune, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """The size of a batch's view sets, and which of their frames pass through the backbone.

    With `num_views: full` all V frames of a set are used. With `random` the number k is drawn from
    1 to V for the whole batch, and a set of fewer than V frames begins with its anchor. Of each set
    k / `feature_reuse` frames pass, rounded up: the anchor, and others at random.

    Args:
        sets: (B, V) indices of frames; anchors: (B,) the anchor of each.

    Returns:
        The sets, (B, k), and which of their frames pass, bool (B, k).
    """
    columns, views = anchor_first(sets, anchors, rng), sets.shape[1]
    if config.num_views == "random" and (fewer := int(rng.integers(1, views + 1))) < views:
        sets = np.take_along_axis(sets, columns[:, :fewer], axis=1)
        columns, views = np.broadcast_to(np.arange(fewer), sets.shape), fewer
    passes = np.zeros(sets.shape, dtype=bool)
    np.put_along_axis(passes, columns[:, : math.ceil(views / config.feature_reuse)], True, axis=1)
    return sets, passes


class SetLoss(nn.Module):
    """A network's loss of a batch of view sets, with a bank of the latest features, or maps, of training frames.

    The bank's features are from training mode, with noise and dropout.

    Args:
        bank_size: number of training frames; 0: no bank, all frames of a set pass through the
            backbone.
    """

    bank: Tensor

    def __init__(self, network: ViewNetwork, compute: Compute, bank_size: int = 0):
        super().__init__()
        self.network, self.compute, shape = network, compute, network.feature_shape
        self.capturable = network.head.capturable
        dtype = (
            torch.bfloat16 if len(shape) > 1 and compute.precision == "bfloat16" else torch.float32
        )
        self.register_buffer(
            "bank", torch.zeros((bank_size, *shape), dtype=dtype, device=compute.device)
        )

    @torch.no_grad()
    def fill_bank(self, frames: FrameInputs, batch: int) -> None:
        """Store the features of all frames, in batches in random order, from torch's default generator.

        The backbone is left in training mode, and the running moments of its batch normalisation
        are updated.
        """
        self.network.backbone.train()
        with self.compute.autocast():
            for index in torch.randperm(len(frames)).tensor_split(num_batches(len(frames), batch)):
                self.bank[self.compute.to_device(index)] = self.network.backbone(
                    frames.noisy(index)
                )

    def forward(self, frames: Tensor, labels: Tensor, sets: Tensor, passing: Tensor) -> Tensor:
        """The loss of a `Batch`, a scalar; the features of its frames are stored.

        Of a frame that passes several times the first of its features is stored.
        """
        with self.compute.autocast():
            views = features = self.network.backbone(frames)
        if len(self.bank):
            flat = sets.flatten()
            views, passed = self.bank[flat].index_put((passing,), features), flat[passing]
            first = (passed[:, None] == passed).byte().argmax(dim=1)
            self.bank[passed] = features.detach()[first]
        logits, aux = self.network.head(views.unflatten(0, sets.shape))
        return self.network.head.loss(logits, aux, labels)
