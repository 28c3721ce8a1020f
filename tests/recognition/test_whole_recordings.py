"""A network answers whole recordings by view sets like the sets that it was trained on."""

import numpy as np
import pytest
import torch

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.nn.network import ViewNetwork

VIEWS = 4
SHAPE = (8, 10)
PARAMS = {
    "precision": "float32",
    "preprocess.baseline": "none",
    "preprocess.zero": 500,
    "preprocess.filter": "none",
    "preprocess.scale": 60,
    "model.backbone.width": 8,
    "pretrain.epochs": 1,
    "finetune.epochs": 1,
}


def recording(label, seed, lengths):
    """Return counts (T, 8, 10) of four grips of those lengths, and the grip (T,) of each frame.

    Each grip presses twenty sensors of its own, and grips differ far more than objects do.
    """
    rng = np.random.default_rng(seed)
    grips = np.repeat(np.arange(VIEWS), lengths)
    counts = 500 + rng.normal(0, 1, (len(grips), 80))
    for frame, grip in enumerate(grips):
        counts[frame, 20 * grip : 20 * grip + 20] += 50
    counts[:, label] += 20
    return np.rint(counts).reshape(-1, *SHAPE).astype(np.int16), grips


def view_sets_and_answer(classifier, counts, monkeypatch):
    """Return the view sets (S, V) of one recording that a network answers, and its answer (C,)."""
    view_sets = []
    answer = ViewNetwork.view_sets

    def recorded(network, values, sets):
        view_sets.append(sets)
        return answer(network, values, sets)

    with monkeypatch.context() as patch:
        patch.setattr(ViewNetwork, "view_sets", recorded)
        probabilities = classifier.predict_proba([counts])[0]
    return np.concatenate(view_sets), probabilities


def fitted(system, **changes):
    """Return a small network fitted to eight recordings of two objects.

    Args:
        system: the system.
        changes: parameters, with the first dot as an underscore.
    """
    X = [recording(seed % 2, seed, (5, 5, 5, 5))[0] for seed in range(8)]
    params = PARAMS | {key.replace("_", ".", 1): value for key, value in changes.items()}
    return TactileClassifier(system=system, views=VIEWS, params=params).fit(X, np.arange(8) % 2)


LENGTHS = [(9, 2, 4, 1), (1, 1, 1, 13)]


@pytest.mark.parametrize("system", ["view_gcn", "stag", "cnn_lstm"])
def test_a_network_trained_on_clusters_gets_one_frame_of_each_cluster_of_the_recording(
    tmp_path, monkeypatch, system
):
    classifier = fitted(system)
    classifier.save(tmp_path / "classifier.pt")
    loaded = TactileClassifier.load(tmp_path / "classifier.pt")
    for lengths in LENGTHS:
        counts, grip = recording(0, 99, lengths)
        sets, answer = view_sets_and_answer(classifier, counts, monkeypatch)
        one_of_each_grip = np.tile(np.arange(VIEWS), (len(sets), 1))
        np.testing.assert_array_equal(np.sort(grip[sets], axis=1), one_of_each_grip)
        assert set(sets.ravel().tolist()) == set(range(len(counts)))
        again, same = view_sets_and_answer(loaded, counts, monkeypatch)
        np.testing.assert_array_equal(again, sets)
        np.testing.assert_array_equal(same, answer)
        others = [recording(1, 5, (2, 2, 2, 2))[0], counts, recording(1, 6, (1, 0, 1, 0))[0]]
        np.testing.assert_allclose(classifier.predict_proba(others)[1], answer, atol=1e-6)


@pytest.mark.parametrize(
    "changes", [{"finetune_draw": "random"}, {"cluster_method": "none"}], ids=str
)
def test_a_network_trained_on_random_sets_gets_sets_that_are_spread_over_the_recording(
    monkeypatch, changes
):
    classifier = fitted("view_gcn", **changes)
    for lengths in LENGTHS:
        counts, _ = recording(0, 99, lengths)
        sets, _ = view_sets_and_answer(classifier, counts, monkeypatch)
        np.testing.assert_array_equal(sets, np.arange(16).reshape(VIEWS, 4).T)


@pytest.mark.parametrize("lengths", [(1, 0, 0, 0), (1, 1, 0, 1), (2, 0, 1, 0)])
def test_a_recording_of_fewer_frames_than_views_is_answered(monkeypatch, lengths):
    counts, _ = recording(0, 99, lengths)
    sets, answer = view_sets_and_answer(fitted("view_gcn"), counts, monkeypatch)
    assert sets.shape == (len(counts), VIEWS)
    assert sets.max() < len(counts)
    assert torch.isfinite(torch.from_numpy(answer)).all()
    assert answer.sum() == pytest.approx(1, abs=1e-5)
