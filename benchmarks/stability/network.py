"""The trained network on inputs and in precisions at their ends, against itself in float64; how it carries noise."""

from collections.abc import Iterator
from copy import deepcopy
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.modules.module import register_module_forward_hook

from benchmarks.stability.logits import SINGLE, rms, some_sets, without_dropout
from benchmarks.stability.rows import Quantity, max_rel_error, share_different, share_not_finite
from benchmarks.stability.subject import Subject
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.transform import full_scale

HALF = 2e-2  # of the largest feature: bfloat16 has 8 bits, and twelve layers round to them
NOISE = 1e-4  # of the input's size, to measure what becomes of it
ROUNDING = 2.0**-24  # of single precision


def precisions(subject: Subject) -> Iterator[Quantity]:
    """Test frames in single precision and, where the evaluation uses it, in bfloat16."""
    inputs = subject.inputs()
    single, exact = subject.single_and_exact(inputs, subject.sets(inputs))
    yield Quantity("logits, float32", max_rel_error(single, exact), SINGLE)
    yield Quantity("answers, float32", share_different(single.argmax(dim=1), exact.argmax(dim=1)))
    true = subject.features(inputs, "float64").cpu()
    half = subject.features(inputs, "bfloat16").cpu().float()
    used = "in use" if subject.compute.precision == "bfloat16" else "not in use"
    yield Quantity("features, bfloat16", max_rel_error(half, true), HALF, used)


