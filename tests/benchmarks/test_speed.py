"""The benchmark of speed: its plain counterparts compute what the pipeline does; a run with a fixed clock."""

import csv

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from torch import nn

from benchmarks.speed import measurements, plain
from benchmarks.speed.__main__ import speed
from benchmarks.speed.sample import anchors_of
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.nn.backbone import Backbone, extract_features
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.frames import TEST, TRAIN, save_table
from tests.glove_data import recipe, table, trained


def test_the_plain_backbone_learns_as_the_pipeline_s_does():
    torch.manual_seed(0)
    backbone, frames = Backbone(8), torch.rand(6, 1, 12, 12) ** 3
    nn.init.uniform_(backbone.stem.norm.weight, -1, 1)
    backbone.dropout.p = 0.0
    slow, factors = plain.plain_backbone(backbone), torch.randn(6, 16)
    assert len(slow.stem) == 4  # layers
    for network in (backbone, slow):
        (network(frames) * factors).sum().backward()
    for weight, other in zip(backbone.parameters(), slow.parameters(), strict=True):
        torch.testing.assert_close(weight.grad, other.grad, rtol=1e-3, atol=1e-4)
    for running, other in zip(backbone.buffers(), slow.buffers(), strict=True):
        torch.testing.assert_close(running, other, rtol=1e-5, atol=1e-5)


def test_a_fast_path_that_answers_otherwise_is_refused(monkeypatch):
    frames, sets = torch.from_numpy(table().inputs(table().on(TEST))).unsqueeze(1), np.arange(80).reshape(20, 4) % 64
    exact, half = plain.agreement(trained(), frames, sets)
    assert exact["difference"] < 1e-5 and 1e-4 < half["difference"] <= half["largest"]
    monkeypatch.setattr(plain, "extract_features", lambda *inputs: 1.01 * extract_features(*inputs))
    with pytest.raises(UserError, match="float32 differs"):
        plain.agreement(trained(), frames, sets)


def test_the_sample_has_anchors_of_each_class_on_each_side_from_all_its_recordings():
    small = anchors_of(table(), 20)
    assert small.anchor.all() and len(small.grasp) == len(small)
    for side in (TRAIN, TEST):
        on = small.side == side
        assert np.bincount(small.label[on]).tolist() == [20] * 4
        assert set(small.recording[on]) == set(table().recording[table().anchor & (table().side == side)])


def test_in_a_quick_run_whose_variants_take_a_second_rates_are_units_of_work(tmp_path, monkeypatch):
    def called(variants, rounds):
        for variant in variants.values():
            variant()
        return dict.fromkeys(variants, np.ones(rounds))

    monkeypatch.setattr(measurements, "interleaved", called)
    monkeypatch.setattr("benchmarks.command.load", lambda path: recipe())
    save_table(tmp_path / "frames.h5", table())
    save_classifier(tmp_path / "classifier.pt", trained(), recipe().model, table())
    files = {"--frames": "frames.h5", "--classifier": "classifier.pt", "--out": "out"}
    words = [word for option, name in files.items() for word in (option, str(tmp_path / name))]
    result = CliRunner().invoke(speed, ["--quick", *words], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines()))
    rates = [(row["what"], round(float(row["fast"])), round(float(row["plain"]))) for row in rows]
    steps = [("training step", 160, 160), ("training step", 32, 32)]
    tuning = [("fine-tuning", 5 * 48, 48)] * 4  # epochs of the twelve anchors of four classes
    assert rates == [*steps, *tuning, ("evaluation", 2 * 3 * 48, 48)]  # protocols and trials
    hours = [30 * 36_531 / 32 / 3600, 20 * 16_119 / 288 / 3600, 15 * 36_531 / 240 / 3600]
    assert f"| together, reuse 8    | {sum(hours):.3g} " in result.output
