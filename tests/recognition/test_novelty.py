"""The distance to the nearest training frames, and its threshold."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from tactile_viewgcn.recognition.novelty import Novelty, fit_novelty, sensor_map
from tests.small_glove import OBJECTS, SHAPE, pressed, recogniser
from tests.tables import table


def test_a_map_is_the_logarithm_of_the_mean_reading_beyond_one_unit():
    readings = np.array([[0.0, 4.0, 8.0], [0.0, 4.0, 2.0 * (2 * np.e) - 8.0]])  # means 0, 4, 2e counts
    np.testing.assert_allclose(sensor_map(readings, 2.0), [0, np.log(2), 1], rtol=1e-6)


def test_the_score_is_the_root_mean_square_distance_to_the_nearest_set_over_the_threshold():
    maps = np.array([[0.0, 0.0], [1.0, 1.0]], np.float32)
    novelty = Novelty(maps, 1.0, 0.5, np.array([[True, True, False]]))
    excess = np.array([[[np.e, 1.0, 99.0]]])  # its map is (1, 0)
    assert novelty.score(excess) == pytest.approx(np.sqrt(0.5) / 0.5)


def test_trained_objects_are_near_and_a_mirrored_glove_is_not():
    held = [np.repeat(40.0 * pressed(name)[None], 8, axis=0) for name in OBJECTS]
    assert all(recogniser().novelty.score(excess) < 1 for excess in held)
    assert all(recogniser().novelty.score(4 * excess[:, ::-1]) > 1 for excess in held)


def test_nothing_is_fitted_where_no_class_has_two_recordings_with_enough_frames():
    frames = table()
    assert fit_novelty(frames, 13) is None  # recordings have 12 frames
    one = replace(frames, recording=frames.label.astype(int), group=frames.label.astype(int))
    assert fit_novelty(one, 4) is None
    assert fit_novelty(frames, 4).maps.shape[1] == frames.live.sum()


def test_the_threshold_is_the_quantile_of_distances_to_other_recordings():
    frames = table()
    novelty = fit_novelty(frames, 4)
    pools = len(novelty.maps) // 5
    distance = np.sqrt(((novelty.maps[:, None] - novelty.maps[None]) ** 2).mean(axis=2))
    same = np.repeat(np.arange(pools), 5)[:, None] == np.repeat(np.arange(pools), 5)
    nearest = np.where(same, np.inf, distance).min(axis=1)
    assert novelty.threshold == pytest.approx(np.quantile(nearest, 0.99), rel=1e-5)


def test_the_classifier_s_file_keeps_it(tmp_path):
    novelty, held = recogniser().novelty, np.ones((8, *SHAPE))
    assert isinstance(novelty.score(held), float) and novelty.live.shape == SHAPE
    assert not isinstance(novelty.maps, torch.Tensor)
