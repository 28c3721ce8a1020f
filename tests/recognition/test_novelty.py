"""The distance to the nearest training frames, and its threshold."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.recognition.novelty import Novelty, fit_novelty, sensor_map
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tests.glove_data import table

# maps of the recordings of three classes on two sensors; the strongest reading is 4, which makes the unit 1
MAPS = {"a": [(1.0, 0.0), (1.0, 0.5)], "b": [(0.0, 1.0), (0.0, np.log(4))], "c": [(np.log(4), np.log(4))]}
FRAMES = 6  # of each recording
NEAREST = 0.5 / np.sqrt(2)  # distance of the two recordings of a; those of b are nearer, and c has one


def frames_with(maps):
    """Frames of recordings that have these maps: all frames of a recording are equal, 500 counts above the readings."""
    every = [(label, values) for label, recordings in enumerate(maps.values()) for values in recordings]
    label, number = (np.repeat(column, FRAMES) for column in ([one[0] for one in every], np.arange(len(every))))
    readings = np.repeat([np.where(np.array(one[1]) > 0, np.exp(one[1]), 0) for one in every], FRAMES, axis=0)
    side = np.full(len(label), TRAIN)
    return replace(
        table(),
        counts=500 + readings[:, None],
        label=label,
        recording=number,
        group=number,
        side=side,
        anchor=side == TRAIN,
        session=0 * label,
        baseline=0 * label,
        time=0.0 * label,
        baseline_mean=np.full((1, 1, 2), 500.0),
        live=np.ones((1, 2), bool),
        classes=list(maps),
    )


def test_a_map_is_the_logarithm_of_the_mean_reading_beyond_one_unit():
    readings = np.array([[0.0, 4.0, 8.0], [0.0, 4.0, 2.0 * (2 * np.e) - 8.0]])  # means 0, 4, 2e counts
    np.testing.assert_allclose(sensor_map(readings, 2.0), [0, np.log(2), 1], rtol=1e-6)


def test_the_score_is_the_root_mean_square_distance_to_the_nearest_set_over_the_threshold():
    maps = np.array([[0.0, 0.0], [1.0, 1.0]], np.float32)
    readings = np.array([[np.e, 1.0]])  # their map is (1, 0)
    assert Novelty(maps, 1.0, 0.5).score(readings) == pytest.approx(np.sqrt(0.5) / 0.5)


def test_the_threshold_is_the_distance_to_other_recordings_of_classes_that_have_two():
    novelty = fit_novelty(frames_with(MAPS), 4)
    assert (novelty.unit, novelty.threshold) == pytest.approx((1, NEAREST))
    expected = [values for recordings in MAPS.values() for values in recordings]
    np.testing.assert_allclose(novelty.maps, np.repeat(expected, 5, axis=0), rtol=1e-6)
    assert novelty.score(np.exp([[1.0, 0.25]])) == pytest.approx(0.5)  # between the two recordings of a


def test_the_test_side_and_recordings_shorter_than_a_view_set_are_left_out():
    frames = frames_with(MAPS)
    without = replace(frames, side=np.where(frames.recording == 1, TEST, TRAIN))  # a has one recording left
    assert fit_novelty(without, 4).threshold == pytest.approx(np.log(4 / np.e) / np.sqrt(2))  # of the two of b
    assert len(fit_novelty(without, 4).maps) == 4 * 5
    assert fit_novelty(frames, FRAMES + 1) is None
    # no class has two recordings
    assert fit_novelty(frames_with({name: maps[:1] for name, maps in MAPS.items()}), 4) is None


def test_copies_of_one_recording_have_no_threshold():
    assert fit_novelty(frames_with({"a": [(1.0, 0.0)] * 3, "b": [(0.0, 1.0)] * 3}), 2) is None
