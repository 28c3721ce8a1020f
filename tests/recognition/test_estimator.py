"""The estimator trains and warns like the pipeline, and the other interfaces read its files."""

import pickle
from functools import cache

import numpy as np
import pandas as pd
import pytest
import torch
from sklearn.base import clone
from sklearn.exceptions import DataConversionWarning
from sklearn.model_selection import GridSearchCV, StratifiedGroupKFold

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.messages import UserError
from tests.glove_data import OBJECTS, recording

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


def test_channels_are_taken_with_their_frames_first_or_last():
    """X is an array (n, C, T) like the arrays of aeon and sktime.

    As a list of arrays (T, C) it has the same answers.
    """
    label = np.repeat(["a", "b"], 8)
    trend = (label == "b")[:, None, None] * np.linspace(-2, 2, 30)
    X = np.random.default_rng(0).normal(0, 1, (16, 4, 30)) + trend
    last = TactileClassifier(system="svm", params={"data.shape": "frames_last"}).fit(X, label)
    first = TactileClassifier(system="svm").fit(list(X.swapaxes(1, 2)), label)
    assert last.recogniser_.shape == (1, 4)
    assert last.score(X, label) == 1
    expected = first.predict_proba(list(X.swapaxes(1, 2)))
    np.testing.assert_array_equal(last.predict_proba(list(X)), expected)
    frames_first = X.swapaxes(1, 2)
    np.testing.assert_array_equal(first.predict_proba(frames_first), expected)
    # with one group for each label no group can be held out
    uncalibrated = TactileClassifier(system="svm").fit(frames_first, label, groups=label)
    assert first.recogniser_.calibrated
    assert not uncalibrated.recogniser_.calibrated


def grasps(per_object: int = 5, *, seed: int = 0):
    """Return recordings of raw counts, and the names of their objects, which take turns.

    Each object's next recording is a frame longer. No two recordings have frames in common.
    """
    recordings = []
    for repeat in range(per_object):
        for name in OBJECTS:
            recording_seed = 100 * seed + len(recordings)
            recordings.append(
                recording(name, recording_seed, before=OPEN, held=16 + repeat, after=0)
            )
    return recordings, np.array(OBJECTS * per_object)


def small_classifier(params=None, **arguments) -> TactileClassifier:
    """Return an estimator of four views, of the preset `kernels` if no argument says otherwise."""
    if not arguments:
        arguments = {"preset": "kernels"}
    return TactileClassifier(views=4, params=RAW | (params or {}), **arguments)


@cache
def fitted() -> TactileClassifier:
    """Return the estimator of the preset `kernels`, fitted to five grasps of each object."""
    return small_classifier().fit(*grasps())


@pytest.mark.parametrize("system", [None, "view_gcn"])
def test_recordings_of_different_lengths_are_distinguished(system):
    new, truth = grasps(2, seed=1)
    X, y = grasps()
    params = NETWORK if system == "view_gcn" else {}
    names_with_blanks = [f" {name}" for name in y]
    classifier = small_classifier(params, system=system).fit(X, names_with_blanks)
    assert classifier.classes_.tolist() == list(OBJECTS)
    assert classifier.score(new, truth) == 1
    probabilities = classifier.predict_proba(new)
    assert probabilities.shape == (6, 3)
    np.testing.assert_allclose(probabilities.sum(axis=1), 1, rtol=1e-5)


def test_a_pickled_and_a_loaded_classifier_answer_alike(tmp_path):
    X, truth = grasps(2, seed=1)
    fitted().save(tmp_path / "classifier.pt")
    loaded = TactileClassifier.load(tmp_path / "classifier.pt")
    for copy in (pickle.loads(pickle.dumps(fitted())), loaded):
        assert (copy.predict_proba(X) == fitted().predict_proba(X)).all()
    assert loaded.classes_.tolist() == list(OBJECTS)
    assert loaded.score(X, truth) == 1


def test_equal_seeds_give_equal_files_and_torch_s_generator_is_left_alone(tmp_path):
    X, y = grasps(3)
    before = torch.get_rng_state()
    for name, seed in (("first", 0), ("again", 0), ("other", 1)):
        classifier = small_classifier(NETWORK, system="view_gcn", random_state=seed)
        classifier.fit(X, y).save(tmp_path / name)
    first, again, other = ((tmp_path / name).read_bytes() for name in ("first", "again", "other"))
    assert first == again != other
    assert (torch.get_rng_state() == before).all()


