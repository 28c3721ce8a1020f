"""A trained network with extreme inputs and in all precisions, against itself in float64; noise through its layers.

It is the small classifier, or with `--table` the pipeline's.
"""

from copy import deepcopy

import numpy as np
import pytest
import torch
from torch import Tensor, nn
from torch.nn.modules.module import register_module_forward_hook

from benchmarks.stability.rows import max_rel_error, share_different, share_not_finite
from tactile_viewgcn.recognition.model_file import build_classifier
from tactile_viewgcn.tables.frames import full_scale
from tactile_viewgcn.views.viewpoints import viewpoints
from tests import test_invariance
from tests.glove_data import CPU, recipe, table
from tests.stability import Rows
from tests.trained_network import SINGLE, Subject, rms, without_dropout

HALF = 2e-2  # of the largest feature: bfloat16 has 8 bits, and twelve layers round to them
NOISE = 1e-4  # of the input's size, to measure what becomes of it
ROUNDING = 2.0**-24  # of single precision


@pytest.mark.stability("precisions")
def test_single_precision_and_bfloat16_answer_as_double_does(row, subject):
    inputs = subject.inputs()
    single, exact = subject.single_and_exact(inputs, subject.sets(inputs))
    row("logits, float32", max_rel_error(single, exact), SINGLE)
    row("answers, float32", share_different(single.argmax(dim=1), exact.argmax(dim=1)))
    true = subject.features(inputs, "float64").cpu()
    half = subject.features(inputs, "bfloat16").cpu().float()
    used = "in use" if subject.compute.precision == "bfloat16" else "not in use"
    row("features, bfloat16", max_rel_error(half, true), HALF, used)


@pytest.mark.stability("inputs far from one")
def test_logits_of_inputs_that_are_large_denormal_or_the_same_everywhere(row, subject):
    inputs = subject.inputs(32)
    sets = subject.sets(inputs)
    kinds = {
        "10,000 times": 1e4 * inputs, "1e-4 times": 1e-4 * inputs, "denormals": 1e-40 * (inputs > 0),
        "1e-30": np.full_like(inputs, 1e-30), "all one": np.ones_like(inputs),
    }  # fmt: skip
    for name, values in kinds.items():
        both = subject.single_and_exact(values.astype(np.float32), sets)
        row(f"logits, {name}", max_rel_error(*both), SINGLE)


@pytest.mark.stability("features without variance")
def test_a_training_batch_of_one_frame_over_and_over(row, subject):
    """Every batch normalisation divides by nearly nothing."""
    same = np.repeat(subject.inputs(1), 6, axis=0)
    for name, inputs in (("one frame", same), ("blank frames", np.zeros_like(same))):
        outputs = []
        for kind in (torch.float32, torch.float64):
            backbone = without_dropout(deepcopy(subject.classifier.backbone).cpu().to(kind).train())
            frames = torch.from_numpy(inputs).unsqueeze(1).to(kind).requires_grad_()
            maps = backbone(frames)
            maps.square().mean().backward()
            outputs.append((maps.detach(), share_not_finite(frames.grad)))
        row(f"features, {name}", max_rel_error(outputs[0][0], outputs[1][0]), 1e-3)
        row(f"gradients that are not finite, {name}", max(share for _, share in outputs))


@pytest.mark.stability("noise through the layers")
def test_rounding_of_each_layer_s_input_times_the_layer_s_condition_number(row, subject):
    """That is the relative change of its output by that of its input, the largest along eight random directions.

    The directions are at the network's input: noise as a sensor has it, and not the worst there is.
    """
    inputs, classifier = subject.inputs(16), deepcopy(subject.classifier).cpu().double()
    noise = NOISE * full_scale(subject.table.transform, subject.table.scale)
    sets, rng = subject.sets(inputs, 16), np.random.default_rng(0)
    clean, largest = layers(classifier, inputs.astype(np.float64), sets), {}
    for _ in range(8):
        noisy = layers(classifier, inputs + noise * rng.standard_normal(inputs.shape), sets)
        for name, (given, out) in clean.items():
            change = rms(noisy[name][1] - out) / rms(out) / (rms(noisy[name][0] - given) / rms(given))
            largest[name] = max(change, largest.get(name, 0.0))
    for name, change in largest.items():
        row(f"rounding through {name}", change * ROUNDING, SINGLE, f"condition number {change:.3g}")


def layers(classifier: nn.Module, inputs: np.ndarray, sets: np.ndarray) -> dict[str, tuple[Tensor, Tensor]]:
    """Input and output of each part of backbone and system, for view sets of network input, in float64."""
    name_of = {part: f"backbone.{name}" for name, part in classifier.backbone.named_children()}
    for name, part in classifier.head.named_children():
        many = isinstance(part, nn.ModuleList)
        name_of |= {one: f"{name}.{i}" for i, one in enumerate(part)} if many else {part: name}
    pairs = {}

    def keep(part: nn.Module, given: tuple, out: Tensor | tuple) -> None:
        if part in name_of:
            pairs.setdefault(name_of[part], (given[0], out[0] if isinstance(out, tuple) else out))

    with torch.inference_mode(), register_module_forward_hook(keep):
        nodes = classifier.backbone(torch.from_numpy(inputs).unsqueeze(1))
        out = classifier.head(nodes[torch.from_numpy(sets)])[0]
    pairs["the backbone"] = torch.from_numpy(inputs), nodes
    pairs["the system"] = nodes, out
    pairs["everything"] = torch.from_numpy(inputs), out
    return {name: pair for name, pair in pairs.items() if isinstance(pair[1], Tensor)}


@pytest.mark.slow
@pytest.mark.parametrize("system", ["stag", "gvcnn", "cnn_lstm", "rotationnet", "vote"])
def test_the_checks_hold_for_other_systems(system):
    params = recipe(f"model.system={system}")
    torch.manual_seed(0)
    classifier = build_classifier(torch.from_numpy(viewpoints(4)), 4, params.model, (12, 12)).eval()
    row, subject = Rows(), Subject(classifier, table(), params, CPU)
    test_single_precision_and_bfloat16_answer_as_double_does(row, subject)
    test_logits_of_inputs_that_are_large_denormal_or_the_same_everywhere(row, subject)
    test_a_training_batch_of_one_frame_over_and_over(row, subject)
    test_rounding_of_each_layer_s_input_times_the_layer_s_condition_number(row, subject)
    test_invariance.test_one_thread_two_and_two_again_answer_alike(row, subject)
    test_invariance.test_batches_of_frames_and_view_sets_of_other_sizes_answer_alike(row, subject)
    test_invariance.test_frames_in_another_order_answer_alike(row, subject)
