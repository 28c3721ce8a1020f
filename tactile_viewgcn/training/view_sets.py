"""Batches of view sets and their loss.

Only a part of a batch's frames passes through the backbone. Fine-tuning changes features slowly, so
each other frame takes the feature that it had when it last passed.
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

    Here is an example of two view sets with k = 4 and `feature_reuse: 2`. Their anchors are the
    frames 7 and 3:

        sets      [[2, 7, 5, 9],
                   [3, 8, 5, 7]]
        passing   [1, 3, 4, 7]     places in `sets`, counted row by row: in each set the place of
                                   the anchor, and one more
        frames    7, 9, 3, 7       the frames at these places

    The features of the other frames, 2, 5, 8 and 5, come from the bank.

    Attributes:
        frames: (n, 1, H, W) with noise.
        labels: (B,) classes.
        sets: (B, k) indices of frames.
        passing: (n,) rising places of `frames` in `sets`.
    """

    frames: Tensor
    labels: Tensor
    sets: Tensor
    passing: Tensor


class SubsetViewSets:
    """The frames of the training or the validation set, with noise, and view sets drawn from them.

    Args:
        subset: TRAIN or VALIDATION.
        table: the kept frames.
        views: clusters from which the view sets are drawn.
        params: the sections `finetune` and `cluster`, and the seed are used.
        compute: device and precision.

    Attributes:
        rng: generator of the draws.
        noise_rng: generator of the noise, on the device.
        anchors: (A,) positions of the anchors in `frames`.
        frames: network input (n, 1, H, W).
    """

    def __init__(self, subset: int, table: Frames, views: Views, params: Params, compute: Compute):
        self._index = table.on(subset)
        self._views = views
        self._params = params
        self._compute = compute
        self.rng = stream(params.seed, "finetune.draw", subset)
        self.noise_rng = torch_generator(params.seed, "finetune.noise", compute.device)
        self.anchors = np.flatnonzero(table.anchor[self._index])
        self.frames = FrameInputs(
            table, self._index, compute, noise=params.finetune.noise, rng=self.noise_rng
        )

    def draw(self) -> np.ndarray:
        """Return view sets (A, V) of positions in `frames`, one for each anchor."""
        sets = sets_of(self._views, self._index, self.rng)
        return sets.draw(self.anchors, self.rng, self._params.cluster.assignment)

    def batches(self, drawn: np.ndarray, *, in_time_order: bool = False) -> Iterator[Batch]:
        """Yield batches of view sets in random order; their sizes differ by one at most.

        Args:
            drawn: (A, V) view sets, as `draw` returns them.
            in_time_order: whether to sort the frames of each set by their numbers, which rise with
                time inside a recording.
        """
        config = self._params.finetune
        order = self.rng.permutation(len(drawn))
        for index in np.array_split(order, num_batches(len(order), config.batch)):
            sets, passes = choose_passing(drawn[index], self.anchors[index], config, self.rng)
            if in_time_order:
                by_time = np.argsort(sets, axis=1, kind="stable")
                sets = np.take_along_axis(sets, by_time, axis=1)
                passes = np.take_along_axis(passes, by_time, axis=1)
            frames = self.frames.noisy(torch.from_numpy(sets[passes]))
            on_device = self._compute.to_device(torch.from_numpy(sets))
            passing = self._compute.to_device(torch.from_numpy(np.flatnonzero(passes)))
            labels = self.frames.labels[on_device[:, 0]]
            yield Batch(frames, labels, on_device, passing)


def choose_passing(
    sets: np.ndarray, anchors: np.ndarray, config: Finetune, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return a batch's view sets, cut to k frames, and which frames pass through the backbone.

    With `num_views: full` all V frames of a set are used. With `random` the number k is drawn from
    1 to V for the whole batch, and a set of fewer than V frames begins with its anchor. In each set
    k / `feature_reuse` frames pass, rounded up: the anchor, and others at random.

    Args:
        sets: (B, V) indices of frames.
        anchors: (B,) the anchor of each set.
        config: the section `finetune`, for `num_views` and `feature_reuse`.
        rng: draws the number of views, and the frames that pass.

    Returns:
        The view sets (B, k), and bool (B, k), the frames that pass.
    """
    columns = anchor_first(sets, anchors, rng)
    views = sets.shape[1]
    if config.num_views == "random":
        fewer = int(rng.integers(1, views + 1))
        if fewer < views:
            sets = np.take_along_axis(sets, columns[:, :fewer], axis=1)
            columns = np.broadcast_to(np.arange(fewer), sets.shape)
            views = fewer
    count = math.ceil(views / config.feature_reuse)
    passes = np.zeros(sets.shape, dtype=bool)
    np.put_along_axis(passes, columns[:, :count], True, axis=1)
    return sets, passes


class SetLoss(nn.Module):
    """A network's loss of a batch of view sets, with a bank of features.

    The bank has the latest feature, or map, of each training frame. It was computed in training
    mode, with noise and dropout.

    Args:
        network: the network to train.
        compute: device and precision.
        bank_size: number of training frames. With 0 there is no bank, and all frames of a set pass
            through the backbone.

    Attributes:
        bank: (bank_size, *feature_shape).
        capturable: whether a GPU can record the loss.
    """

    bank: Tensor

    def __init__(self, network: ViewNetwork, compute: Compute, bank_size: int = 0):
        super().__init__()
        self.network = network
        self.compute = compute
        self.capturable = network.head.capturable
        shape = network.feature_shape
        takes_maps = len(shape) > 1
        dtype = torch.float32
        if takes_maps and compute.precision == "bfloat16":
            dtype = torch.bfloat16
        bank = torch.zeros((bank_size, *shape), dtype=dtype, device=compute.device)
        self.register_buffer("bank", bank)

    @torch.no_grad()
    def fill_bank(self, frames: FrameInputs, batch: int) -> None:
        """Store the features of all frames, in batches in random order.

        Torch's default generator draws the order. The backbone is left in training mode, and the
        running moments of its batch normalisation are updated.

        Args:
            frames: the frames of the training set, as many as the bank has places.
            batch: largest number of frames in a batch.
        """
        self.network.backbone.train()
        with self.compute.autocast():
            for index in torch.randperm(len(frames)).tensor_split(num_batches(len(frames), batch)):
                features = self.network.backbone(frames.noisy(index))
                self.bank[self.compute.to_device(index)] = features

    def forward(self, frames: Tensor, labels: Tensor, sets: Tensor, passing: Tensor) -> Tensor:
        """Return the loss of a `Batch`, a scalar, and store the features of its frames.

        If a frame passes several times, its first feature is stored.
        """
        with self.compute.autocast():
            features = self.network.backbone(frames)
        views = features
        if len(self.bank):
            flat = sets.flatten()
            passed = flat[passing]
            views = self.bank[flat].index_put((passing,), features)
            first = (passed[:, None] == passed).byte().argmax(dim=1)
            self.bank[passed] = features.detach()[first]
        logits, aux = self.network.head(views.unflatten(0, sets.shape))
        loss: Tensor = self.network.head.loss(logits, aux, labels)
        return loss
