"""The network among the members: trained without as many folds as its limit of time allows."""

import numpy as np
import pytest

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.recognition import network_member
from tactile_viewgcn.recognition.fitting import training_recordings
from tactile_viewgcn.recognition.network_member import NetworkMember
from tactile_viewgcn.tables.frames import TEST
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
    network.params = recipe("pretrain.epochs=1000000")
    assert network.seconds() > 100  # all epochs count
    network.params = recipe("model.system=vote", "model.backbone.width=8", "pretrain.epochs=8")
    monkeypatch.setattr(network_member, "LIMIT", limit)
    monkeypatch.setattr(network, "seconds", lambda: 1.0)
    shares, answered, note = network.left_out(masks)
    assert (answered == np.any(masks[:folds], axis=0)).all() if folds else not answered.any()
    assert (shares.sum(axis=1) > 0.99).tolist() == answered.tolist()
    assert (f"{folds} of 2" if folds else "tactile-viewgcn preset network") in note.text
    assert not folds or (shares.argmax(axis=1) == labels)[answered].mean() > 0.6


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
