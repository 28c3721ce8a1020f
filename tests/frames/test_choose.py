"""The values that `auto` becomes: by errors of a quick classifier on the training side, or by what was recorded."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames import choose as module
from tactile_viewgcn.frames.baseline import MIN_FRAMES, constant_baseline
from tactile_viewgcn.frames.choose import choose, contact_readings
from tactile_viewgcn.frames.contact import sensors_in_contact
from tactile_viewgcn.frames.open_hand import find_open_hand
from tactile_viewgcn.frames.quick_error import QuickError, _rank, quick_error
from tactile_viewgcn.frames.sides import deal
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load
from tests.glove_data import FILE, drifting, written

KINDS = ("empty_hand", "grasp", "none")
FIRST_NAME = {"empty_hand": "session0", "grasp": "recording0, grasp 1", "none": "zero"}  # of a baseline
CELLS = np.stack([np.repeat([1, 2], 10), np.arange(20)], axis=1)
BY_RECORDING = ("split.by=recording", "split.folds=2")


def error(mistakes, *, leaks=False):
    """An error of twenty groups, of which the first ones are mistakes."""
    wrong = (np.arange(20) < mistakes).astype(float)
    return QuickError(CELLS, wrong, 0.0, 0.3 if leaks else 0.9, 0.5, 100, 0.0)


def chosen(recordings, *changes, groups=None):
    """What is chosen for recordings under changed parameters; contact is of five sensors."""
    params = load(FILE, ("preprocess.contact_sensors=5", *changes))
    sides = deal(recordings, params.split, np.random.default_rng(0), empty_hand_class=True, groups=groups)
    return choose(recordings, params.preprocess, sides)


def values(choice):
    """Of the notes, by key."""
    assert all(note.level == "choice" and note.text for note in choice.notes)
    return {note.key.removeprefix("preprocess."): note.value for note in choice.notes}


@pytest.fixture(scope="module")
def glove(tmp_path_factory):
    """The empty hand and four objects, two recordings of two grasps each, in one session."""
    return drifting(recordings=2, grasps=2).table(tmp_path_factory.mktemp("glove") / "t")


@pytest.mark.parametrize(
    ("mistakes", "leaking", "expected"),
    [
        ((8, 8, 8), {}, "empty_hand"),
        ((8, 8, 6), {}, "empty_hand"),  # 2 of 20 less: 0.1 with a standard error of 0.07
        ((8, 8, 2), {}, "none"),
        ((8, 3, 2), {}, "grasp"),  # within two standard errors of the lowest
        ((2, 8, 3), {"empty_hand": 5}, "none"),
        ((2, 8, 8), {"empty_hand": 5, "none": 5}, "grasp"),
        ((4, 4, 4), {"empty_hand": 1, "grasp": 6, "none": 3}, "grasp"),  # the one that leaks least
    ],
)
def test_an_earlier_baseline_is_taken_unless_it_leaks_or_is_clearly_beaten(
    glove, monkeypatch, mistakes, leaking, expected
):
    errors = {kind: error(count) for kind, count in zip(KINDS, mistakes, strict=True)}
    leaks = {kind: error(leaking.get(kind, 5), leaks=kind in leaking) for kind in KINDS}
    monkeypatch.setattr(module, "measure", lambda *_: (errors, leaks))
    choice = chosen(glove, *BY_RECORDING)
    assert choice.params.baseline == values(choice)["baseline"] == expected
    assert choice.baseline.names[0] == FIRST_NAME[expected]
    assert ("zero" in values(choice)) == (expected == "none")


@pytest.mark.parametrize(
    ("empty", "shape", "baseline"),
    [
        (MIN_FRAMES, (7, 9), "empty_hand"), (MIN_FRAMES - 1, (8, 8), "grasp"),
        (MIN_FRAMES - 1, (7, 9), "none"), (MIN_FRAMES - 1, (3, 30), "none"),
    ],
)  # fmt: skip
def test_without_a_measurement_the_baseline_is_of_what_was_recorded_and_few_sensors_have_none(
    tmp_path, empty, shape, baseline
):
    made = drifting(recordings=2, grasps=2, shape=shape)
    kept = (made.columns["object"] > 0) | (np.cumsum(made.columns["object"] == 0) <= empty)
    choice = chosen(made.table(tmp_path / "t", kept), *BY_RECORDING)
    assert choice.errors == choice.leaks == {} and choice.params.baseline == baseline
    assert choice.params.filter == ("none" if baseline == "none" else "contact")


def test_what_is_set_is_kept_and_what_is_not_needed_is_not_computed(glove):
    fixed = ("preprocess.scale=100", *BY_RECORDING)
    choice = chosen(glove, "preprocess.baseline=grasp", "preprocess.filter=contact", *fixed)
    assert choice.notes == [] and choice.errors == {} and choice.hand is not None
    assert (choice.params.baseline, choice.params.filter, choice.params.scale) == ("grasp", "contact", 100.0)
    assert choice.params.contact_sensors == 5 and len(choice.baseline.names) > 1
    nothing = chosen(glove, "preprocess.baseline=none", "preprocess.filter=none", *fixed)
    assert nothing.hand is None and nothing.baseline.mean.tolist() == [[[500.0] * 8] * 5]


@pytest.mark.parametrize("of_object", [True, False])
def test_recordings_are_all_contact_if_their_quietest_frames_predict_the_objects(tmp_path, of_object):
    """A firm grasp, then a light, quietest one: of the object, or of the recording."""
    rng, label, light = np.random.default_rng(0), np.repeat(np.arange(4), 6), np.arange(80) >= 40
    firm = (rng.random((4, 8, 8)) < 0.4)[label]
    gentle = firm if of_object else rng.random((24, 8, 8)) < 0.4
    force = np.where(light[:, None, None], 60.0 * gentle[:, None], 160.0 * firm[:, None])
    counts = np.rint(100 + force + rng.normal(0, 2, (24, 80, 8, 8))).astype(np.int16).reshape(-1, 8, 8)
    columns = {"object": np.repeat(label, 80), "recording": np.repeat(np.arange(24), 80), "grasp": np.tile(light, 24)}
    recordings = written(tmp_path / "t", counts, **columns, objects=["mug", "pen", "ball", "coin"])
    assert chosen(recordings, "split.by=recording").hand.all_contact == of_object


@pytest.mark.parametrize(
    ("flagged", "baseline", "expected"),
    [
        (lambda label: label > 0, "grasp", "flags"),  # none of the empty hand's
        (lambda label: label > 1, "grasp", "contact"),  # none of one object's
        (lambda label: label > 1, "none", "none"),
    ],
)
def test_flags_are_taken_if_every_object_has_some(tmp_path, flagged, baseline, expected):
    made = drifting(recordings=2, grasps=2)
    valid = ~made.open & flagged(made.columns["object"])
    recordings = made.table(tmp_path / "t", valid=valid)
    assert values(chosen(recordings, f"preprocess.baseline={baseline}", *BY_RECORDING))["filter"] == expected


@pytest.mark.parametrize(
    ("reading", "scale"),
    [
        (15, 150), (150, 150), (14.9, 15), (163, 160), (0, 150),
        (1e30, 1e30), (1.1e30, None), (1e-30, 1e-30), (9e-31, None),
    ],
)  # fmt: skip
def test_the_released_scale_is_kept_at_one_to_ten_times_the_readings_and_none_is_taken_that_params_refuses(
    glove, reading, scale, monkeypatch
):
    readings = np.repeat([reading / 10, reading, 10 * reading], [900, 99, 1])  # one alone is stronger
    monkeypatch.setattr(module, "contact_readings", lambda *_: readings[readings > 0])
    if scale:
        assert chosen(glove, *BY_RECORDING).params.scale == scale
    else:
        with pytest.raises(UserError, match="rescale"):
            chosen(glove, *BY_RECORDING)


def test_readings_in_contact_lie_above_five_standard_deviations_of_noise_and_not_on_them(glove):
    hand = find_open_hand(glove, 5)
    readings = contact_readings(glove, replace(hand, noise=np.full_like(hand.noise, 6)), constant_baseline(glove, 514))
    assert readings.min() == 31 and 32 <= np.percentile(readings, 99) < 35  # of a pressed sensor about 30


def test_the_fewest_sensors_in_contact_are_a_fortieth_of_the_array(glove):
    assert [sensors_in_contact(count) for count in (1, 16, 96, 384, 548, 1400)] == [2, 2, 3, 10, 14, 14]
    assert chosen(glove, "preprocess.contact_sensors=auto", *BY_RECORDING).params.contact_sensors == 2  # of 40


def test_frames_of_a_cell_are_ranked_in_their_order():
    cells = np.random.default_rng(0).integers(3, size=200).tolist()
    assert _rank(np.array(cells)).tolist() == [cells[:place].count(cell) for place, cell in enumerate(cells)]


def test_a_standard_error_is_over_groups():
    more, spread = error(8).more_than(error(6))
    assert more == pytest.approx(0.1) and spread == pytest.approx(np.sqrt(0.1 * 0.9 / 19))
    doubled = QuickError(np.repeat(CELLS, 2, axis=0), np.repeat(error(8).wrong, 2), 0, 1, 0.5, 100, 0.0)
    assert doubled.standard_error == pytest.approx(error(8).standard_error)  # the same groups, more often


def test_objects_are_recognised_in_groups_that_are_held_out_and_labels_at_random_are_not():
    rng = np.random.default_rng(0)
    label, group = np.repeat([0, 1, 2], 60), np.repeat(np.arange(18), 10)
    readings = rng.normal(0, 1, (180, 20)) + 2 * (np.arange(20) % 3 == label[:, None])
    usable = np.ones(180, dtype=bool)
    apart = quick_error("test", lambda index: readings[index], usable, label, group)
    assert (apart.error, apart.groups, apart.frames, apart.chance) == (0, 18, 180, pytest.approx(2 / 3))
    by_group = rng.normal(0, 1, (18, 20))[group]  # a group is alike, an object is not
    alike = quick_error("test", lambda index: by_group[index], usable, label, group)
    assert alike.error > 0.4 and not alike.beats_chance and apart.beats_chance
    once = np.where(label == 0, group, label)
    assert quick_error("test", lambda index: readings[index], usable, label, once) is None
