"""A trained network with extreme inputs and in all precisions, against itself in float64.

It is the small classifier, or with `--table` the pipeline's.
"""

from copy import deepcopy

import numpy as np
import pytest
import torch

from benchmarks.stability.rows import max_rel_error, share_different, share_not_finite
from tests.trained_network import SINGLE, without_dropout

HALF = 2e-2  # of the largest feature: bfloat16 has 8 bits, and twelve layers round to them


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
