"""The unit of a glove, and the noise that limits it."""

import numpy as np
import pytest

from tactile_viewgcn.members import representation
from tactile_viewgcn.members.by_name import build_members
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.representation import Representation, contact_unit, successive_noise


def test_one_reading_in_ten_is_above_four_units_and_a_glove_that_is_hardly_touched_has_a_unit_too():
    readings = np.arange(1000, dtype=np.float32).reshape(10, 100) / 7
    unit = contact_unit(readings)
    assert np.mean(readings > 4 * unit) == pytest.approx(0.1, abs=2e-3)
    assert contact_unit(readings / 1000) == pytest.approx(unit / 1000)
    hardly_touched = np.zeros((10, 100), dtype=np.float32)
    hardly_touched[0, :4] = 8
    assert contact_unit(hardly_touched) == 2.0
    assert contact_unit(0 * hardly_touched) == 1.0


def test_the_noise_limits_the_unit_where_more_than_one_sensor_in_ten_is_pressed():
    readings = np.random.default_rng(0).normal(0, 2, (50, 100)).astype(np.float32)
    readings[:, :40] += 200
    unit = contact_unit(readings)
    assert unit == pytest.approx(50, rel=0.05)
    assert contact_unit(readings, noise=5.0) == 7.5
    assert contact_unit(readings, noise=100.0) == unit
    assert contact_unit(readings, noise=0.0) == pytest.approx(unit / 10)


def test_noise_is_that_of_successive_frames_of_a_recording(monkeypatch):
    rng = np.random.default_rng(0)
    recording = np.repeat(np.arange(6), 50)
    offset = 1000 * recording[:, None, None]
    index = np.arange(300)
    live = np.ones((4, 5), dtype=bool)
    live[0] = False  # a row of five has no sensors
    counts = offset + live * rng.normal(0, 3, (300, 4, 5))
    noise = successive_noise(counts, recording, index, live)
    change = np.diff(counts.reshape(6, 50, 4, 5), axis=1)
    assert noise == np.median(np.abs(change[:, :, live])) / (0.6745 * 2**0.5)
    assert noise == pytest.approx(3, rel=0.1)
    # the few compared pairs come from all recordings, of which the first two are quiet
    monkeypatch.setattr(representation, "MOST_PAIRS", 30)
    factor = np.where(recording < 2, 0.1, 1)
    quiet = offset + factor[:, None, None] * (counts - offset)
    assert 0.2 < successive_noise(quiet, recording, index, live) / noise < 0.9
    assert successive_noise(counts, index, index, live) == np.inf  # each frame is a recording
    assert successive_noise(counts, recording, index[::2], live) == np.inf
    mostly_equal = np.rint(offset + rng.normal(0, 0.4, counts.shape))
    assert successive_noise(mostly_equal, recording, index, live) == np.inf


def test_channels_are_in_standard_deviations_from_their_mean_and_arrays_in_units():
    sample = np.array([[1, 5, 7], [3, 5, 7], [8, 5, 10]])
    channels = Representation.of(np.ones((1, 3), bool), sample, 2.0)
    assert channels.centre.tolist() == [4, 5, 8]
    np.testing.assert_allclose(channels.spread, [(26 / 3) ** 0.5, 1, 2**0.5], rtol=1e-6)
    array = Representation.of(np.ones((8, 8), bool), np.tile(sample, (1, 22))[:, :64], 2.0)
    np.testing.assert_array_equal(array.scaled(np.full(64, 6)), np.full(64, 3))


@pytest.mark.parametrize(
    ("shape", "vectors"), [((1, 64), "NormalisedVectors"), ((8, 8), "SupportVectors")]
)
def test_each_member_has_an_estimator_and_a_quick_one_of_fewer_frames_or_trees(shape, vectors):
    scale = Representation(np.ones(shape, bool), np.zeros(64), np.ones(64))
    estimators = {
        "trees": "Forest",
        "svm": vectors,
        "convolutions": "Ridge",
        "pooled_kernel": "KernelRidge",
    }
    for member in build_members([*estimators], scale, 2):
        assert type(member.estimator()).__name__ == estimators[member.name]
    recordings = list(np.arange(2100 * 64.0).reshape(2, 1050, 64))
    examples = Examples(
        recordings.__getitem__, np.arange(2), scale, sizes=(600,), classes=2, seed=0
    )
    both = np.ones(2, dtype=bool)
    kernel, trees = build_members(["kernel", "trees"], scale, 2)
    for quick, frames, tree_count in ((False, 2000, 300), (True, 1000, 100)):
        kernel.fit(examples, both, seed=0, quick=quick)
        trees.fit(examples, both, seed=0, quick=quick)
        assert frames <= len(kernel.of_frames.points) <= frames + 2
        assert len(trees.whole.roots) == tree_count
