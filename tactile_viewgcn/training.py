"""The two trainings: the backbone on single frames, then the whole network on view sets.

What differs is what a batch holds and what its loss is; the optimiser and how the learning rate moves are parameters
of both.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.compute import Compute
from tactile_viewgcn.params import Augment, Finetune, Pretrain
from tactile_viewgcn.randomness import torch_seed


def parts(count: int, size: int) -> int:
    """Into how many batches of at most `size` a number of examples falls.

    Fewer, and larger by one, where a batch would hold a single example, which batch normalisation cannot use.
    """
    return max(1, min(math.ceil(count / size), count // 2))


def optimiser_of(how: Pretrain | Finetune, groups: list[dict]) -> torch.optim.Optimizer:
    """By `optimiser` of a training's parameters; `momentum` is of `sgd` alone."""
    if how.optimiser == "sgd":
        return torch.optim.SGD(groups, how.lr, momentum=how.momentum, weight_decay=how.weight_decay)
    kind = torch.optim.Adam if how.optimiser == "adam" else torch.optim.AdamW
    return kind(groups, how.lr, weight_decay=how.weight_decay)


def factor_of(how: Pretrain | Finetune) -> Callable[[int], float]:
    """Factor on the learning rates in each epoch, by `schedule` of a training's parameters."""
    return {
        "constant": lambda _: 1.0,
        "halving": lambda epoch: halving(epoch, every=how.halve_every, early=how.halve_early),
        "compounding_cosine": lambda epoch: compounding_cosine(epoch, epochs=how.epochs),
        "cosine": lambda epoch: (1 + math.cos(math.pi * epoch / how.epochs)) / 2,
        "tenth_in_100": lambda epoch: 0.1 ** (epoch / 100),  # Sundaram et al. 2019
    }[how.schedule]


