"""The benchmark of speed: its plain counterpart computes what the pipeline does; a run with a fixed clock."""

import numpy as np
import torch
from click.testing import CliRunner

from benchmarks.command import median_ratio
from benchmarks.speed import __main__ as module
from benchmarks.trained import CLASSIFIER, FRAMES
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.frames import TEST, save_table
from tests.glove_data import CPU, recipe, table, trained


def test_the_plain_network_answers_as_the_pipeline_does():
    frames, sets = torch.from_numpy(table().inputs(table().on(TEST))).unsqueeze(1), torch.arange(80).view(20, 4) % 64
    features = extract_features(trained().backbone, [CPU.frames(frames.squeeze(1))])
    with torch.inference_mode():
        plain = module.plain_answer(module.plain_network(trained()), frames, sets)[0]
        fast = view_set_logits(trained().head, features, sets)
    torch.testing.assert_close(fast, plain, rtol=1e-4, atol=1e-5 * float(plain.abs().max()))


def test_in_a_quick_run_whose_variants_take_a_second_rates_are_units_of_work(tmp_path, monkeypatch):
    def called(variants, rounds):
        for variant in variants.values():
            variant()
        return dict.fromkeys(variants, np.ones(rounds))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(module, "interleaved", called)
    monkeypatch.setattr("benchmarks.command.load", lambda path: recipe())
    for path in (FRAMES, CLASSIFIER):
        path.parent.mkdir(exist_ok=True)
    save_table(FRAMES, table())
    save_classifier(CLASSIFIER, trained(), recipe().model, table())
    result = CliRunner().invoke(module.speed, ["--quick", "--out", "out"], catch_exceptions=False)
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["results.csv", "results.md"]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in result.output.splitlines() if "/s" in line]
    rates = {what: (float(fast), float(plain)) for what, _, fast, plain, _ in rows}
    steps = {f"training step, batch {batch}": (batch, batch) for batch in (160, 32)}
    train, test = (int((table().anchor & (table().side == side)).sum()) for side in (module.TRAIN, TEST))
    tuning = {f"fine-tuning, feature_reuse {reuse}": (5 * train, 60) for reuse in (1, 8)}  # five epochs
    assert rates == steps | tuning | {"1 trials": (2 * test, 60)}  # two protocols


def test_the_ratio_is_the_median_of_the_rounds_ratios():
    assert median_ratio(np.array([2.5, 2.0, 3.0]), np.array([0.5, 1.0, 2.0])) == 2.0  # of the medians it is 2.5
