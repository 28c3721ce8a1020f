"""Losses, gradients and learning rates at their ends, on the trained network and on short trainings."""

import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import torch
from torch import Tensor, nn
from tqdm import tqdm

from studies.stability.case import Finding, Subject, apart, finite, refusal
from studies.stability.logits import in_precision, rms, some_inputs, some_sets
from studies.stability.network import without_dropout
from tactile_viewgcn.checkpoint import Checkpoint, Progress
from tactile_viewgcn.classifier import Classifier
from tactile_viewgcn.clustering import cluster_table
from tactile_viewgcn.epochs import fit
from tactile_viewgcn.finetuning import finetune_classifier
from tactile_viewgcn.frames import Frames
from tactile_viewgcn.nn.view_gcn import MessageSum, shape_and_view_loss
from tactile_viewgcn.params import load
from tactile_viewgcn.pretraining import pretrain_backbone
from tactile_viewgcn.split import TEST
from tactile_viewgcn.training import parts

ROOT = Path(__file__).parents[2]
STEP = 1e-8  # of a finite difference, in sizes of what it moves: hardly a ReLU changes sides within it
SLOPES = 1e-5  # of a slope: of the 16 digits of a loss such a step leaves 8, and a few less where slopes are small
RATES = 10.0 ** np.arange(-8, 4)
LOST = 10.0  # times its first loss: a training that ends so has diverged
CALM, NOISY = 1e-3, 0.1  # rates up to which a loss must not rise, but by what dropout and noise make of it
SUM = 2.0**-20  # of single precision, after a few sums
ANCHORS = 2  # of a class, in the short trainings


def losses_of_sure_logits(subject: Subject) -> Iterator[Finding]:
    """Equation 6 where the right class is 10,000 above the others, or as far below; the system's own loss."""
    labels = torch.tensor([0, 1, 1, 0])
    outputs = 1 + 2 * 2  # the shape's, and those of two samplers with two candidates
    for name, size, expected in (("right", 1e4, 0.0), ("wrong", -1e4, outputs * (1e4 + math.log(2)))):
        logits = torch.zeros(4, 3).index_put((torch.arange(4), labels), torch.tensor(size)).requires_grad_()
        loss = shape_and_view_loss(logits, [logits[:, None, None].expand(4, 2, 2, 3)], labels)
        loss.backward()
        yield Finding(f"equation 6, sure of the {name} class", apart(loss.detach(), expected), SUM)
        steep = torch.zeros(4, 3) if size > 0 else (1 - 3 * torch.eye(3)[labels]) / 2  # softmax - one-hot
        yield Finding(f"its gradient, {name} class", apart(logits.grad, outputs * steep / 4), SUM)
    nodes = torch.rand(24, *subject.classifier.given, generator=torch.Generator().manual_seed(0))
    head, sets = deepcopy(subject.classifier.head).cpu(), torch.from_numpy(some_sets(24, subject.classifier.views, 4))
    with torch.no_grad():
        logits, also = head(nodes[sets])
        found = [
            head.loss(1e4 * logits.to(kind), [1e4 * one.to(kind) for one in also], labels % logits.shape[1])
            for kind in (torch.float32, torch.float64)
        ]
    yield Finding("the system's loss of logits 10,000 times as large", apart(*found), SUM)


def batches_of_one(subject: Subject) -> Iterator[Finding]:
    """Batch normalisation has nothing to learn from one frame or view set; two are enough."""
    for key in ("pretrain.batch", "finetune.batch"):
        refused = lambda key=key: load(ROOT / "params.yaml", (f"{key}=1",))  # noqa: E731
        yield refusal(f"{key} of 1", refused, rf"{key} is 1; expected an integer in \[2")
    for count, size in ((2, 2), (3, 2), (21, 20), (41, 20), (7, 2)):
        alone = min(len(part) for part in torch.arange(count).tensor_split(parts(count, size)))
        yield Finding(f"batches of one example, {count} in batches of {size}", float(alone < 2), 0)
    classifier = without_dropout(deepcopy(subject.classifier).cpu().train())
    nodes = classifier.backbone(torch.from_numpy(some_inputs(subject, 2)).unsqueeze(1))
    sets = torch.from_numpy(some_sets(2, classifier.views, 2))
    loss = classifier.head.loss(*classifier.head(nodes[sets]), torch.arange(2))
    loss.backward()
    lost = [finite(weight.grad) for weight in classifier.parameters() if weight.grad is not None]
    yield Finding("not finite, two view sets of two frames", max([finite(loss.detach()), *lost]), 0)


