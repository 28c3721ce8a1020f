"""From pressure to counts: each effect by itself, against loops and hand-worked cases."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.glove import sensor
from tactile_viewgcn.glove.hand import stag_hands
from tactile_viewgcn.glove.sensor import Sensors
from tactile_viewgcn.randomness import stream

HAND = stag_hands()
COUNT = len(HAND.row)
FLAT = np.zeros((1, 1, 1))  # no flexion
PA = 1 / sensor.SENSITIVITY  # Pa for one count at low pressure
PLAIN = {
    "gain": np.ones(COUNT),
    "stuck": np.full(COUNT, np.nan),
    "bend": np.zeros(COUNT),
    "baseline": np.full(COUNT, 100.0),
    "noise": np.zeros(COUNT),
    "common": 0.0,
}


def frames_of(pressure, *effects, flexion=FLAT, **changes):
    """Return frames (B, T, 32, 32) for pressures (B, T, S) Pa.

    The sensors of the gloves are equal, with baseline 100 and gain 1 if `changes` has no others.
    """
    count = len(pressure)
    noises = [stream(0, "noise", recording) for recording in range(count)]
    glove = Sensors(HAND, 0, [0] * count, noises, frozenset(effects))
    for name, values in (PLAIN | changes).items():
        setattr(glove, name, np.stack([values] * count))
    return glove.read(pressure, flexion)


def read(pressure, *effects, **changes):
    """Return counts (T, S) above the baseline.

    The pressures are in counts: (T, S), or (T,) if they are the same for all sensors.
    """
    pressure = np.asarray(pressure, dtype=float)
    if pressure.ndim == 1:
        pressure = np.repeat(pressure[:, None], COUNT, axis=1)
    frames = frames_of(pressure[None] * PA, *effects, **changes)[0]
    baseline = changes.get("baseline", PLAIN["baseline"])
    return frames[:, HAND.row, HAND.column] - baseline.astype(int)


def test_counts_follow_pressure_and_with_bending_the_flexion_each_sensor_by_its_own_share():
    rng = np.random.default_rng(0)
    gain = np.linspace(0.5, 2, COUNT)
    bend = np.linspace(0, 3, COUNT)
    pressure = rng.uniform(0, 300, (4, COUNT))
    flexion = rng.uniform(0, 1.5, (1, 4, COUNT))
    for effects, share in (((), 0), (("bending",), 1)):
        counts = read(pressure, *effects, gain=gain, bend=bend, flexion=flexion)
        expected = np.rint(100 + gain * pressure + share * bend * flexion[0]) - 100
        np.testing.assert_array_equal(counts, expected)


def test_at_the_saturation_pressure_a_sensor_reads_half_and_never_less_when_pressed_more():
    """A linear sensor with this gain would read 800 counts there."""
    pressure = sensor.SATURATION * sensor.SENSITIVITY
    options = {"gain": np.full(COUNT, 800 / pressure), "baseline": np.zeros(COUNT)}
    counts = read(np.linspace(0, 10, 101) * pressure, "saturation", **options)[:, 0]
    expected = np.rint([80 / 1.1, 400, 600, 8000 / 11])
    np.testing.assert_array_equal(counts[[1, 10, 30, 100]], expected)
    assert (np.diff(counts) >= 0).all()


def test_counts_are_integers_of_ten_bits_and_510_where_no_sensor_is():
    pressure = np.zeros((2, 3, COUNT))
    pressure[0] = 1e9
    pressure[1, :, ::2] = -1e9
    frames = frames_of(pressure)
    has_sensor = np.zeros((32, 32), dtype=bool)
    has_sensor[HAND.row, HAND.column] = True
    assert frames.shape == (2, 3, 32, 32)
    assert frames.dtype == np.int16
    assert has_sensor.sum() == 548
    assert (frames[:, :, ~has_sensor] == sensor.NO_SENSOR).all()
    assert sensor.MAX_COUNT == 1023
    assert (frames[0][:, has_sensor] == sensor.MAX_COUNT).all()
    expected = np.where(pressure[1] < 0, 0, 100)
    np.testing.assert_array_equal(frames[1][:, HAND.row, HAND.column], expected)


def test_hysteresis_by_hand():
    pressure = np.array([100.0, 40.0, 0.0, 0.0])
    # the peak fades, but stays above the second pressure, 40
    peak = 100 * sensor.RECOVERY ** np.arange(4.0)
    expected = pressure + sensor.HYSTERESIS * (peak - pressure)
    np.testing.assert_array_equal(read(pressure, "hysteresis")[:, 0], np.rint(expected))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 100))
def test_crosstalk_is_what_a_double_loop_over_rows_and_columns_gives(seed):
    pressure = np.random.default_rng(seed).uniform(0, 400, COUNT)
    frame = np.full((32, 32), np.nan)
    frame[HAND.row, HAND.column] = pressure
    expected = frame.copy()
    for row in range(32):
        for column in range(32):
            if not np.isnan(frame[row, column]):
                expected[row, column] += sensor.CROSSTALK[0] * np.nanmean(frame[row])
                expected[row, column] += sensor.CROSSTALK[1] * np.nanmean(frame[:, column])
    counts = read(pressure[None], "crosstalk")[0]
    np.testing.assert_allclose(counts, expected[HAND.row, HAND.column], atol=0.5 + 1e-6)


def test_dead_sensors_never_move_and_stuck_ones_neither(monkeypatch):
    monkeypatch.setattr(sensor, "DEAD", 0.05)
    monkeypatch.setattr(sensor, "STUCK", 0.05)
    effects = frozenset(["defects", "saturation", "hysteresis"])
    glove = Sensors(HAND, 0, [0], [stream(0, "noise")], effects)
    dead = glove.gain[0] == 0
    stuck = np.isfinite(glove.stuck[0])
    assert 10 < dead.sum() < 50
    assert 10 < stuck.sum() < 50
    assert not (dead & stuck).any()
    pressure = np.random.default_rng(0).uniform(0, 1e5, (1, 30, COUNT))
    counts = glove.read(pressure, FLAT)[0][:, HAND.row, HAND.column]
    moves = np.ptp(counts, axis=0) > 0
    assert not moves[dead | stuck].any()
    assert moves[~dead & ~stuck].mean() > 0.95
    of_dead = np.rint(glove.baseline[0, dead])
    np.testing.assert_array_equal(counts[:, dead], np.tile(of_dead, (30, 1)))
    of_stuck = np.rint(glove.baseline + glove.stuck)[0, stuck]
    np.testing.assert_array_equal(counts[:, stuck], np.tile(of_stuck, (30, 1)))