def halving(epoch: int, *, every: int, early: int = 0) -> float:
    """Factor on the learning rate that halves every `every` epochs, each halving `early` epochs sooner."""
    return 0.5 ** ((epoch + early) // every)


def compounding_cosine(epoch: int, *, epochs: int) -> float:
    """The released code's fine-tuning schedule: from epoch 2 on, (1 + cos(pi e / epochs)) / 2, multiplied up."""
    return math.prod((1 + math.cos(math.pi * e / epochs)) / 2 for e in range(2, epoch + 1))


def error_rate(logits: Tensor, labels: Tensor) -> float:
    """Share of rows whose largest logit is not the label's."""
    return float((logits.argmax(dim=-1) != labels).float().mean())


@dataclass(frozen=True)
class Disturbance:
    """What is done to every frame that is learnt from.

    Args:
        noise: standard deviation of white noise, in units of network input.
        augment: what a frame may also look like, see params.yaml.
        rng: a generator on the device.
    """

    noise: float
    augment: Augment
    rng: torch.Generator

    def __call__(self, frames: Tensor) -> Tensor:
        """Frames (B, 1, H, W), a new tensor unless there is nothing to do."""
        how = self.augment
        if how.shift:
            frames = shifted(frames, how.shift, self.rng)
        if how.gain:
            gain = torch.empty(len(frames), 1, 1, 1, dtype=frames.dtype, device=frames.device)
            frames = frames * gain.normal_(0, how.gain, generator=self.rng).exp()
        if how.drop:
            frames = frames * (torch.rand(frames.shape, generator=self.rng, device=frames.device) >= how.drop)
        if self.noise:
            frames = torch.empty_like(frames).normal_(0, self.noise, generator=self.rng).add_(frames)
        return frames


def shifted(frames: Tensor, most: int, rng: torch.Generator) -> Tensor:
    """Each frame (B, 1, H, W) moved by up to so many rows and columns, at random; what moves in is 0."""
    batch, _, height, width = frames.shape
    padded = functional.pad(frames, (most,) * 4)
    offset = torch.randint(2 * most + 1, (2, batch, 1), generator=rng, device=frames.device)
    rows = offset[0] + torch.arange(height, device=frames.device)  # (B, H)
    columns = offset[1] + torch.arange(width, device=frames.device)
    number = torch.arange(batch, device=frames.device)[:, None, None]
    return padded[number, 0, rows[:, :, None], columns[:, None, :]].unsqueeze(1)


def frame_losses(
    backbone: nn.Module,
    classifier: nn.Module,
    frames: Tensor,
    labels: Tensor,
    *,
    batch: int,
    disturb: Disturbance,
    compute: Compute,
    order: torch.Generator,
) -> Iterator[Tensor]:
    """Cross-entropy of batches of single frames (n, 1, H, W), for one epoch.

    The batches differ by one frame at most, and no frame is left out.
    """
    for index in torch.randperm(len(frames), generator=order).tensor_split(parts(len(frames), batch)):
        with compute.autocast():
            features = backbone(disturb(compute.take(frames, index)))
        yield functional.cross_entropy(classifier(features.float()), compute.take(labels, index))


class FeatureBank(nn.Module):
    """Features, or maps, of n frames, each as the backbone gave it last, for views that it need not see again.

    While the network is fine-tuned they change slowly. They come from training mode, noise and dropout included.

    Args:
        frames: n; given: the shape of what the backbone gives of one, (C,) or (C, H, W).
    """

    def __init__(self, frames: int, given: tuple[int, ...], compute: Compute):
        super().__init__()
        self._compute = compute
        kind = torch.bfloat16 if len(given) > 1 and compute.precision == "bfloat16" else compute.dtype
        self.register_buffer("values", torch.zeros(frames, *given, dtype=kind, device=compute.device))

    @torch.no_grad()
    def fill(self, backbone: nn.Module, frames: Tensor, *, batch: int, disturb: Disturbance) -> None:
        """The features of all frames (n, 1, H, W), in batches in the random order of torch's own generator.

        The backbone is left in training mode; what its batch normalisation has seen goes into its running moments.
        """
        backbone.train()
        order = torch.randperm(len(frames))
        with self._compute.autocast():
            for index in order.tensor_split(parts(len(order), batch)):
                features = backbone(disturb(self._compute.take(frames, index)))
                self.values[self._compute.bring(index)] = features

    def nodes(self, sets: np.ndarray, fresh: np.ndarray, features: Tensor) -> Tensor:
        """The features (B, k, ...) of view sets (B, k), those (B, f, ...) of their columns `fresh` (B, f) as given.

        These are kept. Of a frame that is there more than once the first is kept.
        """
        bring = self._compute.bring
        rows = np.broadcast_to(np.arange(len(sets))[:, None], fresh.shape)
        places = (bring(torch.from_numpy(rows.copy())), bring(torch.from_numpy(fresh)))
        nodes = self.values[bring(torch.from_numpy(sets))].index_put(places, features)
        frames, first = np.unique(sets[rows, fresh], return_index=True)
        kept = features.detach().flatten(0, 1)[bring(torch.from_numpy(first))]
        self.values[bring(torch.from_numpy(frames))] = kept
        return nodes


def set_losses(
    classifier: nn.Module,
    frames: Tensor,
    labels: Tensor,
    plan: Iterable[tuple[np.ndarray, np.ndarray]],
    *,
    bank: FeatureBank | None,
    disturb: Disturbance,
    compute: Compute,
) -> Iterator[Tensor]:
    """The system's loss of batches of view sets, for one epoch.

    Args:
        classifier: its `backbone` makes features of frames, its `head`, a system, logits of their sets.
        frames: (n, 1, H, W), in the order of time inside a recording; labels: (n,).
        plan: of each batch its view sets (B, k) of indices into the frames, all of one label, and the columns (B, f)
            whose frames pass the backbone.
        bank: has the features of the others; None where there are no others.
    """
    for sets, fresh in plan:
        if classifier.head.in_time_order:
            sets, fresh = in_time_order(sets, fresh)
        index = np.take_along_axis(sets, fresh, axis=1)
        batch = disturb(compute.take(frames, torch.from_numpy(index.ravel())))
        with compute.autocast():
            features = classifier.backbone(batch).unflatten(0, index.shape)
        nodes = features if bank is None else bank.nodes(sets, fresh, features)
        logits, also = classifier.head(nodes)
        yield classifier.head.loss(logits, also, compute.take(labels, torch.from_numpy(sets[:, 0])))


def in_time_order(sets: np.ndarray, fresh: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """View sets (B, k) with rising indices, and where their columns `fresh` (B, f) are then, rising too."""
    order = np.argsort(sets, axis=1, kind="stable")
    place = np.argsort(order, axis=1)
    return np.take_along_axis(sets, order, axis=1), np.sort(np.take_along_axis(place, fresh, axis=1), axis=1)


def generator(seed: int, purpose: str, device: torch.device | str = "cpu") -> torch.Generator:
    """A stream of random numbers of one purpose on a device."""
    return torch.Generator(device).manual_seed(torch_seed(seed, purpose))
