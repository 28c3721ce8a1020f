"""The benchmark of speed: its plain counterparts compute what the pipeline does, and its arithmetic is right."""

from functools import partial

import numpy as np
import pytest
import torch
from torch import nn

from benchmarks.speed import measurements, plain
from benchmarks.speed.__main__ import recipe_rows
from benchmarks.speed.agreement import agreement, differences
from benchmarks.speed.recordings import OBJECTS, recordings_table
from benchmarks.speed.sample import Sample, anchors_of
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.nn.backbone import Backbone, extract_features
from tactile_viewgcn.systems.classifier import build_classifier
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.small_tables import CPU, recipe, table, views_of


def frames_of(side):
    return torch.from_numpy(table().inputs(table().on(side))).unsqueeze(1)


@pytest.fixture
def classifier():
    """One of four views, its normalisations moved by the table's frames, in evaluation mode."""
    torch.manual_seed(0)
    model, frames = recipe("model.backbone.width=16").model, frames_of(TRAIN)[:64]
    classifier = build_classifier(torch.from_numpy(viewpoints(4)), 4, model, frames.shape[2:])
    for _ in range(20):
        classifier.head(classifier.backbone(frames)[torch.randint(64, (16, 4))])
    return classifier.eval()


@pytest.fixture
def sample(classifier):
    small, params = anchors_of(table(), 20), recipe("model.backbone.width=16")
    linear = nn.Linear(classifier.backbone.features, 4)
    pretrained = {"backbone": classifier.backbone.state_dict(), "classifier": linear.state_dict()}
    return Sample(params, CPU, 1, small, views_of(small, params), pretrained, classifier)


def test_agreement_passes_the_network_and_refuses_a_wrong_one(sample, monkeypatch):
    rows = agreement(sample)
    assert [row["fast path"] for row in rows] == ["float32", "bfloat16"]
    assert [row["view sets"] for row in rows] == [80, 80]
    assert rows[0]["difference"] < rows[1]["difference"] > 1e-4

    def scaled(backbone, frames):
        return 1.01 * extract_features(backbone, frames)

    monkeypatch.setattr("benchmarks.speed.agreement.extract_features", scaled)
    with pytest.raises(UserError, match="float32 differs"):
        agreement(sample)


def test_the_difference_leaves_out_a_tenth_of_the_view_sets():
    expected = torch.tensor([[2.0, 0.0], [0.0, 1.0]]).repeat(10, 1)
    logits = expected.clone()
    logits[1] = torch.tensor([1.0, 0.5])  # another answer
    row = differences(logits, expected)
    assert (row["difference"], row["largest"], row["changed answers"]) == (0, 0.5, 1)
    logits[0, 0] += 0.5
    assert differences(logits, expected)["difference"] == 0.25


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


@pytest.mark.parametrize(
    ("measure", "rates"),
    [
        (partial(measurements.time_step, batch=24), [("training step", 24, 24)]),
        (measurements.time_finetuning, [("fine-tuning", 160, 60)] * 4),  # two epochs of 80 view sets; 60 plainly
        (measurements.time_evaluation, [("evaluation", 480, 60)]),  # 2 protocols of 3 trials
    ],
)
def test_rates_are_units_of_work_a_second(measure, rates, sample, monkeypatch):
    """Each variant is called once, and takes a second."""

    def called(variants, rounds):
        for variant in variants.values():
            variant()
        return dict.fromkeys(variants, np.ones(rounds))

    monkeypatch.setattr(measurements, "interleaved", called)
    monkeypatch.setattr(measurements, "EPOCHS", 2)
    rounded = [(row["what"], round(row["fast"], 6), round(row["plain"], 6)) for row in measure(sample)]
    assert rounded == rates


def test_the_recipe_is_multiplied_out():
    rates = [
        ("training step", "batch 160", 1.0, 1.0),
        ("training step", "batch 32", 1000.0, 100.0),
        ("evaluation", "", 10_000.0, 500.0),
        ("fine-tuning", "reuse 8", 400.0, 50.0),
    ]
    rows = [{"what": what, "size": size, "fast": fast, "plain": slow} for what, size, fast, slow in rates]
    hours = {row["part"]: row for row in recipe_rows(rows)}
    assert hours["pretraining"]["fast hours"] == pytest.approx(1095.93 / 3600)
    assert hours["pretraining"]["ratio"] == pytest.approx(10)
    assert hours["evaluation"]["plain hours"] == pytest.approx(644.76 / 3600)
    assert hours["fine-tuning, reuse 8"]["ratio"] == pytest.approx(8)
    assert hours["together, reuse 8"]["plain hours"] == pytest.approx((10959.3 + 10959.3 + 644.76) / 3600)


def test_made_up_recordings_are_one_group_each_and_pressed_where_their_object_is():
    frames = recordings_table(3 * OBJECTS, 4, 12)
    assert len(frames) == 12 * OBJECTS and frames.anchor.all() and (frames.group == frames.recording).all()
    assert (np.bincount(frames.label) == 12).all()
    index = np.array([5, 0, 7])
    assert (frames.counts[index] == np.stack([frames.counts[np.array([one])][0] for one in index])).all()
    excess = frames.inputs(np.arange(len(frames)), "counts")
    assert 15 < excess.max() < 1000 and abs(np.median(excess)) <= 3  # some sensors are pressed, most hardly
    maps = excess.reshape(3 * OBJECTS, 4, -1).mean(axis=1)
    alike, other = np.corrcoef(maps[0], maps[OBJECTS])[0, 1], np.corrcoef(maps[:OBJECTS])
    assert alike > np.median(other[np.triu_indices(OBJECTS, 1)])


def test_the_sample_is_some_anchors_of_each_class_on_each_side_spread_over_its_recordings():
    small = anchors_of(table(), 20)
    assert small.anchor.all()
    for side in (TRAIN, TEST):
        on = small.side == side
        assert np.bincount(small.label[on]).tolist() == [20] * 4
        assert set(small.recording[on]) == set(table().recording[table().anchor & (table().side == side)])
