"""Answers to groups that were left out, and what rests on them: weights, temperature; never on the
test side.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_viewgcn.recognition.fitting import ARRAY, CHANNELS, UNWEIGHED, fit_classifier
from tactile_viewgcn.recognition.left_out import LeftOut
from tactile_viewgcn.recognition.model_file import build_classifier
from tactile_viewgcn.sensors.representation import NETWORK
from tactile_viewgcn.tables.frames import TEST
from tests.glove_data import CPU, recipe, table, views_of
from tests.recognition.answers import Answers


def left_out(labels, groups, **options):
    return LeftOut(
        Answers(np.asarray(labels), np.asarray(groups), **options), np.asarray(groups), 0
    )


def wrong(left, *members):
    return left.wrong(dict.fromkeys(members, 1.0)).tolist()


def temperature(left, *members):
    return left.temperature(dict.fromkeys(members, 1.0))


@pytest.mark.parametrize(
    "groups", [np.arange(24) // 2, np.arange(24) % 6], ids=["of a class", "of several"]
)
def test_each_group_is_answered_once_by_fits_without_any_of_it(groups):
    """Estimators that know the groups that they were fitted to, and are wrong about all others."""
    left = left_out(np.arange(24) // 8, groups, knows=True)
    assert left.answered.all() and wrong(left, "svm") == [1] * len(set(groups))
    assert not any(wrong(left_out(np.arange(24) // 8, groups, knows=False), "trees", "svm"))


def test_a_class_that_would_not_be_fitted_stays_and_groups_are_weighed_alike():
    """One of one group, or of a group that spans classes; a wrong answer in two is half a wrong
    group.
    """
    left = left_out([0, 0, 0, 1, 1], [0, 1, 2, 3, 3], knows=False)
    assert left.answered.tolist() == [True] * 3 + [False] * 2
    spanning = left_out([0, 1, 0, 1, 2], [0, 0, 1, 1, 1], knows=False)
    assert spanning.answered.tolist() == [True] * 4 + [False]
    assert not left_out([0, 1], [0, 1], knows=False).answered.any()
    left = left_out([0, 0, 0, 1, 1, 1], [0, 0, 1, 2, 3, 3], knows=True)
    left.shares["svm"] = np.eye(3)[[1, 0, 0, 0, 1, 1]]
    assert wrong(left, "svm") == [0.5, 0, 1, 0]


def test_the_temperature_is_that_of_the_members_answers_with_their_weights():
    """All of 12 answers are right, so that by Laplace's rule 13 in 14 should be, each twice as
    often as both others.
    """
    left = left_out(
        np.arange(12) // 4, np.arange(12), knows=False, share={"svm": 0.8, "trees": 0.9}
    )

    def expected(*shares, floor=0.01):
        return sum(np.log((one + floor) / ((1 - one) / 2 + floor)) for one in shares) / np.log(
            2 * 13
        )

    assert temperature(left, "trees", "svm") == pytest.approx(expected(0.8, 0.9), rel=1e-3)
    assert temperature(left, "svm") == pytest.approx(expected(0.8, floor=0), rel=1e-3)
    assert left.temperature(left.weighed(["trees", "svm"])) == pytest.approx(1, rel=1e-2)


LABELS = np.repeat([0, 1, 2], 12)


def with_answers(**wrong):
    """Members that answer some of the 12 recordings of each class wrongly, from a first to a last,
    as sure of all.
    """
    left = left_out(LABELS, np.arange(len(LABELS)) // 2, knows=False)
    for name, recordings in wrong.items():
        answers = (LABELS + np.isin(np.arange(len(LABELS)) % 12, recordings)) % 3
        left.shares[name] = 0.9 * np.eye(3, dtype=np.float32)[answers] + 0.1 / 3
    return left


def test_a_member_that_errs_more_weighs_less_and_one_that_adds_nothing_is_left_out():
    left = with_answers(kernel=range(2), svm=range(8, 12), network=range(12))
    weights = left.weighed(["kernel", "svm", "network"])
    assert list(weights) == ["kernel", "svm"] and weights["svm"] < 0.9 * weights["kernel"]
    assert weights == left.weighed(["kernel", "svm"])
    assert left.wrong(weights).mean() == pytest.approx(2 / 12)
    left.answered = np.isin(np.arange(len(LABELS)) % 12, range(2, 8))  # both are right
    alike = left.weighed(["kernel", "svm"])
    assert alike["svm"] == pytest.approx(alike["kernel"], rel=1e-3)


def test_a_member_of_little_weight_is_left_out_and_the_others_are_weighed_anew(
    monkeypatch,
):
    """Weights of four members, and of three once the fourth is gone."""
    weights = {4: [4.0, 0.41, 1.0, 0.39], 3: [3.0, 2.0, 1.0]}
    by_number = lambda each, _: np.array(weights[len(each)])  # noqa: E731
    monkeypatch.setattr("tactile_viewgcn.recognition.left_out.fit_weights", by_number)
    members = ["kernel", "pooled_kernel", "svm", "trees"]
    assert with_answers().weighed(members) == dict(zip(members, weights[3], strict=False))


class Network:
    """A network that answers rightly, and whose trainings read so many times what is allowed."""

    most_readings = 1.0
    read = 0.0

    def __init__(self, table, views, recordings, seed, compute):
        self.table, self.views, self.recordings = table, views, recordings

    def readings(self, folds):
        return self.read

    def left_out(self, folds):
        labels = np.array([self.table.label[index[0]] for index in self.recordings])
        shares = 0.99 * np.eye(len(self.table.classes), dtype=np.float32)[labels] + 0.001
        return shares * np.any(folds, axis=0)[:, None]

    def train(self):
        places, model = torch.from_numpy(self.views.viewpoints), recipe("model.system=vote").model
        return build_classifier(places, len(self.table.classes), model, (12, 12))


def fitted(frames, *changes, **options):
    params = recipe("model.system=sensors", *changes)
    return fit_classifier(frames, views_of(frames, params), {}, params, CPU, **options)


@pytest.mark.parametrize("read", [1.0, 1.1])
def test_a_network_joins_an_arrays_members_where_its_work_is_allowed(monkeypatch, read):
    monkeypatch.setattr("tactile_viewgcn.recognition.fitting.NetworkMember", Network)
    monkeypatch.setattr(Network, "read", read)
    frames = table("split.folds=6")
    dealt = np.where(
        frames.recording % 3 == 0, (frames.label + frames.recording // 6) % 4, frames.label
    )
    one = fitted(replace(frames, label=dealt.astype(frames.label.dtype)), "model.members=auto")
    joins = read == 1.0
    assert (NETWORK in one.model.members) == joins == bool(one.classifier.network)
    first, *_ = [note for note in one.notes if note.key == "model.members"]
    assert first.value == one.model.members == list(one.classifier.weights)
    assert ("left out" in one.notes[0].text) != joins
    heard = {
        note.value["member"]: note.value["error"] for note in one.notes if note.topic == "members"
    }
    assert set(heard) == {*ARRAY} - ({NETWORK} if not joins else set())
    assert heard.get(NETWORK, 0) == 0 < heard["kernel"] and one.temperature > 0
    weights = {
        note.value["member"]: note.value["weight"] for note in one.notes if note.topic == "members"
    }
    assert {name: weight for name, weight in weights.items() if weight} == one.classifier.weights


def test_no_network_is_trained_where_the_others_err_nowhere(monkeypatch):
    """Each object presses three rows of its own."""
    monkeypatch.setattr("tactile_viewgcn.recognition.fitting.NetworkMember", None)
    frames = table("split.folds=6")
    pressed = 200 * (np.arange(12)[:, None] // 3 == frames.label[:, None, None])
    easy = fitted(
        replace(frames, counts=(frames.counts + pressed).astype(np.int16)), "model.members=auto"
    )
    assert NETWORK not in easy.model.members and not easy.classifier.network


def test_a_recording_has_the_mean_probabilities_of_its_frames():
    """Every second frame is answered differently."""
    estimator = SimpleNamespace(classes=np.arange(3), fit=lambda *_: None)
    estimator.predict_proba = lambda frames: np.where(
        frames[:, None] % 2, [0.2, 0, 0.8], [0.8, 0.2, 0]
    )
    examples = SimpleNamespace(
        labels=np.repeat([0, 1, 2], 2), classes=3, representation=SimpleNamespace()
    )
    examples.of_recordings = lambda member: (np.arange(12), np.arange(12) // 2)
    examples.representation.estimator = lambda member, quick: estimator
    (shares,) = LeftOut(examples, np.arange(6), 0).answers(["kernel"])
    np.testing.assert_allclose(shares, np.tile([0.5, 0.1, 0.4], (6, 1)), rtol=1e-6)


def test_the_error_for_a_new_session_is_of_fits_that_know_other_sessions_alone():
    """An object presses rows that differ in every session: a new session's are unknown, other
    groups' are not.
    """
    frames = table("split.folds=6")
    session = frames.recording % 2
    rows = np.arange(12)[:, None] == (4 * session + frames.label)[:, None, None]
    counts = (frames.counts + 200 * rows).astype(np.int16)
    changed = replace(frames, session=session, sessions=["a", "b"], counts=counts)
    one = fitted(changed, "model.members=[svm]")
    (note,) = (note for note in one.notes if note.topic == "new session")
    assert note.value["mean"] > 0.3


def test_the_seed_is_that_of_the_trees_that_are_kept():
    frames = table("split.folds=6")
    grown = (
        fitted(frames, "model.members=[trees]", f"seed={seed}").classifier.whole["trees"]
        for seed in (0, 0, 1)
    )
    first, again, other = (trees.threshold.tolist() for trees in grown)
    assert first == again != other


def test_channels_and_arrays_are_weighed_and_the_test_side_changes_nothing():
    frames, few = table("split.folds=6"), table().live & (np.arange(12)[:, None] < 3)
    trained = frames.side != TEST
    changed = replace(
        frames, label=frames.label * trained, counts=frames.counts * trained[:, None, None]
    )
    one, other = (fitted(each, "model.members=auto") for each in (frames, changed))
    assert (
        one.classifier.weights == other.classifier.weights and one.temperature == other.temperature
    )
    assert set(one.model.members) <= {*ARRAY} and len(set(one.classifier.weights.values())) > 1
    channels = fitted(replace(frames, live=few), "model.members=auto")
    assert set(channels.model.members) <= {*CHANNELS} and channels.temperature > 0
    one_group = replace(frames, group=frames.label.astype(np.int64))
    alone = fitted(one_group, "model.members=auto")
    assert alone.model.members == UNWEIGHED and set(alone.classifier.weights.values()) == {1.0}
    assert alone.temperature is None and "without a comparison" in alone.notes[0].text
    asked = fitted(frames, "model.members=[svm, kernel]", ask_network=False)
    assert asked.classifier.weights == {"svm": 1.0, "kernel": 1.0}
