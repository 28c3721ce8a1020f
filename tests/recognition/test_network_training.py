"""The network among the members: all its training runs are made or none, by counted work, and its
answers are calibrated in either case.
"""

import numpy as np
import pytest

from tactile_viewgcn.members.network import NETWORK, NetworkMember
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import default_params, preset_changes
from tactile_viewgcn.recognition import network_training
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.network_training import PresetTraining
from tactile_viewgcn.recognition.out_of_fold import OutOfFold, out_of_fold_answers
from tactile_viewgcn.recognition.training_recordings import examples_of, training_recordings
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tests.glove_data import CPU, recipe, table, views_of

FOLDS = "split.folds=6"
SMALL = ("model.system=vote", "model.backbone.width=8", "pretrain.epochs=8")


def training(frames, *, small=True):
    views, recordings = views_of(frames, recipe()), training_recordings(frames)
    made = PresetTraining(frames, views, recordings, seed=0, compute=CPU)
    if small:
        made.params = recipe(*SMALL)
    return made


def test_each_fold_is_answered_by_a_training_without_it_and_nothing_else_is():
    frames = table(FOLDS)
    recordings = training_recordings(frames)
    labels, number = (
        np.array([column[index[0]] for index in recordings])
        for column in (frames.label, frames.group)
    )
    masks = [np.isin(number, np.unique(number)[fold::4]) for fold in (0, 1)]
    examples = examples_of(frames, recordings, (1, 2, 4), 0)
    member = NetworkMember(examples.representation, 4, training=training(frames))
    shares = out_of_fold_answers(member, examples, masks, seed=0)
    answered = np.any(masks, axis=0)
    assert (shares.sum(axis=1) > 0.99).tolist() == answered.tolist() and not shares[~answered].any()
    assert (shares.argmax(axis=1) == labels)[answered].mean() > 0.6


def test_the_member_is_the_preset_s_network():
    made = training(table(FOLDS), small=False)
    preset = default_params((*preset_changes(NETWORK), "seed=0"))
    assert made.params == preset and made.table.transform == preset.preprocess.transform


def test_the_work_is_the_anchors_readings_in_every_epoch_of_every_training():
    """Return two folds of three of 20 recordings, each with 12 frames of 12 x 12, half of them
    anchors.
    """
    frames = table(FOLDS)
    halved = frames.with_columns(anchor=np.arange(len(frames)) % 2 == 0)
    made = training(halved)
    count = len(made.recordings)
    folds = [np.arange(count) < 3, np.arange(count) >= count - 3]
    each = 6 * 144 * 8
    assert made.readings([]) == each * count
    assert made.readings(folds) == each * (count + 2 * (count - 3))


def fitted(members, frames=None):
    frames = table(FOLDS) if frames is None else frames
    params = recipe("model.system=sensors", f"model.members={members}")
    return fit_classifier(frames, views_of(frames, params), {}, params, CPU)


def names(one):
    return [member.name for member in one.classifier.members]


def dealt():
    """Return the frames with wrong labels in every third recording, so that every member is
    sometimes wrong.
    """
    frames = table(FOLDS)
    label = np.where(frames.recording % 3 == 0, frames.label // 2, frames.label)
    return frames.with_columns(label=label)


@pytest.fixture
def trained(monkeypatch):
    """Collect the sets of the frames in each training run of the network, which is small."""
    sides = []
    original = PresetTraining.train

    def train(self, recordings):
        self.params = recipe(*SMALL, "pretrain.epochs=2")
        held_out = [self.recordings[number] for number in np.flatnonzero(~recordings)]
        index = np.concatenate([*held_out, np.zeros(0, int)])
        sides.append(np.isin(np.arange(len(self.table)), index))
        return original(self, recordings)

    monkeypatch.setattr(PresetTraining, "train", train)
    return sides


def limit(monkeypatch, readings):
    monkeypatch.setitem(network_training.MOST_READINGS, "cpu", readings)


@pytest.mark.parametrize("members", ["auto", "[kernel, network]"])
def test_above_the_limit_nothing_is_trained_the_note_says_so_and_the_others_are_calibrated(
    monkeypatch, trained, members
):
    limit(monkeypatch, 1.0)
    without = fitted(members, dealt())
    assert NETWORK not in without.model.members + names(without) and not trained
    assert without.temperature is not None
    (note,) = [note for note in without.notes if note.text.startswith("network:")]
    assert "skipped" in note.text and "limit" in note.text


@pytest.mark.parametrize("members", ["[kernel, network]", "[network]"])
def test_below_the_limit_every_fold_is_run_and_all_are_calibrated(monkeypatch, trained, members):
    limit(monkeypatch, np.inf)
    one = fitted(members)
    assert NETWORK in one.model.members and one.temperature is not None
    assert names(one) == one.model.members
    train = table(FOLDS).side == TRAIN
    *folds, last = trained
    assert (
        not last.any()
        and np.array_equal(np.sum(folds, axis=0), train.astype(int))
        and len(folds) > 1
    )


def test_the_only_member_is_trained_whatever_the_limit(monkeypatch, trained):
    limit(monkeypatch, 1.0)
    one = fitted("[network]")
    assert one.model.members == [NETWORK] and one.temperature is not None and len(trained) > 1


def test_a_network_of_little_weight_is_no_part_of_the_classifier(monkeypatch, trained):
    limit(monkeypatch, np.inf)
    monkeypatch.setattr(OutOfFold, "member_weights", lambda self, members: {"kernel": 1.0})
    one = fitted("auto", dealt())
    assert trained and one.model.members == ["kernel"]
    assert names(one) == [*one.classifier.state_dict()["members"]] == ["kernel"]


@pytest.mark.parametrize("members", ["auto", "[kernel, network]"])
def test_how_busy_the_machine_is_changes_nothing(monkeypatch, trained, members):
    """An hour passes between two looks at the clock."""
    first = fitted(members, dealt())
    hours = iter(range(10**9))
    monkeypatch.setattr("time.perf_counter", lambda: 3600.0 * next(hours))
    busy = fitted(members, dealt())
    assert (
        busy.model.members == first.model.members
        and busy.temperature == first.temperature is not None
    )
    assert busy.classifier.weights == first.classifier.weights
    assert trained and len(trained) % 2 == 0  # as many trainings


def test_a_network_that_diverges_is_left_out_and_was_given_no_frame_that_is_left_out(monkeypatch):
    frames = table(FOLDS)
    sides = []

    def pretrained(table, *_):
        sides.append(table.side)
        raise UserError("diverged")

    monkeypatch.setattr(network_training, "pretrain_backbone", pretrained)
    without = fitted("[kernel, network]")
    assert without.model.members == ["kernel"] and without.temperature is not None
    assert any("diverged" in note.text for note in without.notes)
    (side,) = sides
    moved = side != frames.side
    assert moved.any() and (side[moved] == TEST).all() and (frames.side[moved] == TRAIN).all()
    with pytest.raises(UserError, match="diverged"):
        fitted("[network]")
