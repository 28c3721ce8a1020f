"""Systems on the sensors answer as scikit-learn's estimators on the same values, joined by hand."""

from dataclasses import replace
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
import torch
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.svm import SVC

from tactile_viewgcn.params import Member, Params
from tactile_viewgcn.recognition.model_file import load_classifier, save_classifier
from tactile_viewgcn.sensors import estimators, forest, max_network, pipelines
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.estimators import MOST_SETS, Logistic, TrainingFrames
from tactile_viewgcn.sensors.kernels import SupportVectors
from tactile_viewgcn.sensors.pipelines import MEMBERS
from tactile_viewgcn.sensors.systems import FLOOR
from tactile_viewgcn.sensors.unit import contact_unit
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.training.sensor_fitting import fit_sensors
from tactile_viewgcn.views.sampling import powers_of_two
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import CPU, recipe, table

PLAIN = {
    "trees": lambda: ExtraTreesClassifier(500, random_state=0),
    "logistic": lambda: LogisticRegression(max_iter=500),
}
SEED = SimpleNamespace(seed=0)


@pytest.fixture(autouse=True)
def _few_steps(monkeypatch):
    monkeypatch.setattr(max_network, "STEPS", 60)


def data(pools: int = 6, frames: int = 12, sizes: tuple[int, ...] = (4,)) -> TrainingFrames:
    """Three objects on a 4 x 4 glove: each presses a row of its own, one sensor of it a frame."""
    rng = np.random.default_rng(0)
    pool = np.repeat(np.arange(pools), frames)
    label = pool % 3
    sensors = rng.normal(size=(len(label), 4, 4))
    sensors[np.arange(len(label)), label, rng.integers(4, size=len(label))] += 20
    live = np.ones((4, 4), dtype=bool)
    return TrainingFrames(sensors.reshape(-1, 16).astype(np.float32), label, 3, pool, 4, sizes, live, seed=0)


def alone(name: str) -> Params:
    return recipe("model.system=sensors", f"model.members=[{name}]")


def classifier_of(names, frames: TrainingFrames) -> SensorClassifier:
    """The members, fitted to frames in a unit of one count."""
    classifier = SensorClassifier([MEMBERS[name]() for name in names], torch.from_numpy(viewpoints(4)), frames.classes)
    classifier.fit(frames, 1.0)
    return classifier


def fitted(name: str, frames=None) -> SensorClassifier:
    params, frames = alone(name), table() if frames is None else frames
    return fit_sensors(frames, viewpoints(4), params.model, params.finetune.num_views, params.seed)[0]


def inputs(index: np.ndarray) -> torch.Tensor:
    return CPU.frames(torch.from_numpy(table().inputs(index, "counts")))


def counts_above(index: np.ndarray) -> np.ndarray:
    """Counts above the baseline of the live sensors, written out."""
    frames = table()
    above = frames.counts[index].astype(np.float32) - frames.baseline_mean[frames.baseline[index]]
    return above[:, frames.live]


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize(("name", "paths"), [("logistic", 0), ("trees", forest.MOST_PATHS), ("trees", 300)])
def test_answers_are_the_plain_estimators_averaged_by_hand(monkeypatch, name, paths):
    monkeypatch.setattr(forest, "MOST_PATHS", paths)  # all trees at once, or a few at a time
    frames = table()
    assert frames.transform == "clip"  # and yet the system reads counts
    train, test = np.flatnonzero(frames.anchor & (frames.side == TRAIN)), np.flatnonzero(frames.side == TEST)
    unit = np.float32(contact_unit(counts_above(train)))
    points = [np.log1p(np.maximum(counts_above(index) / unit, 0)) for index in (train, test)]
    expected = PLAIN[name]().fit(points[0], frames.label[train]).predict_proba(points[1]).astype(np.float32)
    classifier = fitted(name)
    values = classifier.frame_values(inputs(test))
    torch.testing.assert_close(values, torch.from_numpy(expected), rtol=1e-4, atol=5e-6)
    sets = torch.from_numpy(np.random.default_rng(0).integers(len(test), size=(50, 4)))
    mean = torch.from_numpy(expected[sets.numpy()].mean(axis=1))
    torch.testing.assert_close(classifier.logits(values, sets).softmax(dim=-1), mean, rtol=1e-4, atol=5e-6)


@pytest.mark.parametrize("name", [*PLAIN, "kernel", "svm", "max_logistic", "max_kernel", "max_network"])
def test_equal_trainings_give_equal_files_and_answers_better_than_chance(tmp_path, name):
    params, frames, classifier = alone(name), table(), fitted(name)
    for folder, one in (("first", classifier), ("again", fitted(name))):
        save_classifier(tmp_path / folder / "classifier.pt", one, params.model, frames)
    assert (tmp_path / "first/classifier.pt").read_bytes() == (tmp_path / "again/classifier.pt").read_bytes()
    loaded, _ = load_classifier(tmp_path / "first/classifier.pt")
    test = frames.on(TEST)
    sets = torch.arange(len(test)).view(-1, 4)  # of one recording each
    first, second = (one.logits(one.frame_values(inputs(test)), sets) for one in (classifier, loaded))
    assert (first == second).all()
    assert (first.argmax(dim=1).numpy() == frames.label[test[sets[:, 0]]]).mean() > 0.5  # of four classes


