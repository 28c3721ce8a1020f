"""The study of speed: its plain counterparts compute what the pipeline does, and its arithmetic is right."""

import h5py
import numpy as np
import pytest
import torch
import yaml

from studies.speed import limits, plain
from studies.speed.agreement import TOLERANCE, differences, refuse
from studies.speed.pairs import source_of
from studies.speed.recipe import Costs, arithmetic, hours, rows
from studies.speed.sample import OF_A_CLASS, fewer_anchors, smaller
from studies.speed.turns import Pair, in_turn, share
from tactile_viewgcn.classifier import Classifier, logits_of_sets
from tactile_viewgcn.nn.backbone import Backbone, features_of
from tactile_viewgcn.recordings import Recordings, write_recordings
from tactile_viewgcn.split import TEST, TRAIN
from tactile_viewgcn.stag import read_metadata
from tactile_viewgcn.stag_form import write_metadata
from tactile_viewgcn.viewpoints import viewpoints
from tests.imports import ROOT, closure
from tests.tables import recipe, table


def frames_of(side):
    return torch.from_numpy(table().inputs(table().on(side))).unsqueeze(1)


def random_backbone(width=8):
    """A backbone whose normalisations are not the identity, in training mode."""
    torch.manual_seed(0)
    backbone = Backbone(width)
    for _ in range(3):
        backbone(torch.rand(16, 1, 12, 12))
    torch.nn.init.uniform_(backbone.stem.norm.weight, -1, 1)
    return backbone


def random_classifier():
    """One of four views, its normalisations moved by the table's frames, in evaluation mode."""
    torch.manual_seed(0)
    model, frames = recipe("model.backbone.width=16").model, frames_of(TRAIN)[:64]
    classifier = Classifier(torch.from_numpy(viewpoints(4)), 4, model, frames.shape[2:])
    for _ in range(20):
        classifier.head(classifier.backbone(frames)[torch.randint(64, (16, 4))])
    return classifier.eval()


def test_the_plain_network_gives_the_pipeline_s_logits():
    classifier, frames = random_classifier(), frames_of(TEST)
    sets = np.random.default_rng(0).integers(len(frames), size=(30, 4))
    expected = plain.logits(plain.PlainClassifier(classifier), frames, sets)
    with torch.no_grad():
        found = logits_of_sets(classifier.head, features_of(classifier.backbone, frames), torch.from_numpy(sets))
    assert expected.std(dim=0).min() > 0
    assert (found - expected).abs().max() <= TOLERANCE["float32"] * expected.abs().max()
    with torch.no_grad():
        classifier.backbone.stage2[1].conv2.weight.mul_(1.01)
        other = logits_of_sets(classifier.head, features_of(classifier.backbone, frames), torch.from_numpy(sets))
    assert (other - expected).abs().max() > 10 * TOLERANCE["float32"] * expected.abs().max()


def test_the_plain_backbone_learns_as_the_pipeline_s_does():
    backbone, frames = random_backbone(), torch.rand(6, 1, 12, 12) ** 3
    backbone.dropout.p = 0.0
    slow = plain.PlainBackbone(backbone)
    slopes = torch.randn(6, 16)
    for network in (backbone, slow):
        (network(frames) * slopes).sum().backward()
    theirs = dict(slow.named_parameters())
    for name, weight in backbone.named_parameters():
        torch.testing.assert_close(weight.grad, theirs[name].grad, rtol=1e-3, atol=1e-4)
    buffers = dict(slow.named_buffers())
    for name, running in backbone.named_buffers():
        torch.testing.assert_close(running, buffers[name], rtol=1e-5, atol=1e-5)


