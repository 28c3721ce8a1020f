"""What the fast paths gain: rates of training and evaluation beside plain counterparts, with the trained network.

Plain is float32, layer by layer and contiguous, in batches of 20 view sets as in the released code; every view of every
view set passes through the backbone.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.command import Result, benchmark, interleaved, median_ratio
from benchmarks.trained import CLASSIFIER, FRAMES, read_trained
from tactile_viewgcn.device import Compute, keep_freed_memory, select_device
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.params import Params
from tactile_viewgcn.provenance import processor
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import TEST, TRAIN, Frames, Views
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.optim import build_optimiser
from tactile_viewgcn.training.pretraining import FrameLoss
from tactile_viewgcn.training.replay import Replay
from tactile_viewgcn.views.sampling import random_clusters, sets_of

BATCHES, REUSES = (160, 32), (1, 8)  # frames of a step of pretraining; `finetune.feature_reuse`
SETS, PLAIN_SETS = 20, 60  # view sets of a plain batch, and those that the plain network is timed on
EPOCHS = 5  # of a timed fine-tuning, which share what the first one does once


@dataclass(frozen=True)
class Sample:
    """What is measured on: the trained network, and frames of both sides."""

    network: ViewNetwork
    table: Frames
    params: Params
    compute: Compute
    rounds: int

    def tensors(self, side: int) -> tuple[Tensor, Tensor]:
        """Network input (n, 1, H, W) of a side's frames, contiguous, and their classes (n,)."""
        index, device = self.table.on(side), self.compute.device
        frames = torch.from_numpy(self.table.inputs(index)).unsqueeze(1)
        return frames.to(device), torch.from_numpy(self.table.label[index].astype(np.int64)).to(device)

    @property
    def views(self) -> Views:
        """Random clusters of the frames of an object on one side."""
        pool = np.unique(np.stack([self.table.side, self.table.label]), axis=1, return_inverse=True)[1].ravel()
        clusters = random_clusters(pool, self.network.views, stream(self.params.seed, "speed.clusters"))
        return Views(clusters, pool, self.network.viewpoints.cpu().numpy())

    def sets(self, side: int) -> Tensor:
        """At most `PLAIN_SETS` view sets (n, V) of indices into a side's frames."""
        index, rng = self.table.on(side), stream(self.params.seed, "speed.sets")
        drawn = sets_of(self.views, index, rng).draw(rng.permutation(len(index))[:PLAIN_SETS], rng)
        return torch.from_numpy(drawn).to(self.compute.device)

    def compared(self, what: str, unit: str, fast: Callable, units: int, plain: Callable, plain_units: int) -> dict:
        """The row of a fast path and its plain counterpart, each of which does that many units of work in a call."""
        seconds = interleaved({"fast": fast, "plain": plain}, self.rounds)
        fast_unit, plain_unit = seconds["fast"] / units, seconds["plain"] / plain_units
        rates = {"fast": 1 / float(np.median(fast_unit)), "plain": 1 / float(np.median(plain_unit))}
        return {"what": what, "unit": f"{unit}/s"} | rates | {"ratio": median_ratio(plain_unit, fast_unit)}


@benchmark
def speed(params: Params, quick: bool) -> Result:
    """Time each fast path and its plain counterpart, round by round, on what `dvc repro` made.

    Takes some ten minutes on two cores; --quick is one round with one trial.
    """
    keep_freed_memory()
    network, table, params = read_trained(FRAMES, CLASSIFIER, params)
    if params.model.system != "view_gcn":
        raise UserError(f"model.system is {params.model.system}; expected view_gcn, which alone has plain counterparts")
    if quick:
        params = replace(params, evaluate=replace(params.evaluate, trials=1))
    compute = select_device(params.device, params.precision)
    sample = Sample(network.to(compute.device), table, params, compute, rounds=1 if quick else 3)
    rows = [time_step(sample, batch) for batch in BATCHES]
    rows += [time_finetuning(sample, reuse) for reuse in REUSES]
    rows += [time_trials(sample)]
    text = (
        f"{processor()}, {compute.device.type}, torch {torch.__version__} with {torch.get_num_threads()} threads; fast "
        f"path in {compute.precision}. Units of work in a second, medians of {sample.rounds} rounds of both in turn; "
        "the ratio is the median of the rounds' ratios."
    )
    return text, rows, None


