"""The benchmark of speed: its plain counterpart computes what the pipeline does; ratios."""

import numpy as np
import torch

from benchmarks.command import median_ratio
from benchmarks.speed import __main__ as module
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.tables.frames import TEST
from tests.glove_data import CPU, table, trained


def test_the_plain_network_answers_as_the_pipeline_does():
    frames, sets = torch.from_numpy(table().inputs(table().on(TEST))).unsqueeze(1), torch.arange(80).view(20, 4) % 64
    features = extract_features(trained().backbone, [CPU.frames(frames.squeeze(1))])
    with torch.inference_mode():
        plain = module.plain_answer(module.plain_network(trained()), frames, sets)[0]
        fast = view_set_logits(trained().head, features, sets)
    torch.testing.assert_close(fast, plain, rtol=1e-4, atol=1e-5 * float(plain.abs().max()))


def test_the_ratio_is_the_median_of_the_rounds_ratios():
    assert median_ratio(np.array([2.5, 2.0, 3.0]), np.array([0.5, 1.0, 2.0])) == 2.0  # of the medians it is 2.5