def test_the_plain_loops_take_a_step_down():
    classifier, frames = random_classifier(), frames_of(TRAIN)
    labels = torch.from_numpy(table().label[table().on(TRAIN)].astype(np.int64))
    slow = plain.PlainClassifier(classifier)
    before = [weight.clone() for weight in slow.parameters()]
    sets = np.random.default_rng(0).integers(len(frames), size=(20, 4))
    plain.finetune_epoch(slow, frames, labels, sets, recipe().finetune, 0.015)
    assert all((weight != old).any() for weight, old in zip(slow.parameters(), before, strict=True))
    backbone, head = plain.PlainBackbone(classifier.backbone), torch.nn.Linear(32, 4)
    optimiser = torch.optim.SGD([*backbone.parameters(), *head.parameters()], 0.01)
    plain.pretrain_epoch(backbone, head, optimiser, frames[:16], labels[:16], batch=8, noise=0.0)
    weights = zip(backbone.parameters(), classifier.backbone.parameters(), strict=True)
    assert all((weight != old).any() for weight, old in weights)


def test_the_plain_drawing_takes_a_frame_of_each_cluster_of_the_anchor_s_pool():
    rng = np.random.default_rng(0)
    pool, views = np.arange(90) % 3, 4
    cluster = np.where(pool == 2, rng.integers(3, size=90), rng.integers(4, size=90))  # pool 2 has no cluster 3
    anchors = rng.permutation(90)[:40]
    sets = plain.draw(anchors, cluster, pool, views, rng)
    assert sets.shape == (40, views)
    assert (pool[sets] == pool[anchors][:, None]).all()
    assert (sets[np.arange(40), cluster[anchors]] == anchors).all()
    full = pool[anchors] < 2
    assert (cluster[sets[full]] == np.arange(views)).all() and full.any()
    assert (cluster[sets[~full, :3]] == np.arange(3)).all() and (~full).any()
    assert len(np.unique(plain.draw(np.repeat(anchors[:1], 200), cluster, pool, views, rng))) > 20


def test_the_plain_ingest_writes_the_frames_that_the_pipeline_s_does(tmp_path):
    write_metadata(tmp_path / "metadata.mat", source_of(table(), 400))
    plain.ingest(tmp_path / "metadata.mat", tmp_path / "plain.h5")
    write_recordings(tmp_path / "fast.h5", read_metadata(tmp_path / "metadata.mat"), "")
    with Recordings(tmp_path / "fast.h5") as fast, h5py.File(tmp_path / "plain.h5") as slow:
        assert len(fast) == 400 > len(table())
        np.testing.assert_array_equal(fast.frames(np.arange(400)), slow["pressure"][()])
        assert set(fast.columns) == set(slow) - {"pressure"}
        for name, values in fast.columns.items():
            np.testing.assert_array_equal(values, slow[name][()])


def test_a_ratio_is_the_median_of_the_rounds_ratios():
    pair = Pair(np.array([1.0, 2.0, 4.0]), np.array([10.0, 8.0, 12.0]), fast_work=2, plain_work=4)
    assert pair.each == (1.0, 2.5)
    assert pair.rates == (1.0, 0.4)
    assert pair.ratio == pytest.approx(2.0)  # (10 / 4) / (1 / 2) = 5, 2, 1.5; of the medians it would be 2.5


def test_a_share_is_the_limit_s_seconds_over_the_work_s_in_the_same_round():
    assert share(np.array([4.0, 10.0, 5.0]), np.array([1.0, 4.0, 2.0])) == pytest.approx(0.4)


def test_works_take_turns_after_a_round_that_is_not_kept():
    order = []

    def work(name, seconds):
        def once():
            order.append(name)
            return seconds + len(order)

        return once

    taken = in_turn({"fast": work("fast", 0.0), "plain": work("plain", 10.0)}, 2)
    assert order == ["fast", "plain"] * 3
    assert taken["fast"].tolist() == [3.0, 5.0] and taken["plain"].tolist() == [14.0, 16.0]


