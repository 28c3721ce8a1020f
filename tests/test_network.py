"""A trained network with extreme inputs and in all precisions, against itself in float64.

It is the small classifier, or with `--table` the pipeline's.
"""

import numpy as np
import pytest

from benchmarks.stability.rows import max_rel_error, share_different
from tests.trained_network import SINGLE

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
        "10,000 times": 1e4 * inputs,
        "1e-4 times": 1e-4 * inputs,
        "denormals": 1e-40 * (inputs > 0),
        "1e-30": np.full_like(inputs, 1e-30),
        "all one": np.ones_like(inputs),
    }
    for name, values in kinds.items():
        both = subject.single_and_exact(values.astype(np.float32), sets)
        row(f"logits, {name}", max_rel_error(*both), SINGLE)
