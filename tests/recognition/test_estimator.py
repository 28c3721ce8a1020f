"""scikit-learn's interface: the pipeline's own training, answers of the right form, and files that others read."""

import pickle
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
import torch
from sklearn.exceptions import DataConversionWarning
from sklearn.utils.estimator_checks import parametrize_with_checks

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.answer import answer_recording, answer_together
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.schema import parse
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import CPU, OBJECTS, ROOT, SMALL, recipe, recording, table

ROUNDED = "in single precision the last digit may depend on a row's place in a product of matrices"
RAW = {
    "preprocess.baseline": "grasp",
    "preprocess.filter": "contact",
    "preprocess.contact_sensors": 6,
    "cluster.restarts": 1,
}
NETWORK = {
    "preprocess.scale": 60,
    "model.backbone.width": 8,
    "model.backbone.readout": "grid",
    "pretrain.epochs": 30,
    "pretrain.batch": 8,
    "finetune.epochs": 10,
    "finetune.lr": 0.005,
}
OPEN = 8  # frames of the open hand at the beginning of a recording


@pytest.mark.filterwarnings("ignore:answers to recordings")  # some checks have labels at random
@parametrize_with_checks(
    [TactileClassifier("kernels"), TactileClassifier(system="svm")],
    expected_failed_checks=lambda _: {"check_methods_sample_order_invariance": ROUNDED},
)
def test_scikit_learn_s_own_checks(estimator, check):
    check(estimator)


def test_channels_are_taken_with_their_frames_first_or_last():
    """As aeon and sktime give them, an array (n, C, T); as a list of (T, C) the answers are the same."""
    label = np.repeat(["a", "b"], 8)
    X = np.random.default_rng(0).normal(0, 1, (16, 4, 30)) + (label == "b")[:, None, None] * np.linspace(-2, 2, 30)
    last = TactileClassifier(system="svm", params={"data.shape": "frames_last"}).fit(X, label)
    first = TactileClassifier(system="svm").fit(list(X.swapaxes(1, 2)), label)
    assert last.recogniser_.shape == (1, 4) and last.score(X, label) == 1
    np.testing.assert_array_equal(last.predict_proba(list(X)), first.predict_proba(list(X.swapaxes(1, 2))))


def grasps(per_object: int = 5, *, seed: int = 0):
    """Recordings of raw counts, each of an object longer than the one before, and their objects."""
    numbers = range(per_object)
    recordings = [
        recording(name, 10 * seed + number, before=OPEN, held=16 + number, after=0)
        for number in numbers
        for name in OBJECTS
    ]
    return recordings, np.array(OBJECTS * per_object)


def last(recordings) -> np.ndarray:
    """The last four frames of each recording, above its baseline: view sets (n, 4, 8, 10)."""
    return np.stack([counts[-4:] - np.rint(counts[:OPEN].mean(axis=0)) for counts in recordings])


def made(params=None, **arguments) -> TactileClassifier:
    return TactileClassifier(views=4, params=RAW | (params or {}), **(arguments or {"preset": "kernels"}))


@cache
def fitted() -> TactileClassifier:
    return made().fit(*grasps())


@pytest.mark.parametrize("system", [None, "trees", "view_gcn"])
def test_recordings_of_different_lengths_are_distinguished(system):
    new, truth = grasps(2, seed=1)
    classifier = made(NETWORK if system == "view_gcn" else {}, system=system).fit(*grasps())
    assert classifier.classes_.tolist() == list(OBJECTS) and classifier.score(new, truth) == 1
    probabilities = classifier.predict_proba(new)
    assert probabilities.shape == (6, 3)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1, rtol=1e-5)


def test_several_recordings_of_a_row_are_answered_together_and_left_out_as_one_group():
    recordings, _ = grasps()
    rows = [recordings[0::6] + recordings[3::6], *([each] for each in recordings[1::3]), *recordings[2::3]]
    several = TactileClassifier("kernels", params=RAW).fit(rows, ["ball"] + ["cup"] * 5 + ["pen"] * 5)
    pairs = [[recordings[place], recordings[place + 3]] for place in range(3)]
    for model in (several, fitted()):
        assert model.predict(pairs).tolist() == list(OBJECTS)
        parts = [answer_recording(model.recogniser_, each) for each in pairs[0]]
        expected = answer_together(model.recogniser_, parts).probabilities
        np.testing.assert_allclose(model.predict_proba(pairs)[0], expected, atol=1e-6)


@pytest.mark.parametrize("system", [None, "view_gcn"])
def test_an_array_of_view_sets_has_its_own_number_of_views(system):
    X, y = grasps()
    new, truth = grasps(2, seed=1)
    preset, params = (None, NETWORK) if system else ("kernels", None)
    classifier = TactileClassifier(preset, system, params=params).fit(last(X), y)
    assert classifier.params_.views == 4
    assert classifier.score(last(new), truth) == 1
    assert (classifier.recogniser_.temperature is not None) == (system is None)  # the preset is calibrated