def gradients(subject: Subject) -> Iterator[Finding]:
    """Slopes of the loss of the trained network, in training without dropout, against finite differences in float64."""
    classifier = without_dropout(deepcopy(subject.classifier).cpu().double().train())
    inputs, rng = some_inputs(subject, 24), np.random.default_rng(0)
    frames = torch.from_numpy(inputs + 0.01 * rng.standard_normal(inputs.shape)).unsqueeze(1)  # no two cells are equal
    sets = torch.from_numpy(some_sets(len(frames), classifier.views, 6))
    labels = torch.arange(len(sets)) % len(subject.table.classes)

    def loss() -> Tensor:
        return classifier.head.loss(*classifier.head(classifier.backbone(frames)[sets]), labels)

    for name, moved in (
        ("the frames", [frames]),
        ("the weights of the backbone", list(classifier.backbone.parameters())),
        ("the weights of the system", list(classifier.head.parameters())),
    ):
        yield Finding(f"by {name}", _slopes(loss, moved), SLOPES)
    taken, sent = torch.randn(2, 3, 5, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    fine = torch.autograd.gradcheck(MessageSum.apply, (taken.requires_grad_(), sent.requires_grad_()))
    yield Finding("of equation 4's sum, every entry", 1.0 - fine, 0)


def gradients_at_the_extremes(subject: Subject) -> Iterator[Finding]:
    """Whether every gradient is a number: huge, blank and equal frames, one class alone, a class with one view set."""
    inputs, classes = some_inputs(subject, 24), len(subject.table.classes)
    many = np.arange(6) % classes
    kinds = {
        "10,000 times": (1e4 * inputs, many), "blank": (np.zeros_like(inputs), many),
        "denormal": (np.full_like(inputs, 1e-40), many), "one frame": (np.repeat(inputs[:1], 24, axis=0), many),
        "one class alone": (inputs, np.zeros(6, dtype=int)), "one view set of a class": (inputs, np.minimum(many, 1)),
    }  # fmt: skip
    for name, (values, labels) in kinds.items():
        classifier = deepcopy(subject.classifier).cpu().train()
        nodes = classifier.backbone(torch.from_numpy(values.astype(np.float32)).unsqueeze(1))
        sets = torch.from_numpy(some_sets(len(values), classifier.views, 6))
        loss = classifier.head.loss(*classifier.head(nodes[sets]), torch.from_numpy(labels))
        loss.backward()
        lost = [finite(weight.grad) for weight in classifier.parameters() if weight.grad is not None]
        yield Finding(f"not finite, {name}", max([finite(loss.detach()), *lost]), 0)


def learning_rates(subject: Subject) -> Iterator[Finding]:
    """Short trainings at rates from 1e-8 to 1e3: each ends with finite weights, or is refused for it diverged."""
    table, compute = few_anchors(subject.table), in_precision("float32", subject)
    params = SimpleNamespace(**{name: getattr(subject.params, name) for name in ("seed", "model", "augment")})
    params.cluster = replace(subject.params.cluster, method="none", assignment="index")
    places = subject.classifier.viewpoints.double().cpu().numpy()
    views = cluster_table(table, places, params.cluster, np.random.default_rng(0))
    weights = {"backbone": subject.classifier.backbone.state_dict(), "classifier": _linear(subject.classifier, table)}
    halving = {"schedule": "halving", "halve_every": 100, "halve_early": 0}
    constant = {"schedule": "constant", "sizes": "full"}
    for rate in map(float, RATES):
        params.pretrain = replace(subject.params.pretrain, epochs=2, lr=rate, **halving)
        params.finetune = replace(subject.params.finetune, epochs=2, lr=rate, lr_backbone=rate, **constant)
        yield _outcome("pretraining", rate, lambda: pretrain_backbone(table, params, compute)[::2])
        if subject.classifier.head.learns:
            yield _outcome("fine-tuning", rate, lambda: finetune_classifier(table, views, weights, params, compute))


def last_good_weights(subject: Subject) -> Iterator[Finding]:
    """A training whose rate jumps in its second epoch ends with the weights of the first, and says so."""
    nodes = torch.rand(24, *subject.classifier.given, generator=torch.Generator().manual_seed(0))
    sets = torch.from_numpy(some_sets(24, subject.classifier.views, 8))
    labels = torch.arange(len(sets)) % len(subject.table.classes)

    def trained(epochs: int, jump: float) -> tuple[Tensor, Progress]:
        head = deepcopy(subject.classifier.head).cpu().eval()  # without dropout: both begin alike
        optimiser = torch.optim.SGD(head.parameters(), 1e-5)
        losses = lambda _: (head.loss(*head(nodes[sets]), labels) for _ in range(40))  # noqa: E731
        keep = Checkpoint(None, {"head": head}, {}, {}, torch.device("cpu"))
        progress = fit(epochs, optimiser, {0: 1.0, 1: jump}.get, losses, dict, tqdm(disable=True), keep)
        return torch.cat([weight.detach().flatten() for weight in head.parameters()]), progress

    one, _ = trained(1, 1.0)
    for jump in (1e9, 1e33):
        two, progress = trained(2, jump)
        told = progress.diverged and progress.epoch == 1
        yield Finding(f"weights, {jump:g} times the rate", apart(two, one) if told else math.inf, 0, progress.diverged)


def few_anchors(table: Frames) -> Frames:
    """The table with the first anchors of each class and side alone."""
    anchor = np.zeros_like(table.anchor)
    for side in np.unique(table.side):
        for label in range(len(table.classes)):
            own = np.flatnonzero(table.anchor & (table.side == side) & (table.label == label))
            anchor[own[:ANCHORS]] = True
    return replace(table, anchor=anchor, side=np.where(table.side == TEST, table.side, 0).astype(table.side.dtype))


def _linear(classifier: Classifier, table: Frames) -> dict[str, Tensor]:
    """A classifier of single frames at random, for systems that begin with one."""
    torch.manual_seed(0)
    return nn.Linear(classifier.backbone.features, len(table.classes)).state_dict()


def _outcome(what: str, rate: float, train: Callable[[], tuple[nn.Module, Progress]]) -> Finding:
    """Of a short training: the share of its weights that is not finite, or that it was refused or stopped.

    At a calm rate it neither diverges nor does its loss rise.
    """
    name = f"weights that are not finite, {what} at {rate:g}"
    try:
        module, progress = train()
    except ValueError as error:
        said = str(error)
        return Finding(name, math.nan, math.nan, said, refused="training diverged in epoch" in said and rate > CALM)
    lost, losses = max(finite(value) for value in module.state_dict().values()), progress.curves["loss"]
    if rate <= CALM:
        rise = max(losses[-1] / losses[0] - 1, 0.0) if not (lost or progress.diverged) else math.inf
        return Finding(
            f"rise of the loss, {what} at {rate:g}", rise, NOISY, f"from {losses[0]:.3g} to {losses[-1]:.3g}"
        )
    if losses[-1] > LOST * max(1.0, progress.first):
        lost = math.inf  # and it did not say so
    said = progress.diverged or f"loss from {losses[0]:.3g} to {losses[-1]:.3g}"
    return Finding(name, lost, 0, said, refused=bool(progress.diverged) and not lost)


def _slopes(loss: Callable[[], Tensor], moved: list[Tensor]) -> float:
    """Difference of a slope and a central difference along a random direction; the median of five directions.

    Relative to the root of the sum of squares of what the slope adds up, which does not cancel.
    """
    rng, found = torch.Generator().manual_seed(0), []
    for value in moved:
        value.requires_grad_()
    slopes = torch.autograd.grad(loss(), moved, allow_unused=True)
    pairs = [(value, slope) for value, slope in zip(moved, slopes, strict=True) if slope is not None]
    for _ in range(5):
        ways = [torch.randn(value.shape, dtype=value.dtype, generator=rng) * rms(value) for value, _ in pairs]
        parts = torch.cat([(way * slope).flatten() for way, (_, slope) in zip(ways, pairs, strict=True)])
        ends = []
        for step in (STEP, -2 * STEP, STEP):  # there, to the other side, and back
            with torch.no_grad():
                for way, (value, _) in zip(ways, pairs, strict=True):
                    value += step * way
                ends.append(float(loss()))
        found.append(abs((ends[0] - ends[1]) / (2 * STEP) - float(parts.sum())) / float(parts.norm()))
    return float(np.median(found))


CASES = (losses_of_sure_logits, batches_of_one, gradients, gradients_at_the_extremes, learning_rates, last_good_weights)
