"""The training set is the same to the last byte, whatever the frames of the other sets read."""

from dataclasses import fields
from itertools import product

import numpy as np
import pytest

from tactile_viewgcn.frames import filter, split
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.tables.frames import TRAIN
from tests.glove_data import drifting, recipe, views_of, written

BY = ("source", "recording", "grasp", "session")
BASELINES = ("auto", "empty_hand", "grasp", "none")
FILTERS = ("auto", "flags", "contact", "none")
EMPTY = "the empty hand recorded"
NO_EMPTY = "no empty hand"
CASES = [
    *(
        (by, baseline, filtered, EMPTY)
        for by, baseline, filtered in product(BY, BASELINES, FILTERS)
        # the filter contact is refused without a baseline
        if (baseline, filtered) != ("none", "contact")
    ),
    # without an empty hand, the noise is measured on successive frames
    *product(BY, ("auto", "grasp", "none"), ("auto", "none"), [NO_EMPTY]),
]


@pytest.fixture(scope="module")
def glove():
    """Return four recordings of the empty hand and of each of two objects, with a dead sensor.

    Each recording has two grasps.
    """
    glove = drifting(objects=2, recordings=4, grasps=2, between=1.0, shape=(8, 9))
    glove.counts[:, 0, 0] = 500
    return glove


def training_set(recordings, params):
    """Return everything that the training set has, or that is chosen or fitted on it, by name.

    Also return which frames are not in the training set.
    """
    result = preprocess_recordings(recordings, params.preprocess, params.split)
    frames = result.frames
    choice = result.choice
    train = frames.on(TRAIN)
    values = {name: getattr(frames, name) for name in ("live", "scale", "transform", "classes")}
    for name in ("label", "group", "anchor", "recording"):
        values[name] = getattr(frames, name)[train]
    values["rows"] = np.flatnonzero(result.keep)[train]
    values["passed"] = result.passed[result.sides.training]
    values["above baseline"] = frames.inputs(train, "counts")
    values["input"] = frames.inputs(train)
    values["choice"] = choice.plan.params
    values["notes"] = [note for note in choice.notes if note.level == "choice"]
    if params.preprocess.filter == "auto":  # clustering takes longest
        views = views_of(frames, params)
        values["cluster"] = views.cluster[train]
        values["pool"] = views.pool[train]
    if choice.leak:
        values["leak"] = choice.leak.error
    for field in fields(frames.plan):
        values[f"plan {field.name}"] = getattr(frames.plan, field.name)
    return values, ~result.sides.training


@pytest.mark.parametrize(
    ("by", "baseline", "filtered", "empty"), CASES, ids=["-".join(case) for case in CASES]
)
def test_no_reading_of_the_other_sets_reaches_the_training_set(
    tmp_path, glove, monkeypatch, by, baseline, filtered, empty
):
    """Test and validation frames are changed.

    There each object presses other sensors, and far more strongly. All other sensors read 0.
    """
    monkeypatch.setattr(filter, "CONTACT_SHARE", 0.042)  # 3 of 71 sensors, 4 of 72
    monkeypatch.setattr(split, "FEWEST_ANCHORS", 4)
    label = glove.columns["object"]
    grasp = glove.columns["grasp"]
    number = glove.columns["recording"] % 4  # among the recordings of the object
    written_rows = (label > 0) | (empty == EMPTY)
    valid = ~glove.open & ((number + grasp) % 3 > 0)
    if filtered == "auto" and empty == EMPTY:
        valid &= label == 1
    columns = {"session": number % 2, "valid": valid}
    if by == "session":
        columns["session"] = number
    # With other splits the column `split` would spare the measurement of baselines. It puts grasps
    # of one recording into both sets.
    if by == "source":
        columns["split"] = ((number == 3) | ((number == 1) & (grasp == 1))).astype(np.int8)
    params = recipe(
        f"preprocess.baseline={baseline}",
        f"preprocess.filter={filtered}",
        "cluster.restarts=1",
        f"split.by={by}",
        f"split.folds={2 if by == 'grasp' else 4}",
        "split.validation=0.3",
    )
    expected, other = training_set(glove.table(tmp_path / "a", written_rows, **columns), params)
    changed = np.zeros(len(label), dtype=bool)
    changed[np.flatnonzero(written_rows)[other]] = True
    # the empty hand of a session gives its baseline in whichever set it is, so it is not changed
    changed &= (label > 0) | (by == "session")
    counts = glove.counts.copy().reshape(len(label), -1)
    pressed = np.arange(72) // 24 == label[changed, None]
    alternating = np.arange(changed.sum())[:, None] % 2
    counts[changed] = np.where(pressed, 900 + 300 * alternating, 0)
    counts = counts.reshape(glove.counts.shape)
    # the flags are changed too: object 2 was the only one without flags
    columns["valid"] = np.where(changed, label == 2, valid)
    planted = {name: values[written_rows] for name, values in (glove.columns | columns).items()}
    actual, _ = training_set(written(tmp_path / "b", counts[written_rows], **planted), params)
    assert changed.any()
    assert actual.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_array_equal(actual[name], value, err_msg=name)


def test_the_empty_hand_of_another_set_gives_only_baseline_and_noise(tmp_path, glove):
    """Only in this empty hand the dead sensor varies, and only it reads 0."""
    columns = glove.columns | {"session": glove.columns["recording"] % 2}
    params = recipe("preprocess.baseline=auto", "split.by=recording", "split.folds=4")
    recordings = written(tmp_path / "a", glove.counts, **columns)
    expected = preprocess_recordings(recordings, params.preprocess, params.split)
    other = (columns["object"] == 0) & ~expected.sides.training
    counts = glove.counts.copy()
    counts[other, 0, 0] = 500 * (np.arange(other.sum()) % 2)
    recordings = written(tmp_path / "b", counts, **columns)
    actual = preprocess_recordings(recordings, params.preprocess, params.split)
    assert other.any()
    assert not expected.frames.live[0, 0]
    np.testing.assert_array_equal(actual.frames.live, expected.frames.live)
    assert actual.choice.plan.params == expected.choice.plan.params
