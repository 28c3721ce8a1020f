"""The trained network on inputs and in precisions at their ends, against itself in float64; how it carries noise."""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn

from studies.stability.case import Finding, Subject, apart, differing, finite
from studies.stability.graph import view_gcn
from studies.stability.logits import (
    SINGLE,
    features,
    in_precision,
    logits,
    odds,
    rms,
    single_and_exact,
    some_inputs,
    some_sets,
    with_the_same_views,
)
from tactile_viewgcn.classifier import Recogniser, save_classifier
from tactile_viewgcn.frames import full_scale
from tactile_viewgcn.nn.backbone import Backbone
from tactile_viewgcn.nn.view_gcn import log_odds
from tactile_viewgcn.viewpoints import viewpoints

HALF = 2e-2  # of the largest feature: bfloat16 has 8 bits, and twelve layers round to them
NOISE = 1e-4  # of the input's size, to measure what becomes of it
ROUNDING = 2.0**-24  # of single precision


def precisions(subject: Subject) -> Iterator[Finding]:
    """Test frames in single precision and, where the evaluation uses it, in bfloat16."""
    inputs = some_inputs(subject)
    sets = some_sets(len(inputs), subject.classifier.views)
    found, exact = single_and_exact(subject.classifier, inputs, sets, subject)
    yield Finding("logits, float32", apart(found, exact), SINGLE)
    yield Finding("answers, float32", differing(found.argmax(dim=1), exact.argmax(dim=1)), 0)
    true = features(subject.classifier, inputs, in_precision("float64", subject)).cpu()
    half = features(subject.classifier, inputs, in_precision("bfloat16", subject)).cpu().float()
    used = "in use" if subject.compute.precision == "bfloat16" else "not in use"
    yield Finding("features, bfloat16", apart(half, true), HALF, used)


def inputs_far_from_one(subject: Subject) -> Iterator[Finding]:
    """Network input 10,000 times as large, of denormal numbers, and the same in every cell."""
    inputs = some_inputs(subject, 32)
    sets = some_sets(len(inputs), subject.classifier.views)
    kinds = {
        "10,000 times": 1e4 * inputs, "1e-4 times": 1e-4 * inputs, "denormals": 1e-40 * (inputs > 0),
        "1e-30": np.full_like(inputs, 1e-30), "all one": np.ones_like(inputs),
    }  # fmt: skip
    for name, values in kinds.items():
        values = values.astype(np.float32)
        yield Finding(f"logits, {name}", apart(*single_and_exact(subject.classifier, values, sets, subject)), SINGLE)


def batch_of_one(subject: Subject) -> Iterator[Finding]:
    """One view set alone, against itself among others."""
    inputs = some_inputs(subject, 16)
    sets = np.sort(some_sets(len(inputs), subject.classifier.views, 5), axis=1)  # in the order of time
    single = in_precision("float32", subject)
    together = logits(subject.classifier, inputs, sets, single)
    alone = [logits(subject.classifier, inputs[own], np.arange(len(own))[None], single) for own in sets]
    yield Finding("logits", apart(torch.cat(alone), together), SINGLE)


def a_thousand_views_in_half_precision(subject: Subject) -> Iterator[Finding]:
    """Features of 1,000 views in 16 bits: they are joined in single precision, so that nothing else is rounded."""
    places = torch.from_numpy(viewpoints(1000))
    head = view_gcn(subject, places)
    nodes = torch.rand(2, 1000, head.classifier[0].out_features, generator=torch.Generator().manual_seed(0))
    for kind in (torch.bfloat16, torch.float16):
        rounded = nodes.to(kind)
        with torch.inference_mode():
            both = with_the_same_views(
                lambda own, rounded=rounded: own(rounded)[0],
                lambda own, rounded=rounded: own.double()(rounded.double())[0],
                head,
            )
        yield Finding(f"logits, {str(kind).removeprefix('torch.')}", apart(*both), SINGLE)


def moments_of_large_frames(subject: Subject) -> Iterator[Finding]:
    """Mean and variance that the first layer's batch normalisation sees of frames of 10,000, give or take one."""
    backbone = subject.classifier.backbone
    if not isinstance(backbone, Backbone):
        return
    frames = 1e4 + torch.rand(16, 1, 12, 12, generator=torch.Generator().manual_seed(0))
    seen = []
    for kind in (torch.float32, torch.float64):
        stem = deepcopy(backbone.stem).cpu().to(kind).train()
        stem.norm.momentum = 1.0
        with torch.no_grad():
            stem(frames.to(kind))
        seen.append(stem.norm)
    yield Finding("mean of the maps", apart(seen[0].running_mean, seen[1].running_mean), SINGLE)
    yield Finding("variance of the maps", apart(seen[0].running_var, seen[1].running_var), SINGLE)


