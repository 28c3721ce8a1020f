"""Weights and temperature follow from answers to held-out groups, and never from the test set."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.kernel import KernelMember
from tactile_viewgcn.members.network import NETWORK
from tactile_viewgcn.members.representation import Representation
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.member_fitting import ARRAY, CHANNELS, UNWEIGHED
from tactile_viewgcn.recognition.model_file import build_classifier
from tactile_viewgcn.recognition.out_of_fold import OutOfFold
from tactile_viewgcn.tables.frames import TEST
from tests.glove_data import CPU, recipe, table, views_of
from tests.recognition.answers import KnownAnswers, examples


def out_of_fold(labels, groups, *members):
    """Return the answers of members to recordings."""
    known = OutOfFold.of(np.asarray(labels), np.asarray(groups))
    for member in members:
        known = known.with_member(member, examples(labels), seed=0)
    return known


def wrong(known, *members):
    """Return the share of wrong answers in each group, by members of equal weights."""
    return known.group_errors(dict.fromkeys(members, 1.0)).tolist()


def temperature(known, *members):
    """Return the temperature for members of equal weights."""
    return known.temperature(dict.fromkeys(members, 1.0))


@pytest.mark.parametrize(
    "groups", [np.arange(24) // 2, np.arange(24) % 6], ids=["of a class", "of several"]
)
def test_each_group_is_answered_once_by_fits_without_any_of_it(groups):
    """The members know the groups that they were fitted to, and are wrong about all others."""
    labels = np.arange(24) // 8
    known = out_of_fold(labels, groups, KnownAnswers(groups, knows=True))
    assert np.sum(known.folds, axis=0).tolist() == [1] * 24
    assert known.held_out.all()
    assert wrong(known, "svm") == [1] * len(set(groups))
    others = [KnownAnswers(groups, knows=False, name=name) for name in ("trees", "svm")]
    assert not any(wrong(out_of_fold(labels, groups, *others), "trees", "svm"))


def test_the_member_itself_is_not_fitted_and_the_answers_before_stay():
    groups = np.arange(12)
    member = KnownAnswers(groups, knows=True)
    before = OutOfFold.of(groups // 4, groups)
    after = before.with_member(member, examples(groups // 4), seed=0)
    assert not hasattr(member, "used")
    assert before.answers == {}
    assert set(after.answers) == {"svm"}


def test_a_class_that_would_not_be_fitted_stays_and_groups_are_weighed_alike():
    """A class can have one group, or a group that spans classes.

    A group with one wrong answer of two counts as half a wrong group.
    """
    known = out_of_fold([0, 0, 0, 1, 1], [0, 1, 2, 3, 3])
    assert known.held_out.tolist() == [True] * 3 + [False] * 2
    spanning = out_of_fold([0, 1, 0, 1, 2], [0, 0, 1, 1, 1])
    assert spanning.held_out.tolist() == [True] * 4 + [False]
    assert not out_of_fold([0, 1], [0, 1]).held_out.any()
    known = out_of_fold([0, 0, 0, 1, 1, 1], [0, 0, 1, 2, 3, 3])
    known = replace(known, answers={"svm": np.eye(3)[[1, 0, 0, 0, 1, 1]]})
    assert wrong(known, "svm") == [0.5, 0, 1, 0]


def test_the_temperature_is_that_of_the_members_answers_with_their_weights():
    """All 12 answers are right, so 13 in 14 are right by Laplace's rule.

    The right class is then 2 * 13 times as probable as each of the two others.
    """
    groups = np.arange(12)
    members = [
        KnownAnswers(groups, knows=False, name="svm", share=0.8),
        KnownAnswers(groups, knows=False, name="trees", share=0.9),
    ]
    known = out_of_fold(groups // 4, groups, *members)

    def expected(*shares, floor=0.01):
        log_odds = [np.log((share + floor) / ((1 - share) / 2 + floor)) for share in shares]
        return sum(log_odds) / np.log(2 * 13)

    assert temperature(known, "trees", "svm") == pytest.approx(expected(0.8, 0.9), rel=1e-3)
    assert temperature(known, "svm") == pytest.approx(expected(0.8, floor=0), rel=1e-3)
    weights = known.member_weights(["trees", "svm"])
    assert known.temperature(weights) == pytest.approx(1, rel=1e-2)
    assert out_of_fold([0, 1], [0, 1]).temperature({"svm": 1.0}) is None


LABELS = np.repeat([0, 1, 2], 12)


def with_answers(**wrong):
    """Return the answers of members, all with equal confidence.

    Args:
        wrong: the recordings of each class, 0 to 11, that a member answers wrongly.
    """
    answers = {}
    for name, recordings in wrong.items():
        classes = (LABELS + np.isin(np.arange(len(LABELS)) % 12, recordings)) % 3
        answers[name] = 0.9 * np.eye(3, dtype=np.float32)[classes] + 0.1 / 3
    return replace(OutOfFold.of(LABELS, np.arange(len(LABELS)) // 2), answers=answers)


def test_a_member_that_errs_more_weighs_less_and_one_that_adds_nothing_is_taken_out():
    known = with_answers(kernel=range(2), svm=range(8, 12), network=range(12))
    weights = known.member_weights(["kernel", "svm", "network"])
    assert list(weights) == ["kernel", "svm"]
    assert weights["svm"] < 0.9 * weights["kernel"]
    assert weights == known.member_weights(["kernel", "svm"])
    assert known.group_errors(weights).mean() == pytest.approx(2 / 12)
    both_right = np.isin(np.arange(len(LABELS)) % 12, range(2, 8))
    alike = replace(known, folds=[both_right]).member_weights(["kernel", "svm"])
    assert alike["svm"] == pytest.approx(alike["kernel"], rel=1e-3)


def test_a_member_of_less_than_a_tenth_of_the_largest_weight_is_out_and_others_weighed_anew(
    monkeypatch,
):
    """The weight of the fourth member is 0.39, and the largest weight is 4."""
    weights = {4: [4.0, 0.41, 1.0, 0.39], 3: [3.0, 2.0, 1.0]}

    def known_weights(answers, _):
        return np.array(weights[len(answers)])

    monkeypatch.setattr("tactile_viewgcn.recognition.out_of_fold.fit_weights", known_weights)
    members = ["kernel", "pooled_kernel", "svm", "trees"]
    known = with_answers(**dict.fromkeys(members, range(1)))
    assert known.member_weights(members) == dict(zip(members, weights[3], strict=False))


class Training:
    """The training of a network that answers rightly.

    Attributes:
        most_readings: the work that is allowed.
        read: the work of the training, in the same unit.
    """

    most_readings = 1.0
    read = 0.0

    def __init__(self, table, views, recordings, *, seed, compute):
        self.table = table
        self.views = views
        self.recordings = recordings

    def readings(self, folds):
        return self.read

    def answers(self, network, recordings):
        labels = self.table.label[[index[0] for index in self.recordings]][recordings]
        return 0.99 * np.eye(len(self.table.classes), dtype=np.float32)[labels] + 0.001

    def train(self, recordings):
        places = torch.from_numpy(self.views.viewpoints)
        model = recipe("model.system=vote").model
        return build_classifier(places, len(self.table.classes), model, (12, 12))


def fitted(frames, *changes, **options):
    """Return the classifier on the sensors, with its weights, temperature and notes."""
    params = recipe("model.system=sensors", *changes)
    return fit_classifier(frames, views_of(frames, params), {}, params, CPU, **options)


def names(classifier):
    return [member.name for member in classifier.members]


@pytest.mark.parametrize("read", [1.0, 1.1])
def test_a_network_joins_an_arrays_members_where_its_work_is_allowed(monkeypatch, read):
    monkeypatch.setattr("tactile_viewgcn.recognition.member_fitting.PresetTraining", Training)
    monkeypatch.setattr(Training, "read", read)
    frames = table("split.folds=6")
    another_label = (frames.label + frames.recording // 6) % 4
    label = np.where(frames.recording % 3 == 0, another_label, frames.label)
    fit = fitted(frames.with_columns(label=label.astype(frames.label.dtype)), "model.members=auto")
    joins = read == 1.0
    assert (NETWORK in fit.model.members) == joins
    first, *_ = [note for note in fit.notes if note.key == "model.members"]
    assert first.value == fit.model.members
    assert list(fit.classifier.weights) == fit.model.members
    assert names(fit.classifier) == fit.model.members
    assert ("skipped" in fit.notes[0].text) != joins
    compared = [note.value for note in fit.notes if note.topic == "members"]
    errors = {value["member"]: value["error"] for value in compared}
    expected = set(ARRAY)
    if not joins:
        expected.remove(NETWORK)
    assert set(errors) == expected
    assert errors.get(NETWORK, 0) == 0
    assert errors["kernel"] > 0
    assert fit.temperature > 0
    weights = {value["member"]: value["weight"] for value in compared if value["weight"]}
    assert weights == fit.classifier.weights


def test_no_network_is_trained_where_the_others_err_nowhere(monkeypatch):
    """Each object presses three rows of its own."""
    monkeypatch.setattr("tactile_viewgcn.recognition.member_fitting.PresetTraining", None)
    frames = table("split.folds=6")
    pressed = 200 * (np.arange(12)[:, None] // 3 == frames.label[:, None, None])
    easy = replace(frames, counts=(frames.counts + pressed).astype(np.int16))
    fit = fitted(easy, "model.members=auto")
    assert NETWORK not in fit.model.members
    assert NETWORK not in names(fit.classifier)


def test_a_recording_has_the_mean_probabilities_of_its_frames():
    """The member `kernel` answers sets of two frames; the second set gets another answer."""
    recordings = [np.array([[0.0], [1.0]])] * 6
    scale = Representation(np.ones((1, 1), bool), np.zeros(1), np.ones(1))
    labels = np.repeat([0, 1, 2], 2)
    two_frames = Examples(recordings.__getitem__, labels, scale, sizes=(1,), classes=3, seed=0)
    kernel = KernelMember(scale, 3)
    kernel.of_frames = SimpleNamespace(classes=np.arange(3))
    of_first = [0.8, 0.2, 0]
    of_second = [0.2, 0, 0.8]
    kernel.of_frames.predict_proba = lambda frames: np.where(frames > 0, of_second, of_first)
    answers = kernel.answer_examples(two_frames, np.arange(6) < 4)
    np.testing.assert_allclose(answers, np.tile([0.5, 0.1, 0.4], (4, 1)), rtol=1e-6)


def test_the_error_for_a_new_session_is_of_fits_that_know_other_sessions_alone():
    """An object presses different rows in every session, so the members know no new session."""
    frames = table("split.folds=6")
    session = frames.recording % 2
    rows = np.arange(12)[:, None] == (4 * session + frames.label)[:, None, None]
    counts = (frames.counts + 200 * rows).astype(np.int16)
    changed = replace(frames.with_columns(session=session), sessions=["a", "b"], counts=counts)
    fit = fitted(changed, "model.members=[svm]")
    (note,) = (note for note in fit.notes if note.topic == "new session")
    assert note.value["mean"] > 0.3


def test_the_seed_is_that_of_the_trees_that_are_kept():
    frames = table("split.folds=6")
    thresholds = []
    for seed in (0, 0, 1):
        (trees,) = fitted(frames, "model.members=[trees]", f"seed={seed}").classifier.members
        thresholds.append(trees.whole.threshold.tolist())
    first, again, other = thresholds
    assert first == again
    assert first != other


def test_channels_and_arrays_are_weighed_and_the_test_side_changes_nothing():
    frames = table("split.folds=6")
    three_rows = table().live & (np.arange(12)[:, None] < 3)
    trained = frames.side != TEST
    changed = replace(
        frames.with_columns(label=frames.label * trained),
        counts=frames.counts * trained[:, None, None],
    )
    fit = fitted(frames, "model.members=auto")
    without_test_set = fitted(changed, "model.members=auto")
    assert fit.classifier.weights == without_test_set.classifier.weights
    assert fit.temperature == without_test_set.temperature
    assert set(fit.model.members) <= {*ARRAY}
    assert len(set(fit.classifier.weights.values())) > 1
    few_sensors = replace(frames, plan=replace(frames.plan, live=three_rows))
    channels = fitted(few_sensors, "model.members=auto")
    assert set(channels.model.members) <= {*CHANNELS}
    assert channels.temperature > 0
    one_group = frames.with_columns(group=frames.label.astype(np.int64))
    unweighed = fitted(one_group, "model.members=auto")
    assert unweighed.model.members == UNWEIGHED
    assert set(unweighed.classifier.weights.values()) == {1.0}
    assert unweighed.temperature is None
    assert "not compared" in unweighed.notes[0].text
    chosen = fitted(frames, "model.members=[svm, kernel]", ask_network=False)
    assert chosen.classifier.weights == {"svm": 1.0, "kernel": 1.0}
