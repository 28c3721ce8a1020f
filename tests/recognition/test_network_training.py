"""The network among the members is trained for every fold or not at all, by counted work.

The classifier is calibrated in either case.
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
    """Return the training of the preset's network, or of a small network."""
    views = views_of(frames, recipe())
    recordings = training_recordings(frames)
    preset_training = PresetTraining(frames, views, recordings, seed=0, compute=CPU)
    if small:
        preset_training.params = recipe(*SMALL)
    return preset_training


def test_each_fold_is_answered_by_a_training_without_it_and_nothing_else_is():
    frames = table(FOLDS)
    recordings = training_recordings(frames)
    first_frames = [index[0] for index in recordings]
    labels = frames.label[first_frames]
    groups = frames.group[first_frames]
    masks = [np.isin(groups, np.unique(groups)[fold::4]) for fold in (0, 1)]
    examples = examples_of(frames, recordings, (1, 2, 4), 0)
    member = NetworkMember(examples.representation, 4, training=training(frames))
    shares = out_of_fold_answers(member, examples, masks, seed=0)
    answered = np.any(masks, axis=0)
    assert (shares.sum(axis=1) > 0.99).tolist() == answered.tolist()
    assert not shares[~answered].any()
    assert (shares.argmax(axis=1) == labels)[answered].mean() > 0.6


def test_the_member_is_the_preset_s_network():
    preset_training = training(table(FOLDS), small=False)
    preset = default_params((*preset_changes(NETWORK), "seed=0"))
    assert preset_training.params == preset
    assert preset_training.table.transform == preset.preprocess.transform


def test_the_work_is_the_anchors_readings_in_every_epoch_of_every_training():
    """Of the recordings' 12 frames of 12 x 12 sensors, half are anchors.

    Each of the two folds holds out three recordings.
    """
    frames = table(FOLDS)
    halved = frames.with_columns(anchor=np.arange(len(frames)) % 2 == 0)
    preset_training = training(halved)
    count = len(preset_training.recordings)
    folds = [np.arange(count) < 3, np.arange(count) >= count - 3]
    readings_of_recording = 6 * 144 * 8
    assert preset_training.readings([]) == readings_of_recording * count
    assert preset_training.readings(folds) == readings_of_recording * (count + 2 * (count - 3))


def fitted(members, frames=None):
    """Return the classifier of some members, with its weights, temperature and notes."""
    if frames is None:
        frames = table(FOLDS)
    params = recipe("model.system=sensors", f"model.members={members}")
    return fit_classifier(frames, views_of(frames, params), {}, params, CPU)


def names(fit):
    """Return the names of the members that a fit holds."""
    return [member.name for member in fit.classifier.members]


def dealt():
    """Return frames with wrong labels in every third recording.

    Every member is then wrong about some recordings.
    """
    frames = table(FOLDS)
    label = np.where(frames.recording % 3 == 0, frames.label // 2, frames.label)
    return frames.with_columns(label=label)


@pytest.fixture
def trained(monkeypatch):
    """Make the network small, and collect the held-out frames of each of its training runs."""
    training_runs = []
    original = PresetTraining.train

    def train(self, recordings):
        self.params = recipe(*SMALL, "pretrain.epochs=2")
        held_out = np.zeros(len(self.table), dtype=bool)
        for recording in np.flatnonzero(~recordings):
            held_out[self.recordings[recording]] = True
        training_runs.append(held_out)
        return original(self, recordings)

    monkeypatch.setattr(PresetTraining, "train", train)
    return training_runs


def limit(monkeypatch, readings):
    monkeypatch.setitem(network_training.MOST_READINGS, "cpu", readings)


@pytest.mark.parametrize("members", ["auto", "[kernel, network]"])
def test_above_the_limit_nothing_is_trained_the_note_says_so_and_the_others_are_calibrated(
    monkeypatch, trained, members
):
    limit(monkeypatch, 1.0)
    without = fitted(members, dealt())
    assert NETWORK not in without.model.members + names(without)
    assert not trained
    assert without.temperature is not None
    (note,) = [note for note in without.notes if note.text.startswith("network:")]
    assert "skipped" in note.text
    assert "limit" in note.text


@pytest.mark.parametrize("members", ["[kernel, network]", "[network]"])
def test_below_the_limit_every_fold_is_run_and_all_are_calibrated(monkeypatch, trained, members):
    limit(monkeypatch, np.inf)
    fit = fitted(members)
    assert NETWORK in fit.model.members
    assert fit.temperature is not None
    assert names(fit) == fit.model.members
    training_set = table(FOLDS).side == TRAIN
    *folds, last = trained
    assert not last.any()
    assert np.array_equal(np.sum(folds, axis=0), training_set.astype(int))
    assert len(folds) > 1


def test_the_only_member_is_trained_whatever_the_limit(monkeypatch, trained):
    limit(monkeypatch, 1.0)
    fit = fitted("[network]")
    assert fit.model.members == [NETWORK]
    assert fit.temperature is not None
    assert len(trained) > 1


def test_a_network_of_little_weight_is_no_part_of_the_classifier(monkeypatch, trained):
    limit(monkeypatch, np.inf)
    monkeypatch.setattr(OutOfFold, "member_weights", lambda self, members: {"kernel": 1.0})
    fit = fitted("auto", dealt())
    assert trained
    assert fit.model.members == ["kernel"]
    assert names(fit) == [*fit.classifier.state_dict()["members"]] == ["kernel"]


@pytest.mark.parametrize("members", ["auto", "[kernel, network]"])
def test_how_busy_the_machine_is_changes_nothing(monkeypatch, trained, members):
    """An hour passes between two looks at the clock."""
    first = fitted(members, dealt())
    hours = iter(range(10**9))
    monkeypatch.setattr("time.perf_counter", lambda: 3600.0 * next(hours))
    busy = fitted(members, dealt())
    assert busy.model.members == first.model.members
    assert first.temperature is not None
    assert busy.temperature == first.temperature
    assert busy.classifier.weights == first.classifier.weights
    assert trained
    assert len(trained) % 2 == 0  # both fits have the same number of training runs


def test_a_network_that_diverges_is_left_out_and_was_given_no_frame_that_is_left_out(monkeypatch):
    frames = table(FOLDS)
    splits = []

    def pretrained(table, *_):
        splits.append(table.side)
        raise UserError("diverged")

    monkeypatch.setattr(network_training, "pretrain_backbone", pretrained)
    without = fitted("[kernel, network]")
    assert without.model.members == ["kernel"]
    assert without.temperature is not None
    assert any("diverged" in note.text for note in without.notes)
    (split,) = splits
    moved = split != frames.side
    assert moved.any()
    assert (split[moved] == TEST).all()
    assert (frames.side[moved] == TRAIN).all()
    with pytest.raises(UserError, match="diverged"):
        fitted("[network]")
