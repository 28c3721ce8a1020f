"""Systems on the sensors' maximum, and the ensemble: worked by hand on small data."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.distance import cdist
from scipy.special import softmax
from sklearn.linear_model import LogisticRegression
from tactile_viewgcn.sensors.kernel import KernelClassifier, block_weights, ridge_regression
from tactile_viewgcn.sensors.sensor_system import MOST_SETS, SensorData, contact_unit

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.recognition.model_file import load_classifier, save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.systems import max_network
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.systems.ensemble import FLOOR, Ensemble
from tactile_viewgcn.systems.max_kernel import MaxKernel
from tactile_viewgcn.systems.max_logistic import MaxLogistic
from tactile_viewgcn.systems.max_network import MaxNetwork
from tactile_viewgcn.systems.trees import Trees
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.sensor_fitting import powers_of_two
from tests.small_tables import CPU, recipe, table, views_of

MAXIMUM = ("max_logistic", "max_kernel", "max_network", "ensemble")


@pytest.fixture(autouse=True)
def _few_steps(monkeypatch):
    monkeypatch.setattr(max_network, "STEPS", 60)


def data(pools: int = 6, frames: int = 12, sizes: tuple[int, ...] = (4,)) -> SensorData:
    """Three objects on a 4 x 4 glove: each presses a row of its own, one sensor of it a frame."""
    rng = np.random.default_rng(0)
    pool = np.repeat(np.arange(pools), frames)
    label = pool % 3
    sensors = rng.normal(size=(len(label), 4, 4))
    sensors[np.arange(len(label)), label, rng.integers(4, size=len(label))] += 20
    live = np.ones((4, 4), dtype=bool)
    return SensorData(sensors.reshape(-1, 16).astype(np.float32), label, pool, sizes, live, seed=0)


def test_one_reading_in_ten_is_above_four_units():
    readings = np.arange(1000, dtype=np.float32).reshape(10, 100) / 7
    unit = contact_unit(readings)
    assert np.mean(readings > 4 * unit) == pytest.approx(0.1, abs=2e-3)
    assert contact_unit(readings / 1000) == pytest.approx(unit / 1000)


def test_the_noise_limits_the_unit_where_more_than_one_sensor_in_ten_is_pressed():
    readings = np.random.default_rng(0).normal(0, 2, (50, 100)).astype(np.float32)
    readings[:, :40] += 200
    assert contact_unit(readings) == pytest.approx(50, rel=0.05)
    assert contact_unit(readings, noise=5.0) == 7.5 and contact_unit(readings, noise=100.0) == contact_unit(readings)
    assert contact_unit(readings, noise=0.0) == pytest.approx(contact_unit(readings) / 10)


def test_a_glove_that_is_hardly_touched_has_a_unit_too():
    readings = np.zeros((10, 100), dtype=np.float32)
    readings[0, :4] = 8
    assert contact_unit(readings) == 2.0
    assert contact_unit(np.zeros((2, 3), dtype=np.float32)) == 1.0


def test_view_sets_stay_in_a_pool_and_have_its_label():
    given = data(sizes=(1, 4))
    sets, labels = given.view_sets(5)
    assert [of_size.shape for of_size in sets] == [(30, 1), (30, 4)]
    for members, label in zip([*sets[0], *sets[1]], [*labels, *labels], strict=True):
        assert len(set(given.pools[members])) == 1
        assert set(given.labels[members]) == {label}
        assert len(set(members)) == len(members)  # there are enough frames
    assert all((first == second).all() for first, second in zip(sets, given.view_sets(5)[0], strict=True))


def test_frames_repeat_where_a_pool_has_fewer_and_large_pools_give_more_sets():
    assert data(frames=2).view_sets(5)[0][0].shape == (30, 4)
    assert data(frames=400).view_sets(5)[0][0].shape == (600, 4)  # a hundred of each pool
    assert len(data(pools=60, frames=400).view_sets(5)[0][0]) == 60 * (MOST_SETS // 60)


def test_view_sets_mix_neither_objects_nor_split_groups_nor_recordings(monkeypatch):
    """A recording of several grasps is a pool a grasp, where these are the split groups."""
    given = []
    monkeypatch.setattr(MaxKernel, "fit", lambda self, data: given.append(data))
    frames, params = table(), recipe("model.system=max_kernel")
    grasp = np.arange(len(frames)) % 3
    split = replace(frames, group=frames.group * 3 + grasp)
    finetune_classifier(split, views_of(frames, params), {}, params, CPU)
    index = np.flatnonzero(split.anchor & (split.side == 0))
    whole = np.stack([split.label, split.recording, split.group])[:, index]
    assert len(np.unique(given[0].pools)) == len(np.unique(whole, axis=1).T)
    for pool in np.unique(given[0].pools):
        assert len(np.unique(whole[:, given[0].pools == pool], axis=1).T) == 1


def test_sizes_are_powers_of_two_and_all_views():
    assert powers_of_two(8) == (1, 2, 4, 8)
    assert powers_of_two(12) == (1, 2, 4, 8, 12)
    assert powers_of_two(1) == (1,)


def test_the_maximum_is_taken_before_the_estimator():
    given, system = data(), MaxLogistic(classes=3)
    system.fit(given)
    sets, labels = given.view_sets(10)
    bits = np.concatenate([given.frames > threshold for threshold in (4, 8, 16)], axis=1).astype(np.float32)
    plain = LogisticRegression(C=0.1, max_iter=500).fit(bits[sets[0]].max(axis=1), labels)
    probabilities = plain.predict_proba(bits[sets[0][:7]].max(axis=1))
    values = system.of_frames(given.frames)[sets[0][:7]]
    np.testing.assert_allclose(np.exp(system.logits(values)), probabilities, rtol=1e-5)
    assert (system.logits(values[:, ::-1]) == system.logits(values)).all()


def test_each_size_has_an_estimator_and_sizes_in_between_take_the_smaller():
    given = data(sizes=(2, 4))
    mixed = MaxLogistic(classes=3)
    mixed.fit(given)
    sets = given.view_sets(10)[0]
    assert sorted(mixed.fitted) == [2, 4]
    bits = mixed.of_frames(given.frames)
    for size, of_size in zip((2, 4), sets, strict=True):
        plain = LogisticRegression(C=0.1, max_iter=500).fit(bits[of_size].max(axis=1), given.view_sets(10)[1])
        np.testing.assert_allclose(mixed.fitted[size].coef_, plain.coef_, rtol=1e-6)
    three = bits[sets[1][:5, :3]]
    expected = mixed.fitted[2].predict_proba(three.max(axis=1))
    np.testing.assert_allclose(np.exp(mixed.logits(three)), expected, rtol=1e-5)
    assert mixed.logits(three[:, :1]).shape == (5, 3)  # one frame goes to the smallest


def test_blocks_are_means_over_live_cells_and_half_empty_ones_are_left_out():
    live = np.ones((4, 4), dtype=bool)
    live[:2, :2] = [[True, False], [False, False]]  # a quarter of the first block
    weights = block_weights(live)
    readings = np.arange(16.0).reshape(4, 4)[live]
    expected = [(2 + 3 + 6 + 7) / 4, (8 + 9 + 12 + 13) / 4, (10 + 11 + 14 + 15) / 4, readings.mean()]
    np.testing.assert_allclose(readings @ weights, expected, rtol=1e-6)


def test_kernel_ridge_regression_by_hand():
    rng = np.random.default_rng(1)
    points, labels, asked = rng.normal(size=(20, 5)), np.repeat([0, 2], 10), rng.normal(size=(4, 5))
    between = cdist(points, points, "sqeuclidean")
    kernel, to_asked = (np.exp(-2 * d / between.mean()) for d in (between, cdist(asked, points, "sqeuclidean")))
    weights = np.linalg.solve(kernel + 0.3 * np.eye(20), labels[:, None] == [0, 2])
    classifier = KernelClassifier().fit(points, labels)
    np.testing.assert_allclose(classifier.predict_proba(asked), softmax(8 * to_asked @ weights, axis=1), rtol=1e-6)
    assert list(classifier.classes_) == [0, 2]


def test_points_that_are_all_equal_are_answered_by_their_share():
    classifier = KernelClassifier().fit(np.ones((4, 3)), np.array([0, 1, 1, 1]))
    (probabilities,) = classifier.predict_proba(np.ones((1, 3)))
    assert np.isfinite(probabilities).all() and probabilities[1] > probabilities[0]


def test_many_points_are_answered_from_landmarks_nearly_alike():
    rng = np.random.default_rng(2)
    points, indicators = rng.normal(size=(4100, 2)), rng.integers(2, size=(4100, 2)).astype(float)
    exact, landmarks = ridge_regression(4000, 0.1), ridge_regression(4100, 0.1)
    asked = rng.normal(size=(50, 2))
    first, second = (each.fit(points, indicators).predict(asked) for each in (exact, landmarks))
    np.testing.assert_allclose(first, second, atol=0.01)


def test_the_network_learns_view_sets_of_every_size_and_sees_their_maximum_alone(monkeypatch):
    monkeypatch.setattr(max_network, "SHIFT", 0)  # the objects here are a row apart
    given, system, before = data(sizes=(1, 2, 4)), MaxNetwork(classes=3), torch.get_rng_state()
    system.fit(given)
    assert (torch.get_rng_state() == before).all()
    values, (of_one, _, of_four) = system.of_frames(given.frames), given.view_sets(10)[0]
    for sets in (of_one, of_four):
        assert np.mean(system.logits(values[sets]).argmax(axis=1) == given.labels[sets[:, 0]]) > 0.9
    maximum = values[of_four].max(axis=1, keepdims=True)
    np.testing.assert_allclose(system.logits(maximum), system.logits(values[of_four]), rtol=1e-6)


def test_maps_are_shifted_by_a_row_or_a_column_at_most():
    maps = torch.arange(1.0, 10).view(1, 1, 3, 3)
    assert (max_network.shifted(maps, 1, 1) == maps).all()
    moved = max_network.shifted(maps, 2, 0)[0, 0]  # up and to the right
    assert moved.tolist() == [[0, 4, 5], [0, 7, 8], [0, 0, 0]]


def test_the_ensemble_adds_its_members_logarithms():
    given, members = data(), {"trees": Trees, "max_kernel": MaxKernel}
    system = Ensemble(classes=3, members=list(members))
    system.fit(given)
    sets = given.view_sets(1)[0][0]
    expected = 0
    for member in members.values():
        alone = member(classes=3)
        alone.fit(given)
        expected += np.log(np.exp(alone.logits(alone.of_frames(given.frames)[sets])) + FLOOR)
    np.testing.assert_allclose(system.logits(system.of_frames(given.frames)[sets]), expected, rtol=1e-5, atol=1e-5)


def trained(name: str, *changes: str) -> Classifier:
    params = recipe(f"model.system={name}", *changes)
    return finetune_classifier(table(), views_of(table(), params), {}, params, CPU)[0].eval()


@pytest.mark.parametrize("name", MAXIMUM)
def test_the_pipeline_gives_the_same_answers_twice_and_better_than_chance(name):
    params = recipe(f"model.system={name}")
    first, second = (
        evaluate_table(trained(name), table(), params.cluster, params.evaluate, CPU, params.seed, timed=False)
        for _ in range(2)
    )
    for protocol, trials in first.protocols.items():
        assert (trials.predicted == second.protocols[protocol].predicted).all()
        assert trials.correct.mean() > 0.5  # of four classes


@pytest.mark.parametrize("name", MAXIMUM)
def test_the_file_keeps_the_system_its_unit_and_its_sensors(tmp_path, name):
    frames, classifier = table(), trained(name)
    save_classifier(tmp_path / "classifier.pt", classifier, recipe(f"model.system={name}").model, frames)
    loaded, content = load_classifier(tmp_path / "classifier.pt")
    assert content["transform"] == "counts"
    test = CPU.frames(torch.from_numpy(frames.inputs(np.flatnonzero(frames.side == TEST)[:8], "counts")))
    values = classifier.backbone(test)
    assert (loaded.backbone(test) == values).all() and values.shape == (8, classifier.backbone.features)
    assert (loaded.head(values.view(2, 4, -1))[0] == classifier.head(values.view(2, 4, -1))[0]).all()


def test_a_glove_of_another_scale_gets_the_same_answers(tmp_path):
    """Counts and baselines a thousand times as large: the unit takes care of it."""
    frames, params = table(), recipe("model.system=max_kernel")
    larger = replace(frames, counts=frames.counts * 1000.0, baseline_mean=frames.baseline_mean * 1000.0)
    answers = []
    for given in (frames, larger):
        classifier, _ = finetune_classifier(given, views_of(frames, params), {}, params, CPU)
        save_classifier(tmp_path / "classifier.pt", classifier, params.model, given)
        counts = given.counts[given.side == TEST][:8].reshape(2, 4, *given.live.shape)
        answers.append(Recogniser(tmp_path / "classifier.pt").probabilities(counts))
    np.testing.assert_allclose(*answers, rtol=1e-3)


def test_members_are_those_that_params_allows():
    assert recipe("model.members=[knn,max_kernel]").model.members == ["knn", "max_kernel"]
    assert [type(member).__name__ for member in trained("ensemble", "model.members=[knn,max_kernel]").head.members] == [
        "NearestNeighbours",
        "MaxKernel",
    ]