def test_the_recipe_is_multiplied_out():
    costs = Costs(frame=1e-3, view_set=1e-2, test_frame=2e-3, trial=1e-4)
    found = hours(costs)
    assert found["pretraining"] == pytest.approx(1095.93 / 3600)
    assert found["fine-tuning"] == pytest.approx(5479.65 / 3600)
    assert found["evaluation"] == pytest.approx((32.238 + 32.238) / 3600)
    assert found["together"] == pytest.approx((1095.93 + 5479.65 + 64.476) / 3600)
    assert arithmetic(costs)["pretraining"] == "30 x 36,531 frames x 1 ms"
    assert "16,119 frames x 2 ms + 10 x 2 x 16,119 view sets x 0.1 ms" in arithmetic(costs)["evaluation"]
    assert rows(costs, Costs(1e-2, 1e-2, 0.0, 1e-3), {})[0]["ratio"] == pytest.approx(10)


def test_the_operations_of_a_frame_are_those_of_its_convolutions():
    slow = plain.PlainBackbone(Backbone())
    by_hand = 64 * 9 * 1024 + 4 * 64 * 64 * 9 * 256 + (64 + 3 * 128) * 128 * 9 * 64 + 64 * 128 * 64
    assert limits.operations(slow, torch.zeros(2, 1, 32, 32)) == 2 * 6 * by_hand
    assert by_hand * 6 == pytest.approx(432e6, rel=5e-3)


def test_convolutions_run_in_either_precision_on_any_frame():
    slow = plain.PlainBackbone(Backbone(8))
    for precision in limits.DTYPES:
        limits.convolutions(slow, torch.rand(2, 1, 9, 12), precision)()


def test_other_logits_are_refused_unless_another_view_was_selected():
    expected, labels = torch.tensor([[2.0, 0.0], [0.0, 1.0]]).repeat(10, 1), torch.tensor([0, 1]).repeat(10)
    kept = [torch.zeros(20, 2, 3)]
    found, chosen = expected.clone(), [kept[0].clone()]
    found[1] = torch.tensor([1.0, 0.5])
    row = {"fast path": "bfloat16"} | differences(found, expected, chosen, kept, labels)
    assert row["difference"] == row["of all"] == 0.5 and row["changed"] == 0
    assert row["changed answers"] == 1 and row["points of accuracy"] == pytest.approx(-5, abs=1e-3)
    with pytest.raises(ValueError, match=r"differs from the plain one by 0\.5"):
        refuse(row)
    chosen[0][1, 0, 2] = 1
    row = {"fast path": "bfloat16"} | differences(found, expected, chosen, kept, labels)
    assert row["difference"] == 0 and row["of all"] == 0.5 and row["changed"] == 1 and row["with the same views"] == 19
    refuse(row)
    chosen[0] += 1
    with pytest.raises(ValueError, match="0 of 20 view sets"):
        refuse({"fast path": "float32"} | differences(found, expected, chosen, kept, labels))


def test_the_sample_is_bounded_and_keeps_anchors_of_whole_classes(monkeypatch):
    monkeypatch.setattr("studies.speed.sample.OF_A_CLASS", 20)
    monkeypatch.setattr("studies.speed.sample.ANCHORS", 30)
    small = smaller(table())
    counts = np.array(
        [[((small.side == side) & (small.label == label)).sum() for label in range(4)] for side in (0, 2)]
    )
    assert OF_A_CLASS > 20 and (counts == 20).all()
    few = fewer_anchors(small)
    of_class = np.bincount(few.label[few.anchor & (few.side == TRAIN)], minlength=4)
    assert of_class.tolist() == [20, 20, 0, 0]
    assert (few.anchor == small.anchor)[few.side == TEST].all()


def test_the_pipeline_lists_the_modules_and_parameters_that_the_study_reads():
    from studies.speed.speed import READS

    (stage,) = yaml.safe_load((ROOT / "studies/speed/dvc.yaml").read_text())["stages"].values()
    assert {path for path in stage["deps"] if path.endswith(".py")} == closure("studies/speed/speed.py")
    assert stage["params"] == list(READS)
