"""The network among the members: trained without as many folds as its limit of time allows."""

from types import SimpleNamespace

import numpy as np
import pytest

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.recognition import network_member
from tactile_viewgcn.recognition.fitting import training_recordings
from tactile_viewgcn.recognition.network_member import NetworkMember
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tests.glove_data import CPU, recipe, table, views_of


@pytest.mark.parametrize(("limit", "folds"), [(1e9, 2), (2.5, 1), (1.5, 0)])
def test_as_many_folds_are_answered_as_leave_time_for_the_last_training(monkeypatch, limit, folds):
    """A training takes a second; each fold has the recordings of two groups, which the others recognise."""
    frames = table("split.folds=6")
    recordings = training_recordings(frames)
    labels, number = (np.array([column[index[0]] for index in recordings]) for column in (frames.label, frames.group))
    masks = [np.isin(number, np.unique(number)[fold::4]) for fold in (0, 1)]
    network = NetworkMember(frames, views_of(frames, recipe()), recordings, 0, CPU)
    assert network.params.model.system == "vote" and network.table.transform == "log" and 0 < network.seconds() < 60
    network.params = recipe("model.system=vote", "model.backbone.width=8", "pretrain.epochs=8")
    monkeypatch.setattr(network_member, "LIMIT", limit)
    monkeypatch.setattr(network, "seconds", lambda: 1.0)
    shares, answered, note = network.left_out(masks)
    assert (answered == np.any(masks[:folds], axis=0)).all() if folds else not answered.any()
    assert (shares.sum(axis=1) > 0.99).tolist() == answered.tolist()
    assert (f"{folds} of 2" if folds else "tactile-viewgcn preset network") in note.text
    assert not folds or (shares.argmax(axis=1) == labels)[answered].mean() > 0.6


@pytest.mark.parametrize("batch", [2, 1000])
def test_the_seconds_of_a_training_are_in_proportion_to_its_anchors_and_epochs(monkeypatch, batch):
    """An anchor takes a second, also where there are fewer than the batches by which they are estimated."""
    frames, clock = table("split.folds=6"), SimpleNamespace(now=0.0)

    def pretrained(table, params, compute, on_epoch):
        for _ in range(params.pretrain.epochs):
            clock.now += table.anchor.sum()
            on_epoch()

    clock.perf_counter = lambda: clock.now
    monkeypatch.setattr(network_member, "time", clock)
    monkeypatch.setattr(network_member, "pretrain_backbone", pretrained)
    network = NetworkMember(frames, views_of(frames, recipe()), training_recordings(frames), 0, CPU)
    network.params = recipe(f"pretrain.batch={batch}", "pretrain.epochs=30")
    assert network.seconds() == pytest.approx(30 * (frames.anchor & (frames.side == TRAIN)).sum())


def test_what_is_left_out_is_no_training_data_and_a_network_that_diverges_is_left_out(monkeypatch):
    frames = table("split.folds=6")
    recordings, sides = training_recordings(frames), []

    def pretrained(table, *_):
        sides.append(table.side)
        raise UserError("diverged")

    monkeypatch.setattr(network_member, "pretrain_backbone", pretrained)
    network = NetworkMember(frames, views_of(frames, recipe()), recordings, 0, CPU)
    monkeypatch.setattr(network, "seconds", lambda: 1.0)
    _, answered, note = network.left_out([np.arange(len(recordings)) < 2])
    assert not answered.any() and "diverged" in note.text
    left = np.isin(np.arange(len(frames)), np.concatenate(recordings[:2]))
    np.testing.assert_array_equal(sides, [np.where(left, TEST, frames.side)])
