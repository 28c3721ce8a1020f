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
BASELINES, FILTERS = ("auto", "empty_hand", "grasp", "none"), ("auto", "flags", "contact", "none")
EMPTY, NO_EMPTY = "the empty hand recorded", "no empty hand"
CASES = [
    # the filter contact is refused without a baseline
    *(
        case
        for case in product(BY, BASELINES, FILTERS, [EMPTY])
        if case[1:3] != ("none", "contact")
    ),
    # without an empty hand, the noise is measured on successive frames
    *product(BY, ("auto", "grasp", "none"), ("auto", "none"), [NO_EMPTY]),
]


@pytest.fixture(scope="module")
def glove():
    """An array with a dead sensor: four recordings of the empty hand and of each of two objects.

    Each recording has two grasps.
    """
    made = drifting(objects=2, recordings=4, grasps=2, between=1.0, shape=(8, 9))
    made.counts[:, 0, 0] = 500
    return made


def training_side(recordings, params):
    """Return everything that the training set has, or that is chosen or fitted on it, by name.

    Also return which frames are not in the training set.
    """
    made = preprocess_recordings(recordings, params.preprocess, params.split)
    frames, choice, train = made.frames, made.choice, made.frames.on(TRAIN)
    values = {name: getattr(frames, name) for name in ("live", "scale", "transform", "classes")}
    values |= {
        name: getattr(frames, name)[train] for name in ("label", "group", "anchor", "recording")
    }
    values |= {"rows": np.flatnonzero(made.keep)[train], "passed": made.passed[made.sides.training]}
    values |= {"above baseline": frames.inputs(train, "counts"), "input": frames.inputs(train)}
    values |= {
        "choice": choice.plan.params,
        "notes": [note for note in choice.notes if note.level == "choice"],
    }
    if params.preprocess.filter == "auto":  # clustering takes longest
        views = views_of(frames, params)
        values |= {"cluster": views.cluster[train], "pool": views.pool[train]}
    values |= {"leak": choice.leak.error} if choice.leak else {}
    plan = {field.name: getattr(frames.plan, field.name) for field in fields(frames.plan)}
    values |= {f"plan {name}": value for name, value in plan.items()}
    return values, ~made.sides.training


@pytest.mark.parametrize(
    ("by", "baseline", "filtered", "empty"), CASES, ids=["-".join(case) for case in CASES]
)
def test_no_reading_of_the_other_sides_reaches_the_training_side(
    tmp_path, glove, monkeypatch, by, baseline, filtered, empty
):
    """Test and validation frames are changed.

    There each object presses other sensors, and far more strongly. All other sensors read 0.
    """
    monkeypatch.setattr(filter, "CONTACT_SHARE", 0.042)  # 3 of 71 sensors, 4 of 72
    monkeypatch.setattr(split, "FEWEST_ANCHORS", 4)
    label, number, grasp = (glove.columns[name] for name in ("object", "recording", "grasp"))
    number = number % 4
    part = (label > 0) | (empty == EMPTY)
    columns = {
        "session": number if by == "session" else number % 2,
        "valid": ~glove.open
        & ((number + grasp) % 3 > 0)
        & ((label == 1) | (filtered != "auto") | (empty != EMPTY)),
    }
    # with other splits this column would spare the measurement of baselines. Recordings are in both
    # sets
    if by == "source":
        columns["split"] = ((number == 3) | ((number == 1) & (grasp == 1))).astype(np.int8)
    asked = (
        f"preprocess.baseline={baseline}",
        f"preprocess.filter={filtered}",
        "cluster.restarts=1",
    )
    dealt = f"split.by={by}", f"split.folds={2 if by == 'grasp' else 4}", "split.validation=0.3"
    params = recipe(*asked, *dealt)
    expected, other = training_side(glove.table(tmp_path / "a", part, **columns), params)
    changed = np.zeros(len(part), dtype=bool)
    changed[np.flatnonzero(part)[other]] = True
    # the empty hand of a session gives its baseline in whichever set it is, so it is not changed
    changed &= (label > 0) | (by == "session")
    counts, sensors = (
        glove.counts.copy().reshape(len(part), -1),
        np.arange(72) // 24 == label[changed, None],
    )
    alternating = np.arange(changed.sum())[:, None] % 2
    counts[changed] = np.where(sensors, 900 + 300 * alternating, 0)
    # the flags are changed too: object 2 was the only one without flags
    columns["valid"] = np.where(changed, label == 2, columns["valid"])
    planted = {name: values[part] for name, values in (glove.columns | columns).items()}
    actual, _ = training_side(
        written(tmp_path / "b", counts.reshape(glove.counts.shape)[part], **planted), params
    )
    assert actual.keys() == expected.keys() and changed.any()
    for name, value in expected.items():
        np.testing.assert_array_equal(actual[name], value, err_msg=name)


def test_the_empty_hand_of_another_side_gives_baseline_and_noise_alone(tmp_path, glove):
    """Only in this empty hand the dead sensor varies, and only it reads 0."""
    columns = glove.columns | {"session": glove.columns["recording"] % 2}
    params = recipe("preprocess.baseline=auto", "split.by=recording", "split.folds=4")
    made = preprocess_recordings(
        written(tmp_path / "a", glove.counts, **columns), params.preprocess, params.split
    )
    other = (columns["object"] == 0) & ~made.sides.training
    counts = glove.counts.copy()
    counts[other, 0, 0] = 500 * (np.arange(other.sum()) % 2)
    again = preprocess_recordings(
        written(tmp_path / "b", counts, **columns), params.preprocess, params.split
    )
    assert other.any() and not made.frames.live[0, 0]
    np.testing.assert_array_equal(again.frames.live, made.frames.live)
    assert again.choice.plan.params == made.choice.plan.params