def test_a_random_state_gives_any_seed_and_scikit_learn_clones_and_searches():
    X, y = grasps(3)
    seeds = set()
    for state_seed in range(2):
        state = np.random.RandomState(state_seed)
        classifier = small_classifier(system="svm", random_state=state).fit(X, y)
        seeds.add(classifier.params_.seed // 2**16)
    assert len(seeds) == 2
    keys = {"views": 3, "seed": 5, "model.members": ["svm"]}
    set_by_key = small_classifier(keys, system="kernel").fit(X, y).params_
    assert (set_by_key.views, set_by_key.seed, set_by_key.model.members) == (3, 5, ["svm"])
    search = GridSearchCV(
        small_classifier(system="svm"), {"system": ["svm", "kernel"]}, cv=StratifiedGroupKFold(3)
    )
    search.fit(X, y, groups=np.arange(9) // 3)
    assert search.best_score_ == 1
    best = search.best_estimator_
    assert clone(best).get_params() == best.get_params()


def test_a_class_without_contact_has_a_warning_and_probability_0():
    X, y = grasps(3)
    for index in np.flatnonzero(y == "cup"):
        X[index] = X[index][: OPEN - 1]
    with pytest.warns(DataConversionWarning), pytest.warns(UserWarning, match="cup") as warned:
        classifier = small_classifier().fit(X, y[:, None])
    assert warned[-1].filename == __file__
    assert classifier.predict_proba(X[:1])[0, 1] == 0
    assert any("cup" in note.text and note.level == "warning" for note in classifier.notes_)


def test_a_row_without_contact_is_the_empty_hand_or_any_object():
    X, y = grasps(4)
    empty = [counts[:OPEN] for counts in X[::3]]
    new, truth = grasps(2, seed=1)
    with pytest.warns(UserWarning, match=r"X\[1\], X\[2\]") as warned:
        probabilities = fitted().predict_proba([new[0], empty[0], empty[1]])
    assert len(warned) == 1
    assert probabilities[0, 0] > 0.5
    np.testing.assert_allclose(probabilities[1:], 1 / 3)
    classifier = small_classifier({"preprocess.baseline": "empty_hand"}).fit(
        [*X, *empty], [*y, *["empty_hand"] * len(empty)]
    )
    assert classifier.classes_.tolist() == ["ball", "cup", "empty_hand", "pen"]
    assert (classifier.predict([*new, empty[0]]) == [*truth, "empty_hand"]).all()


def test_a_channel_that_is_the_label_and_a_copy_are_warned_of_as_by_ingest():
    """The recordings of the two objects differ in every channel."""
    y = np.repeat(["a", "b"], 8)
    rng = np.random.default_rng(0)
    X = []
    for name in y:
        is_b = float(name == "b")
        X.append(np.hstack([rng.normal(3 * is_b, 1, (30, 3)), np.full((30, 1), is_b)]))
    X[3] = X[2].copy()
    with pytest.warns(UserWarning) as warned:
        classifier = TactileClassifier(system="svm").fit(X, y)
    texts = [str(warning.message) for warning in warned]
    constant = (
        "column 4 is constant in each recording (its beginning predicts the object: error 0.0 %"
    )
    assert any(constant in text for text in texts)
    assert any("X[3] repeats X[2]" in text for text in texts)
    topics = {note.topic for note in classifier.notes_ if note.level == "warning"}
    assert topics >= {"columns", "copies"}


def test_columns_called_time_or_label_or_left_out_by_name_are_not_read_and_sensors_keep_order():
    """The time, and the column that is left out by name, would tell the objects apart."""
    label = np.repeat(["a", "b"], 9)
    rng = np.random.default_rng(0)

    def table(recording, name):
        frames = np.arange(30)
        pressure = 4.0 * (name == "b")
        return pd.DataFrame(
            {
                "Timestamp": 9.0 * recording + frames / 20,
                "f1": rng.normal(pressure, 1, 30),
                "index": frames,
                "f2": rng.normal(0, 1, 30),
                "object": name,
                "no": 9.0 * recording,
            }
        )

    X = [table(recording, name) for recording, name in enumerate(label)]
    model = TactileClassifier(system="svm", params={"data.columns": ["leave_out:no"]}).fit(X, label)
    assert model.recogniser_.plan.channel_names == ["f1", "f2"]
    assert model.score(X, label) == 1
    sensors = [columns[["f1", "f2"]] for columns in X]
    expected = TactileClassifier(system="svm").fit(sensors, label)
    np.testing.assert_array_equal(model.predict_proba(X), expected.predict_proba(sensors))
    texts = [note.text for note in model.notes_ if note.topic == "columns"]
    assert len(texts) == 4
    assert "'Timestamp'" in texts[0]
    assert "'object'" in texts[2]
    np.testing.assert_allclose(model.recogniser_.plan.rates, 20)
    f1_last = [columns.drop(columns=["Timestamp", "f1"]).assign(f1=0.0) for columns in X]
    with pytest.raises(UserError, match="f2; expected f1"):
        model.predict(f1_last)
    with pytest.raises(UserError, match=r"X\[1\]: sensor 1 is f2; expected f1 of f1, f2"):
        model.fit([X[0], f1_last[0]], ["a", "b"])


@pytest.mark.parametrize(
    ("shape", "params"),
    [
        ((24, 1, 6), {}),
        ((24, 1, 1), {}),
        ((24, 9, 6), {}),
        ((24, 6, 1), {"data.shape": "frames_last"}),
        ((24, 1, 6), {"data.shape": "frames_last"}),
        ((24, 1, 4, 6), {}),
        ((24, 5, 4, 6), {}),
    ],
)
def test_what_fit_takes_predict_takes_and_answers_a_row_each(shape, params):
    """X is one array of recordings, also if each recording is a single frame."""
    label = np.tile(["a", "b"], 12)
    X = np.random.default_rng(0).normal(0, 1, shape)
    X[label == "b"] += 8.0
    classifier = TactileClassifier(system="svm", params=params).fit(X, label)
    assert (classifier.predict(X) == label).all()
    np.testing.assert_array_equal(classifier.predict_proba(X[:1]), classifier.predict_proba([X[0]]))