def test_a_class_without_training_frames_is_never_answered():
    frames = table()
    merged = replace(frames, label=np.where(frames.label == 2, 1, frames.label).astype(frames.label.dtype))
    probabilities = fitted("logistic", merged).frame_values(inputs(np.flatnonzero(frames.side == TEST)))
    assert probabilities.shape[1] == 4 and (probabilities[:, 2] == 0).all()


@pytest.mark.parametrize(
    ("most", "quick", "trees", "sets"),
    [(150 * 72 * 3, False, 150, 10), (50 * 72 * 3, False, 100, 10), (10**9, False, 500, 10), (10**9, True, 100, 4)],
)
def test_fewer_trees_where_their_leaves_would_hold_too_much_and_in_a_comparison_fewer_sets(
    monkeypatch, most, quick, trees, sets
):
    frames = replace(data(), quick=quick)  # 72 of 3 classes, in 6 pools
    monkeypatch.setattr(forest, "MOST_LEAF_VALUES", most)
    assert len(MEMBERS["trees"]().fit(frames).fitted[1].roots) == trees
    assert len(MEMBERS["max_kernel"]().fit(frames).fitted[4].points) == 6 * sets


def test_a_comparison_alone_stops_the_logistic_regression_early(monkeypatch):
    monkeypatch.setattr(estimators, "QUICK_ITERATIONS", 1)
    whole, quick = (Logistic().fit(data().frames, data().labels, replace(data(), quick=each)) for each in (False, True))
    plain = LogisticRegression(max_iter=500).fit(data().frames, data().labels)
    np.testing.assert_allclose(whole.weights, plain.coef_.T, rtol=1e-3, atol=1e-6)
    assert np.abs(quick.weights - whole.weights).max() > 0.01


