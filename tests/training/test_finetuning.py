"""The whole network, trained on view sets from a pretrained backbone."""

import numpy as np
import pytest
import torch

from tactile_viewgcn.recognition.sequential import sequential_trials
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION
from tactile_viewgcn.training import finetuning
from tactile_viewgcn.training.checkpoint import Progress
from tactile_viewgcn.training.finetuning import SideViewSets, finetune_classifier
from tactile_viewgcn.views.sampling import ViewSets
from tests.small_tables import CPU, fewer_anchors, pretrained, recipe, table, views_of

VALIDATED = "split.validation=0.25"


def finetuned(*changes, seed=0, every=1):
    """The classifier and its curves, from each `every`-th anchor."""
    params, first = recipe(*changes, f"seed={seed}"), recipe(*changes)
    frames = fewer_anchors(table(*(c for c in changes if c.startswith("split"))), every)
    classifier, progress = finetune_classifier(frames, views_of(frames, first), pretrained(), params, CPU)
    return classifier, progress.curves


def alike(one, other):
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)


@pytest.fixture
def draws(monkeypatch):
    """The view sets of every draw, as they are drawn."""
    drawn, draw = [], ViewSets.draw

    def watched(self, anchors, rng, assignment="index"):
        drawn.append(draw(self, anchors, rng, assignment))
        return drawn[-1]

    monkeypatch.setattr(ViewSets, "draw", watched)
    return drawn


@pytest.fixture
def fitted(monkeypatch):
    """What is handed to the loop over epochs, which then does nothing."""
    arguments = {}

    def fit(name, epochs, steps, optimiser, *_):
        arguments.update(epochs=epochs, groups=optimiser.param_groups)
        return Progress()

    monkeypatch.setattr(finetuning, "fit", fit)
    return arguments


@pytest.mark.parametrize("reuse", [1, 4])
def test_it_learns_to_tell_the_objects(reuse):
    _, curves = finetuned("finetune.epochs=2", f"finetune.feature_reuse={reuse}", VALIDATED)
    assert curves["validation_error"][-1] < 0.3  # chance: 0.75
    assert curves["loss"][1] < 0.7 * curves["loss"][0]


def test_one_seed_gives_one_set_of_weights():
    first, again, other = (finetuned(seed=seed, every=6)[0] for seed in (1, 1, 2))
    assert alike(first, again)
    assert not alike(first, other)


def test_view_sets_are_redrawn_every_epoch_and_the_validation_side_s_stay_the_same(draws):
    running = "finetune.moments=running"
    finetuned("finetune.epochs=3", VALIDATED, running, every=12)
    assert [len(sets) for sets in draws] == [12, 4, 12, 12]
    assert (draws[0] != draws[2]).any() and (draws[2] != draws[3]).any()
    draws.clear()
    finetuned("finetune.epochs=3", "finetune.resample_views=never", running, every=12)
    assert len(draws) == 1


@pytest.mark.parametrize(("wanted", "share"), [("true", 0.2), ("false", 0.0)])
def test_the_backbone_s_dropout_can_be_left_out(fitted, wanted, share):
    classifier, _ = finetuned(f"finetune.backbone_dropout={wanted}")
    assert classifier.backbone.dropout.p == share


def test_backbone_and_graph_network_have_rates_of_their_own(fitted):
    classifier, _ = finetuned("finetune.lr=5e-4", "finetune.epochs=15")
    backbone, head = fitted["groups"]
    assert fitted["epochs"] == 15
    assert (backbone["lr"], head["lr"]) == (1e-4, 5e-4)
    assert {(group["momentum"], group["weight_decay"]) for group in fitted["groups"]} == {(0.9, 1e-4)}
    assert sum(weight.numel() for weight in backbone["params"]) == 674_240
    assert len(head["params"]) == len(list(classifier.head.parameters()))


def test_a_side_draws_one_set_around_each_of_its_anchors():
    frames = fewer_anchors(table(VALIDATED), 3)
    side = SideViewSets(VALIDATION, frames, views_of(frames, recipe()), CPU, 0, "anchor")
    index = frames.on(VALIDATION)
    np.testing.assert_array_equal(side.labels, frames.label[index])
    np.testing.assert_array_equal(side.frames[torch.arange(len(index))][:, 0], frames.inputs(index))
    sets = side.draw()
    np.testing.assert_array_equal(index[sets[:, 0]], np.flatnonzero(frames.anchor & (frames.side == VALIDATION)))
    assert sets.max() < len(index)


def planned(*changes):
    """A side, its anchors' view sets and the batches of an epoch."""
    params, frames = recipe(*changes), table()
    side = SideViewSets(TRAIN, frames, views_of(frames, params), CPU, 0, "index")
    drawn = side.draw()
    return side, drawn, list(side.batches(drawn, params.finetune))


def test_an_epoch_s_batches_hold_every_view_set_once_and_differ_by_one_at_most():
    _, drawn, plan = planned("finetune.batch=7")
    found = np.concatenate([sets for sets, _ in plan])
    assert sorted(map(tuple, found)) == sorted(map(tuple, drawn))
    assert (found != drawn).any()
    sizes = {len(sets) for sets, _ in plan}
    assert max(sizes) == 7 and min(sizes) >= 6
    for sets, fresh in plan:
        np.testing.assert_array_equal(fresh, np.broadcast_to(np.arange(4), sets.shape))


@pytest.mark.parametrize(("feature_reuse", "fresh"), [(1, 4), (2, 2), (3, 2), (4, 1), (9, 1)])
def test_one_view_in_reuse_passes_the_backbone_the_anchor_always(feature_reuse, fresh):
    side, drawn, plan = planned(f"finetune.feature_reuse={feature_reuse}")
    anchor_of = {tuple(sets): anchor for sets, anchor in zip(drawn, side.anchors, strict=True)}
    columns = set()
    for sets, columns_of in plan:
        assert columns_of.shape == (len(sets), fresh)
        assert (np.diff(columns_of, axis=1) > 0).all()
        for row, own in zip(sets, columns_of, strict=True):
            assert anchor_of[tuple(row)] in row[own]
        columns |= set(columns_of.ravel().tolist())
    assert columns == {0, 1, 2, 3}


def test_random_sizes_are_all_there_one_a_batch_and_keep_the_anchor():
    side, _, plan = planned("finetune.num_views=random", "finetune.batch=3", "finetune.feature_reuse=2")
    sizes = [sets.shape[1] for sets, _ in plan]
    assert set(sizes) == {1, 2, 3, 4}
    anchors = set(side.anchors.tolist())
    for sets, fresh in plan:
        assert fresh.shape == (len(sets), -(-sets.shape[1] // 2))
        if sets.shape[1] < 4:
            assert set(sets[:, 0].tolist()) <= anchors
            assert (fresh[:, 0] == 0).all()


def test_a_classifier_of_any_number_of_views_is_better_than_chance_with_each():
    classifier, _ = finetuned("finetune.num_views=random", "finetune.epochs=3", VALIDATED)
    frames = table()
    index = frames.on(TEST)
    with torch.inference_mode():
        features = classifier.eval().backbone(CPU.frames(torch.from_numpy(frames.inputs(index))))
    found = sequential_trials(classifier, [1.0] * 4, features, frames.label[index], frames.recording[index],
                  np.arange(len(index)), [np.random.default_rng(0)])  # fmt: skip
    assert (found.correct.mean(axis=(0, 2)) > 0.5).all()  # chance: 0.25