def unusual_counts(baseline: np.ndarray) -> dict[str, np.ndarray]:
    """Frames (H, W) that no hand makes, over a baseline (H, W); the first is of a hand."""
    usual = np.rint(baseline).astype(np.int64)
    touched = usual + np.random.default_rng(0).integers(0, 200, usual.shape)
    pressed, dead = usual.copy(), touched.copy()
    pressed[tuple(side // 2 for side in usual.shape)] += 150
    dead[:: max(2, len(usual) // 4)] = 0
    return {
        "touched": touched, "all zero": 0 * usual, "saturated at 1,023": 0 * usual + 1023,
        "constant at 600": 0 * usual + 600, "one sensor pressed": pressed, "dead rows": dead,
        "negative counts": -touched, "the least of 16 bits": 0 * usual - 2**15,
        "the most of 16 bits": 0 * usual + 2**15 - 1, "below the baseline": usual - 50,
    }  # fmt: skip


def unusual_frames(subject: Subject) -> Iterator[Quantity]:
    """Logits of frames that no hand makes, each alone and among touched ones; a test has their network input."""
    counts, mean = unusual_counts(subject.table.baseline_mean[0]), subject.table.baseline_mean[:1]
    frames, baseline = np.stack(list(counts.values())).astype(np.int16), np.zeros(len(counts), dtype=int)
    table = replace(subject.table, counts=frames, baseline=baseline, baseline_mean=mean)
    inputs, views = table.inputs(np.arange(len(counts))), subject.classifier.views
    pattern = np.concatenate([np.ones((1, views), dtype=int), some_sets(2, views, 7)])
    for number, name in enumerate(counts):
        yield Quantity(f"logits, {name}", max_rel_error(*subject.single_and_exact(inputs, number * pattern)), SINGLE)


def inputs_far_from_one(subject: Subject) -> Iterator[Quantity]:
    """Network input 10,000 times as large, of denormal numbers, and the same in every cell."""
    inputs = subject.inputs(32)
    sets = subject.sets(inputs)
    kinds = {
        "10,000 times": 1e4 * inputs, "1e-4 times": 1e-4 * inputs, "denormals": 1e-40 * (inputs > 0),
        "1e-30": np.full_like(inputs, 1e-30), "all one": np.ones_like(inputs),
    }  # fmt: skip
    for name, values in kinds.items():
        both = subject.single_and_exact(values.astype(np.float32), sets)
        yield Quantity(f"logits, {name}", max_rel_error(*both), SINGLE)


def batch_of_one(subject: Subject) -> Iterator[Quantity]:
    """One view set alone, against itself among others."""
    inputs = subject.inputs(16)
    sets = np.sort(subject.sets(inputs, 5), axis=1)  # in the order of time
    together = subject.logits(inputs, sets, "float32")
    alone = [subject.logits(inputs[one], np.arange(len(one))[None], "float32") for one in sets]
    yield Quantity("logits", max_rel_error(torch.cat(alone), together), SINGLE)


def features_without_variance(subject: Subject) -> Iterator[Quantity]:
    """A batch of one frame over and over, in training: every batch normalisation divides by nearly nothing."""
    same = np.repeat(subject.inputs(1), 6, axis=0)
    for name, inputs in (("one frame", same), ("blank frames", np.zeros_like(same))):
        outputs = []
        for kind in (torch.float32, torch.float64):
            backbone = without_dropout(deepcopy(subject.classifier.backbone).cpu().to(kind).train())
            frames = torch.from_numpy(inputs).unsqueeze(1).to(kind).requires_grad_()
            maps = backbone(frames)
            maps.square().mean().backward()
            outputs.append((maps.detach(), share_not_finite(frames.grad)))
        yield Quantity(f"features, {name}", max_rel_error(outputs[0][0], outputs[1][0]), 1e-3)
        yield Quantity(f"gradients that are not finite, {name}", max(share for _, share in outputs))


def sure_answers(subject: Subject) -> Iterator[Quantity]:
    """A recogniser whose logits are all raised by 10,000."""
    inputs = subject.inputs(8)
    sets, raised = subject.sets(inputs, 6), deepcopy(subject.classifier)
    last = [layer for layer in raised.head.modules() if isinstance(layer, nn.Linear)][-1]
    with torch.no_grad():
        last.bias += 1e4
    everything = np.arange(len(subject.table.label))
    counts = subject.table.counts[everything].astype(np.float32)  # fractions are refused where training read integers
    path, table = subject.folder / "raised.pt", replace(subject.table, counts=counts, transform="clip", scale=1.0)
    save_classifier(path, raised, subject.params.model, table)
    inputs, baseline = np.clip(inputs, 0, 1), np.zeros(inputs.shape[1:])
    p = Recogniser(path).probabilities(inputs[sets], baseline)
    exact = subject.single_and_exact(inputs, sets)[1].softmax(dim=-1)
    yield Quantity("probabilities", max_rel_error(p, exact), 2e-3, "logits of 1e4 come in steps of 1e-3")
    yield Quantity("sum of the probabilities", max_rel_error(p.sum(axis=1), np.ones(len(p))), SINGLE)


def noise_through_the_layers(subject: Subject) -> Iterator[Quantity]:
    """Single precision's rounding of what each layer is given, times the layer's condition number.

    That is the relative change of what it gives by that of what it is given, here the largest along eight random
    directions at the network's input: noise as a sensor has it, and not the worst there is.
    """
    inputs, classifier = subject.inputs(16), deepcopy(subject.classifier).cpu().double()
    noise = NOISE * full_scale(subject.table.transform, subject.table.scale)
    sets, rng = subject.sets(inputs, 16), np.random.default_rng(0)
    clean, largest = _layers(classifier, inputs.astype(np.float64), sets), {}
    for _ in range(8):
        noisy = _layers(classifier, inputs + noise * rng.standard_normal(inputs.shape), sets)
        for name, (given, out) in clean.items():
            change = rms(noisy[name][1] - out) / rms(out) / (rms(noisy[name][0] - given) / rms(given))
            largest[name] = max(change, largest.get(name, 0.0))
    for name, change in largest.items():
        yield Quantity(f"rounding through {name}", change * ROUNDING, SINGLE, f"condition number {change:.3g}")


def _layers(classifier: nn.Module, inputs: np.ndarray, sets: np.ndarray) -> dict[str, tuple[Tensor, Tensor]]:
    """What each part of backbone and system is given and gives, for view sets of network input, in float64."""
    name_of = {part: f"backbone.{name}" for name, part in classifier.backbone.named_children()}
    for name, part in classifier.head.named_children():
        many = isinstance(part, nn.ModuleList)
        name_of |= {one: f"{name}.{i}" for i, one in enumerate(part)} if many else {part: name}
    seen = {}

    def keep(part: nn.Module, given: tuple, out: Tensor | tuple) -> None:
        if part in name_of:
            seen.setdefault(name_of[part], (given[0], out[0] if isinstance(out, tuple) else out))

    with torch.inference_mode(), register_module_forward_hook(keep):
        nodes = classifier.backbone(torch.from_numpy(inputs).unsqueeze(1))
        out = classifier.head(nodes[torch.from_numpy(sets)])[0]
    seen["the backbone"] = torch.from_numpy(inputs), nodes
    seen["the system"] = nodes, out
    seen["everything"] = torch.from_numpy(inputs), out
    return {name: pair for name, pair in seen.items() if isinstance(pair[1], Tensor)}


CHECKS = (
    precisions, unusual_frames, inputs_far_from_one, batch_of_one, features_without_variance, sure_answers,
    noise_through_the_layers,
)  # fmt: skip