def plain_network(network: ViewNetwork) -> ViewNetwork:
    """A copy whose stem is convolution, normalisation, ReLU and pooling, one after the other."""
    plain = deepcopy(network)
    stem = plain.backbone.stem
    plain.backbone.stem = nn.Sequential(stem.conv, stem.norm, nn.ReLU(), nn.MaxPool2d(3, stride=2, padding=1))
    return plain.to(memory_format=torch.contiguous_format)


def plain_answer(network: ViewNetwork, frames: Tensor, sets: Tensor) -> tuple[Tensor, list[Tensor]]:
    """Logits (B, classes), and what the loss needs, of view sets (B, V) of indices into frames (n, 1, H, W)."""
    return network.head(network.backbone(frames[sets].flatten(0, 1)).unflatten(0, sets.shape))


def time_step(sample: Sample, batch: int) -> dict:
    """The step of pretraining; a CUDA card repeats the fast one's kernels as a graph."""
    frames, labels = (values[torch.arange(batch) % len(values)] for values in sample.tensors(TRAIN))
    plain, compute = Compute(sample.compute.device, "float32"), sample.compute

    def step(network: ViewNetwork, inputs: Tensor, compute: Compute) -> Callable[[], None]:
        linear = nn.Linear(network.backbone.features, len(sample.table.classes), device=compute.device)
        loss = FrameLoss(network.backbone.train(), linear, compute)
        loss_of = loss if compute is plain else Replay(loss, loss.parameters())
        optimiser = build_optimiser(sample.params.pretrain, [{"params": loss.parameters()}])
        return lambda: descend(optimiser, loss_of(inputs, labels))

    fast = step(deepcopy(sample.network), compute.frames(frames.squeeze(1)), compute)
    slow = step(plain_network(sample.network), frames, plain)
    return sample.compared(f"training step, batch {batch}", "frames", fast, batch, slow, batch)


def descend(optimiser: torch.optim.Optimizer, loss: Tensor) -> None:
    optimiser.zero_grad()
    loss.backward()
    optimiser.step()


def time_finetuning(sample: Sample, reuse: int) -> dict:
    """Fine-tuning with this `finetune.feature_reuse`."""
    network, table, compute = sample.network, sample.table, sample.compute
    (frames, labels), sets, plain = sample.tensors(TRAIN), sample.sets(TRAIN), plain_network(network).train()
    optimiser = build_optimiser(sample.params.finetune, [{"params": plain.parameters()}])
    linear = nn.Linear(network.backbone.features, len(table.classes))
    pretrained = {"backbone": network.backbone.state_dict(), "classifier": linear.state_dict()}
    finetune = replace(sample.params.finetune, epochs=EPOCHS, feature_reuse=reuse, num_views="full")
    params = replace(sample.params, finetune=finetune)

    def plainly() -> None:
        for part in sets.split(SETS):
            logits, aux = plain_answer(plain, frames, part)
            descend(optimiser, plain.head.loss(logits, aux, labels[part[:, 0]]))

    fast = partial(finetune_classifier, table, sample.views, pretrained, params, compute)
    count = EPOCHS * int((table.anchor & (table.side == TRAIN)).sum())
    return sample.compared(f"fine-tuning, feature_reuse {reuse}", "view sets", fast, count, plainly, len(sets))


def time_trials(sample: Sample) -> dict:
    """All trials of both protocols; the plain ones are spared their clusterings."""
    network, table, params = sample.network, sample.table, sample.params
    params = replace(params, evaluate=replace(params.evaluate, side="test"))
    fast = partial(evaluate_table, network, table, params, sample.compute, timed=False)
    (frames, _), sets, plain = sample.tensors(TEST), sample.sets(TEST), plain_network(network).eval()
    plainly = torch.inference_mode()(lambda: [plain_answer(plain, frames, part) for part in sets.split(SETS)])
    trials = params.evaluate.trials
    count = 2 * trials * int((table.anchor & (table.side == TEST)).sum())
    return sample.compared(f"{trials} trials", "view sets", fast, count, plainly, len(sets))


if __name__ == "__main__":
    speed()