@pytest.mark.parametrize("system", ["sensors", "view_gcn"])
def test_its_answers_are_those_of_the_stages(system):
    """The training recordings of a table, given as arrays, make the file that the table makes."""
    network = "model.backbone.width=8", f"model.system={system}"
    preprocess = "baseline=none", "zero=514", "filter=none", "contact_sensors=14", "scale=150"
    changes = [*SMALL, *network, *(f"preprocess.{change}" for change in preprocess)]
    params, frames = recipe(*changes), table(*changes)
    places = viewpoints(params.views, params.viewpoints, params.seed)
    views = cluster_frames(frames, places, params.cluster, stream(params.seed, "cluster"))
    weights = {}
    if system == "view_gcn":
        backbone, linear, _ = pretrain_backbone(frames, params, CPU)
        weights = {"backbone": backbone.state_dict(), "classifier": linear.state_dict()}
    expected = fit_classifier(frames, views, weights, params, CPU).classifier

    train = frames.on(TRAIN)
    rows = [train[frames.recording[train] == number] for number in np.unique(frames.recording[train])]
    values = {key: parse(text) for key, text in (change.split("=") for change in changes)}
    classifier = TactileClassifier(system=system, views=4, params=values | {"precision": "float32"})
    classifier.fit([frames.counts[index] for index in rows], [frames.label[index[0]] for index in rows])
    inputs = frames.inputs(frames.on(TEST), expected.transform)
    expected.prepare(CPU)
    sets = np.arange(len(inputs) // 4 * 4).reshape(-1, 4)
    first, second = (
        one.view_sets(one.frame_values(inputs), sets) for one in (expected, classifier.recogniser_.classifier)
    )
    assert (first == second).all()


def test_rows_may_have_more_sensors_than_a_frame_has_columns():
    X, y = np.random.default_rng(0).normal(0, 1, (12, 1400)), np.repeat([0, 1, 2], 4)
    X[np.arange(12), 300 * y] += 200
    assert (TactileClassifier(system="kernel").fit(X, y).predict(X) == y).all()


def test_a_classifier_that_is_pickled_or_saved_answers_alike(tmp_path):
    X, _ = grasps(2, seed=1)
    expected = fitted().predict_proba(X)
    assert (pickle.loads(pickle.dumps(fitted())).predict_proba(X) == expected).all()
    assert "recogniser_" not in fitted().__getstate__()  # the file has it
    fitted().save(tmp_path / "classifier.pt")
    recogniser = Recogniser(tmp_path / "classifier.pt")
    assert recogniser.classes == list(OBJECTS)
    assert (np.stack([answer_recording(recogniser, counts).probabilities for counts in X]) == expected).all()


def test_equal_seeds_give_equal_files_and_torch_s_generator_is_left_alone(tmp_path):
    X, y = grasps(3)
    before = torch.get_rng_state()
    for name, seed in (("first", 0), ("again", 0), ("other", 1)):
        made(NETWORK, system="view_gcn", random_state=seed).fit(X, y).save(tmp_path / name)
    first, again, other = ((tmp_path / name).read_bytes() for name in ("first", "again", "other"))
    assert first == again != other
    assert (torch.get_rng_state() == before).all()


@pytest.mark.parametrize(("reading", "scale"), [(20, 20), (-20, 1)])
def test_the_scale_of_rows_is_of_positive_readings_and_a_random_state_gives_any_seed(reading, scale):
    X, states = reading * np.eye(4, 548), [np.random.RandomState(number) for number in range(2)]  # as many as STAG's
    fits = [TactileClassifier(system="svm", random_state=state).fit(X, [0, 0, 1, 1]).params_ for state in states]
    assert [params.preprocess.scale for params in fits] == [scale] * 2
    assert len({params.seed // 2**16 for params in fits}) == 2


def test_a_class_without_contact_has_a_warning_and_probability_0():
    X, y = grasps(3)
    X = [counts[: OPEN - 1] if name == "cup" else counts for counts, name in zip(X, y, strict=True)]
    with pytest.warns(DataConversionWarning), pytest.warns(UserWarning, match="cup") as warned:
        classifier = made().fit(X, y[:, None])
    assert warned[-1].filename == __file__
    assert classifier.predict_proba(X[:1])[0, 1] == 0
    assert any("cup" in note.text and note.level == "warning" for note in classifier.notes_)


def test_a_row_without_contact_is_the_empty_hand_or_any_object():
    X, y = grasps(4)
    empty, (new, truth) = [counts[:OPEN] for counts in X[::3]], grasps(2, seed=1)
    with pytest.warns(UserWarning, match=r"X\[1\]"):
        probabilities = fitted().predict_proba([new[0], empty[0]])
    assert probabilities[0, 0] > 0.5
    np.testing.assert_allclose(probabilities[1], 1 / 3)
    classifier = made({"preprocess.baseline": "empty_hand"}).fit([*X, *empty], [*y, *["empty_hand"] * len(empty)])
    assert classifier.classes_.tolist() == ["ball", "cup", "empty_hand", "pen"]
    assert (classifier.predict([*new, empty[0]]) == [*truth, "empty_hand"]).all()


def test_recordings_that_are_all_contact_are_taken_as_they_are():
    X, y = grasps()
    new, truth = grasps(2, seed=1)
    classifier = TactileClassifier("kernels", views=4).fit([counts[OPEN + 4 :] for counts in X], y)
    assert classifier.recogniser_.preprocessing.params.filter == "none"
    assert classifier.score([counts[OPEN + 4 :] for counts in new], truth) == 1


def test_importing_it_loads_no_torch_and_fitting_needs_neither_dvc_nor_mlflow():
    program = (
        "import sys; sys.modules |= {'dvc': None, 'mlflow': None}\n"
        "from tactile_viewgcn import TactileClassifier\n"
        "assert 'torch' not in sys.modules\n"
        "print(TactileClassifier().fit([[0, 9], [0, 8], [9, 0], [8, 0]], [1, 1, 2, 2]).predict([[0, 9], [9, 0]]))\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=ROOT)
    assert result.stdout == "[1 2]\n", result.stderr