def features_without_variance(subject: Subject) -> Iterator[Finding]:
    """A batch of one frame over and over, in training: every batch normalisation divides by nearly nothing."""
    same = np.repeat(some_inputs(subject, 1), 6, axis=0)
    for name, inputs in (("one frame", same), ("blank frames", np.zeros_like(same))):
        found = []
        for kind in (torch.float32, torch.float64):
            backbone = without_dropout(deepcopy(subject.classifier.backbone).cpu().to(kind).train())
            frames = torch.from_numpy(inputs).unsqueeze(1).to(kind).requires_grad_()
            given = backbone(frames)
            given.square().mean().backward()
            found.append((given.detach(), finite(frames.grad)))
        yield Finding(f"features, {name}", apart(found[0][0], found[1][0]), 1e-3)
        yield Finding(f"gradients that are not finite, {name}", max(lost for _, lost in found), 0)


def sure_answers(subject: Subject) -> Iterator[Finding]:
    """A recogniser whose logits are all raised by 10,000, and how sure a selector is whose logits are as large."""
    inputs = some_inputs(subject, 8)
    sets, raised = some_sets(len(inputs), subject.classifier.views, 6), deepcopy(subject.classifier)
    last = [layer for layer in raised.head.modules() if isinstance(layer, nn.Linear)][-1]
    with torch.no_grad():
        last.bias += 1e4
    path, table = subject.folder / "raised.pt", replace(subject.table, kind="clip", scale=1.0)
    save_classifier(path, raised, subject.params.model, table)
    inputs, rest = np.clip(inputs, 0, 1), np.zeros(inputs.shape[1:])
    found = Recogniser(path).probabilities(inputs[sets], rest)
    exact = single_and_exact(subject.classifier, inputs, sets, subject)[1].softmax(dim=-1)
    yield Finding("probabilities", apart(found, exact), 2e-3, "logits of 1e4 come in steps of 1e-3")
    yield Finding("sum of the probabilities", apart(found.sum(axis=1), np.ones(len(found))), SINGLE)
    given = torch.randn(20, 4, 9, generator=torch.Generator().manual_seed(0))
    for factor in (1.0, 1e2, 1e4):
        found, exact = log_odds(factor * given, -1).amax(dim=-1), odds(factor * given.double(), -1).amax(dim=-1)
        yield Finding(f"log odds of logits of {factor:g}", apart(found, exact), SINGLE)


def noise_through_the_layers(subject: Subject) -> Iterator[Finding]:
    """Single precision's rounding of what each layer is given, times the layer's condition number.

    That is the relative change of what it gives by that of what it is given, here the largest along eight random
    directions at the network's input: noise as a sensor has it, and not the worst there is.
    """
    inputs, classifier = some_inputs(subject, 16), deepcopy(subject.classifier).cpu().double()
    noise = NOISE * full_scale(subject.table.kind, subject.table.scale)
    sets, rng = some_sets(len(inputs), classifier.views, 16), np.random.default_rng(0)
    clean, largest = _layers(classifier, inputs.astype(np.float64), sets), {}
    for _ in range(8):
        noisy = _layers(classifier, inputs + noise * rng.standard_normal(inputs.shape), sets)
        for name, (given, out) in clean.items():
            change = rms(noisy[name][1] - out) / rms(out) / (rms(noisy[name][0] - given) / rms(given))
            largest[name] = max(change, largest.get(name, 0.0))
    for name, change in largest.items():
        yield Finding(f"rounding through {name}", change * ROUNDING, SINGLE, f"condition number {change:.3g}")


def without_dropout(module: nn.Module) -> nn.Module:
    """The module, its dropout in evaluation mode."""
    for layer in module.modules():
        if isinstance(layer, nn.Dropout | nn.Dropout2d):
            layer.eval()
    return module


def _layers(classifier: nn.Module, inputs: np.ndarray, sets: np.ndarray) -> dict[str, tuple[Tensor, Tensor]]:
    """What each part of backbone and system is given and gives, for view sets of network input, in float64."""
    seen, hooks = {}, []
    parts = {f"backbone.{name}": part for name, part in classifier.backbone.named_children()}
    for name, part in classifier.head.named_children():
        many = isinstance(part, nn.ModuleList)
        parts |= {f"{name}.{i}": one for i, one in enumerate(part)} if many else {name: part}

    def keep(name: str, given: tuple, out: Tensor | tuple) -> None:
        seen.setdefault(name, (given[0], out[0] if isinstance(out, tuple) else out))

    for name, part in parts.items():
        hooks.append(part.register_forward_hook(lambda _, given, out, name=name: keep(name, given, out)))
    with torch.inference_mode():
        nodes = classifier.backbone(torch.from_numpy(inputs).unsqueeze(1))
        out = classifier.head(nodes[torch.from_numpy(sets)])[0]
    for hook in hooks:
        hook.remove()
    seen["the backbone"] = torch.from_numpy(inputs), nodes
    seen["the system"] = nodes, out
    seen["everything"] = torch.from_numpy(inputs), out
    return {name: pair for name, pair in seen.items() if isinstance(pair[1], Tensor)}


CASES = (
    precisions,
    inputs_far_from_one,
    batch_of_one,
    a_thousand_views_in_half_precision,
    moments_of_large_frames,
    features_without_variance,
    sure_answers,
    noise_through_the_layers,
)