def test_view_sets_stay_in_a_pool_and_have_its_label():
    frames = data(sizes=(1, 4))
    sets, labels = frames.view_sets(5)
    assert [of_size.shape for of_size in sets] == [(30, 1), (30, 4)]
    for members, label in zip([*sets[0], *sets[1]], [*labels, *labels], strict=True):
        assert len(set(frames.pools[members])) == 1 and set(frames.labels[members]) == {label}
        assert len(set(members)) == len(members)  # there are enough frames
    assert all((first == second).all() for first, second in zip(sets, frames.view_sets(5)[0], strict=True))
    # frames repeat where a pool has fewer, and large pools give more sets
    for pools, size, count in ((6, 2, 30), (6, 400, 600), (60, 400, 60 * (MOST_SETS // 60))):
        assert data(pools, size).view_sets(5)[0][0].shape == (count, 4)


def test_view_sets_mix_neither_objects_nor_split_groups_nor_recordings(monkeypatch):
    """A recording of several grasps is a pool a grasp, where these are the split groups."""
    frames, grasp, fits = table(), np.arange(len(table())) % 3, []
    split = replace(frames, group=frames.group * 3 + grasp)
    monkeypatch.setattr(SensorClassifier, "fit", lambda self, *arguments, **_: fits.append(arguments))
    fitted("max_kernel", split)
    index = np.flatnonzero(split.anchor & (split.side == TRAIN))
    whole, pools = np.stack([split.label, split.recording, split.group])[:, index], fits[0][0].pools
    assert len(np.unique(pools)) == len(np.unique(whole, axis=1).T)
    assert all(len(np.unique(whole[:, pools == pool], axis=1).T) == 1 for pool in np.unique(pools))


@pytest.mark.parametrize(
    ("names", "sizes", "takes_fewer"),
    [
        (["kernel", "max_kernel"], (1, 2, 4), True),
        (["kernel"], (4,), True),
        (["kernel", "max_kernel"], (4,), False),
        (["kernel", "max_network"], (1, 2, 4), False),
    ],
)
def test_fewer_views_are_asked_of_systems_that_were_fitted_to_them(names, sizes, takes_fewer):
    assert classifier_of(names, data(sizes=sizes)).takes_fewer == takes_fewer


def test_each_size_has_an_estimator_of_the_maximum_and_sizes_in_between_take_the_smaller():
    assert [powers_of_two(views) for views in (8, 12, 1)] == [(1, 2, 4, 8), (1, 2, 4, 8, 12), (1,)]
    frames = data(sizes=(2, 4))
    system = MEMBERS["max_logistic"]().fit(frames)
    sets, labels = frames.view_sets(10)
    bits = np.concatenate([frames.frames > threshold for threshold in (4, 8, 16)], axis=1).astype(np.float32)
    plain = {
        size: LogisticRegression(C=0.1, max_iter=500).fit(bits[of_size].max(axis=1), labels)
        for size, of_size in zip((2, 4), sets, strict=True)
    }
    values = system.frame_values(frames.frames)[sets[1][:5]]
    for views, size in ((1, 2), (2, 2), (3, 2), (4, 4)):
        expected = plain[size].predict_proba(values[:, :views].max(axis=1))
        np.testing.assert_allclose(np.exp(system.logits(values[:, :views])), expected, rtol=1e-5)
    assert (system.logits(values[:, ::-1]) == system.logits(values)).all()


def test_the_network_learns_view_sets_of_every_size_and_reads_their_maximum_alone(monkeypatch):
    monkeypatch.setattr(max_network, "SHIFT", 0)  # the objects here are a row apart
    frames, before = data(sizes=(1, 2, 4)), torch.get_rng_state()
    system = MEMBERS["max_network"]().fit(frames)
    above = np.log1p(np.maximum(frames.frames - 2, 0))
    assert system.state_dict()["scale"] == pytest.approx(np.sqrt(np.mean(above**2)), rel=1e-5)
    assert (torch.get_rng_state() == before).all()
    values, (of_one, _, of_four) = system.frame_values(frames.frames), frames.view_sets(10)[0]
    for sets in (of_one, of_four):
        assert np.mean(system.logits(values[sets]).argmax(axis=1) == frames.labels[sets[:, 0]]) > 0.9
    maximum = values[of_four].max(axis=1, keepdims=True)
    np.testing.assert_allclose(system.logits(maximum), system.logits(values[of_four]), rtol=1e-6)


def test_maps_are_shifted_by_a_row_or_a_column_at_most():
    maps = torch.arange(1.0, 10).view(1, 1, 3, 3)
    assert (max_network.shifted(maps, 1, 1) == maps).all()
    moved = max_network.shifted(maps, 2, 0)[0, 0]  # up and to the right
    assert moved.tolist() == [[0, 4, 5], [0, 7, 8], [0, 0, 0]]


@pytest.mark.parametrize("names", [["trees", "max_kernel"], ["logistic", "max_kernel", "trees", "max_logistic"]])
def test_an_ensemble_adds_its_members_logarithms(names):
    frames = data()
    classifier = classifier_of(names, frames)
    sets, expected = frames.view_sets(1)[0][0], 0
    for name in names:
        alone = MEMBERS[name]().fit(frames)
        expected += np.log(np.exp(alone.logits(alone.frame_values(frames.frames)[sets])) + FLOOR)
    values = classifier.frame_values(torch.from_numpy(frames.frames).view(-1, 1, 4, 4))
    np.testing.assert_allclose(classifier.logits(values, torch.from_numpy(sets)), expected, rtol=1e-5, atol=1e-5)


def test_members_are_those_that_params_allows():
    assert MEMBERS.keys() == set(get_args(Member))


def test_statistics_and_directions_by_hand():
    values = np.array([[[1.0, 0.0], [3.0, 0.0], [2.0, 4.0]]], dtype=np.float32)
    expected = [2, 4 / 3, (2 / 3) ** 0.5, (32 / 9) ** 0.5, 3, 4, 1, 0, 2, 0]  # mean, std, maximum, minimum, median
    np.testing.assert_allclose(pipelines.statistics(values), [expected], rtol=1e-6)
    np.testing.assert_allclose(pipelines.direction(values), [[0.6, 0.8]], rtol=1e-6)
    assert (pipelines.direction(0 * values) == 0).all()


@pytest.mark.parametrize("classes", [2, 3, 7])
def test_support_vectors_vote_as_scikit_learn_s(classes):
    rng = np.random.default_rng(0)
    labels = rng.integers(classes, size=200) * 2  # numbers between are no classes
    points = (rng.normal(size=(200, 5)) + labels[:, None] * rng.normal(size=5)).astype(np.float32)
    plain, machines = SVC(C=10).fit(points, labels), SupportVectors().fit(points, labels, SEED)
    new = rng.normal(size=(50, 5)).astype(np.float32) * 3
    logarithms = np.log(machines.predict_proba(new))
    if classes == 2:
        assert (machines.classes[logarithms.argmax(axis=1)] == plain.predict(new)).all()
    else:
        votes = plain.decision_function(new)
        np.testing.assert_allclose(logarithms - logarithms[:, :1], votes - votes[:, :1], atol=1e-3)


@pytest.mark.stability("support vectors")
def test_support_vectors_of_equal_points_and_of_a_constant_sensor_are_finite(row):
    labels = np.arange(20) % 2
    constant = np.stack([labels, 0 * labels + 1e15, 0 * labels + 5], axis=1)
    for name, points in (("equal", np.ones((20, 3))), ("constant", constant)):
        answer = SupportVectors().fit(points.astype(np.float32), labels, SEED).predict_proba(points.astype(np.float32))
        row(f"probabilities that are not finite, {name} sensors", int((~np.isfinite(answer)).sum()), 0)
