"""Each part of the pipeline beside its plain counterpart."""

from collections.abc import Callable, Iterable
from copy import deepcopy
from dataclasses import replace
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.command import interleaved, median_ratio
from benchmarks.speed import plain
from benchmarks.speed.sample import Sample
from tactile_viewgcn.device import Compute
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.nn.backbone import Backbone
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.optim import build_optimiser
from tactile_viewgcn.training.pretraining import FrameLoss
from tactile_viewgcn.training.replay import Replay
from tactile_viewgcn.training.set_loss import SetLoss

REUSES = (1, 2, 4, 8)  # `finetune.feature_reuse`
EPOCHS = 5  # of the fine-tunings that are timed; what the first one does once is shared out
PLAIN_SETS = 3 * plain.SETS  # view sets that the plain network is timed on


def comparison(what: str, size: str, unit: str, fast: np.ndarray, plain: np.ndarray) -> dict:
    """The row of a fast path and its plain counterpart, from the seconds (rounds,) of a unit of work of each."""
    return {
        "what": what,
        "size": size,
        "unit": f"{unit}/s",
        "fast": 1 / float(np.median(fast)),
        "plain": 1 / float(np.median(plain)),
        "ratio": median_ratio(plain, fast),
    }


def time_step(sample: Sample, batch: int) -> list[dict]:
    """The backbone's step of pretraining."""
    compute, backbone = sample.compute, sample.classifier.backbone
    frames, labels = (values[torch.arange(batch) % len(values)] for values in sample.tensors(TRAIN))
    slow, float32 = plain.plain_backbone(backbone), Compute(compute.device, "float32")
    variants = {
        "fast": training_step(sample, backbone, compute.frames(frames.squeeze(1)), labels, compute),
        "plain": training_step(sample, slow, frames, labels, float32, launched=True),
    }
    seconds = interleaved(variants, sample.rounds)
    return [comparison("training step", f"batch {batch}", "frames", *(seconds[name] / batch for name in variants))]


def training_step(
    sample: Sample, backbone: Backbone, frames: Tensor, labels: Tensor, compute: Compute, *, launched: bool = False
) -> Callable[[], None]:
    """A step of pretraining a copy of the backbone on a batch of frames (n, 1, H, W).

    Where it is `launched`, a CUDA card's kernels are launched one by one, not repeated as a graph.
    """
    config, copy = sample.params.pretrain, deepcopy(backbone).train()
    linear = nn.Linear(copy.features, len(sample.table.classes), device=compute.device)
    optimiser = build_optimiser(config, [{"params": [*copy.parameters(), *linear.parameters()]}])
    augment, loss = sample.augmentation(config), FrameLoss(copy, linear, compute)
    loss_of = loss if launched else Replay(loss, loss.parameters())
    return lambda: descend(optimiser, [loss_of(augment(frames), labels)])


def descend(optimiser: torch.optim.Optimizer, losses: Iterable[Tensor]) -> None:
    """A step down each loss."""
    for loss in losses:
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


def time_finetuning(sample: Sample) -> list[dict]:
    """Fine-tuning with each `finetune.feature_reuse`; plainly, every view passes the backbone."""
    config, (frames, labels) = sample.params.finetune, sample.tensors(TRAIN)
    slow, sets = plain.plain_classifier(sample.classifier).train(), sample.view_sets(TRAIN)[:PLAIN_SETS]
    optimiser = build_optimiser(config, [{"params": slow.parameters()}])
    parts = torch.from_numpy(sets).to(frames.device).split(plain.SETS)
    linear = nn.Linear(slow.backbone.features, len(sample.table.classes))
    pretrained = {"backbone": sample.classifier.backbone.state_dict(), "classifier": linear.state_dict()}
    augment = sample.augmentation(config)
    loss_of = SetLoss(slow, None, Compute(sample.compute.device, "float32"))

    def plainly() -> None:  # every column is fresh; without a bank nothing else of `sets`, `fresh` and `first` counts
        descend(optimiser, (loss_of(augment(frames[p].flatten(0, 1)), labels[p[:, 0]], p, p, p) for p in parts))

    def fast(reuse: int) -> None:
        finetune = replace(config, epochs=EPOCHS, feature_reuse=reuse, num_views="full")
        params = replace(sample.params, finetune=finetune)
        finetune_classifier(sample.table, sample.views, pretrained, params, sample.compute)

    variants = {f"reuse {reuse}": partial(fast, reuse) for reuse in REUSES} | {"plain": plainly}
    seconds = interleaved(variants, sample.rounds)
    count, slow_set = EPOCHS * len(frames), seconds.pop("plain") / len(sets)
    return [comparison("fine-tuning", reuse, "view sets", each / count, slow_set) for reuse, each in seconds.items()]


def time_evaluation(sample: Sample) -> list[dict]:
    """All trials of all protocols; the plain ones are spared their clusterings."""
    params, compute, table = sample.params, sample.compute, sample.table
    config = replace(params.evaluate, side="test", confidence_threshold=0.0)
    network, slow = sample.classifier, plain.plain_classifier(sample.classifier)
    frames, sets = sample.tensors(TEST)[0], sample.view_sets(TEST)[:PLAIN_SETS]
    variants = {
        "fast": lambda: evaluate_table(network, table, params.cluster, config, compute, params.seed, timed=False),
        "plain": lambda: plain.logits(slow, frames, sets),
    }
    seconds, count = interleaved(variants, sample.rounds), config.trials * len(config.protocols) * len(frames)
    size = f"{count:,} view sets"
    return [comparison("evaluation", size, "view sets", seconds["fast"] / count, seconds["plain"] / len(sets))]
