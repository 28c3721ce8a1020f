"""Frames and recordings at their extremes: baseline, filter, network input, and refused data.

Sums are compared with `math.fsum`, which rounds only once. Network input is compared with the
transform in float64.
"""

import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from benchmarks.stability.rows import max_rel_error, share_different
from tactile_viewgcn.frames.baseline import measure_baseline
from tactile_viewgcn.frames.filter import pressed_frames
from tactile_viewgcn.frames.moments import ROUNDING_SD, session_moments, trimmed_moments
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tests.glove_data import recipe, table, with_settings, written
from tests.readers.files import read_here
from tests.trained_network import unusual_counts

ROUNDING = 2.0**-22  # two rounding errors of single precision
BASELINE = 500
PARAMS = recipe(
    "preprocess.baseline=empty_hand", "preprocess.filter=contact", "preprocess.contact_sensors=1",
    "preprocess.transform=clip", "preprocess.scale=150",
    "preprocess.empty_hand_class=true", "split.by=recording", "split.folds=2", "split.fold=0",
    "cluster.scope=object", "cluster.assignment=index",
)  # fmt: skip


def input_error(counts, baseline=None, transform="clip"):
    """Return the error of the network input of counts (n, H, W) above a baseline (1, H, W).

    The counts take the place of the counts in the small table. Without a baseline its first one is
    subtracted.
    """
    if baseline is None:
        baseline = table().baseline_mean[:1]
    columns = pd.DataFrame({"baseline": np.zeros(len(counts), dtype=int)})
    frames = replace(table(), counts=counts, columns=columns, baseline_mean=baseline)
    frames = with_settings(frames, transform=transform)
    excess = counts.astype(np.float64) - baseline.astype(np.float64)
    if transform == "clip":
        exact = np.clip(excess / frames.scale, 0, 1)
    else:
        exact = np.log1p(np.maximum(excess, 0))
    return max_rel_error(frames.inputs(np.arange(len(exact))), exact)


def exact_moments(counts):
    """Return the mean and standard deviation (H, W) of counts (T, H, W), by exact sums."""
    means = np.zeros(counts.shape[1:])
    spreads = np.zeros(counts.shape[1:])
    for sensor in np.ndindex(means.shape):
        readings = [float(reading) for reading in counts[:, *sensor]]
        mean = math.fsum(readings) / len(readings)
        squares = math.fsum((reading - mean) ** 2 for reading in readings)
        means[sensor] = mean
        spreads[sensor] = math.sqrt(squares / len(readings))
    return means, spreads


@pytest.mark.stability("unusual frames")
def test_network_input_of_frames_that_no_hand_makes(row):
    for name, counts in unusual_counts(table().baseline_mean[0]).items():
        for transform, suffix in (("clip", ""), ("log", ", log")):
            error = input_error(counts[None].astype(np.int16), transform=transform)
            row(f"network input, {name}{suffix}", error, ROUNDING)


@pytest.mark.stability("a large offset")
@pytest.mark.parametrize(
    ("name", "offset", "kind"),
    [("32-bit counts", 10**9, np.int32), ("real numbers", 1e9 + 1 / 3, np.float64)],
)
def test_a_signal_in_the_last_digits_of_a_billion(row, tmp_path, name, offset, kind):
    counts = (offset + np.random.default_rng(0).integers(-3, 4, (400, 2, 2))).astype(kind)
    mean, noise = trimmed_moments(counts)
    exact, spread = exact_moments(counts)
    last_digits = np.abs(mean - exact).max() / np.spacing(float(offset))
    row(f"mean baseline, in last digits of the offset, {name}", last_digits, 1)
    row(f"noise of the baseline, {name}", max_rel_error(noise, spread), ROUNDING)
    pressed = np.concatenate([counts, counts, counts + kind(120)])
    recordings = written(tmp_path / "t", pressed, object=np.arange(1200) // 400)
    baseline = measure_baseline(recordings, PARAMS.preprocess, session_moments(recordings)).mean
    row(f"network input, {name}", input_error(pressed, baseline), ROUNDING)


@pytest.mark.stability("a million frames of drift")
def test_a_baseline_that_drifts_over_a_million_frames(row):
    drift = BASELINE + np.arange(10**6) // 10**4
    sensors = [drift, 2 * drift - 300, 30 * drift, -drift]
    counts = np.stack(sensors, axis=1).reshape(-1, 2, 2).astype(np.int16)
    mean, noise = trimmed_moments(counts)
    exact, spread = exact_moments(counts)
    row("mean baseline", max_rel_error(mean, exact), ROUNDING)
    row("noise of the baseline", max_rel_error(noise, spread), ROUNDING)


@pytest.mark.stability("a sensor without noise")
@pytest.mark.parametrize(
    ("name", "kind", "unit"),
    [("counts", np.int16, 1), ("real numbers", np.float32, 0.1), ("volts", np.float64, 5 / 1023)],
)
def test_of_a_sensor_without_noise_one_count_more_is_noise_and_two_are_contact(
    row, tmp_path, name, kind, unit
):
    quiet = np.full((20, 3, 3), 500)
    quiet[::3, 2, 2] += 1  # only one sensor has noise
    pressed = np.repeat([0, 1, 2, 3, 40], 4)
    touched = np.broadcast_to(500 + pressed[:, None, None], (20, 3, 3))
    counts = (unit * np.concatenate([quiet, touched])).astype(kind)
    recordings = written(tmp_path / "t", counts, object=np.arange(40) // 20)
    baseline = measure_baseline(recordings, PARAMS.preprocess, session_moments(recordings))
    contact = pressed_frames(recordings, baseline, 8)
    noise = baseline.noise.ravel()[:8]
    noise_error = max_rel_error(noise, np.full(8, ROUNDING_SD * unit))
    row(f"noise of the baseline, {name}", noise_error, 1e-4)
    row(f"frames in contact, {name}", share_different(contact[20:], pressed > 5 * ROUNDING_SD))


def prepared(path, counts, **columns):
    """Return the frames of recordings (R, T, H, W) with different names; folds are recordings."""
    recording = np.repeat(np.arange(len(counts)), counts.shape[1])
    frames = counts.reshape(-1, *counts.shape[2:])
    recordings = written(path, frames, recording=recording, **columns)
    return preprocess_recordings(recordings, PARAMS.preprocess, PARAMS.split).frames


@pytest.mark.stability("sensors that never change")
@pytest.mark.parametrize("reading", [0, 1023])
def test_sensors_that_never_change_are_refused(row, tmp_path, reading):
    columns = {"object": np.repeat([0, 1, 1], 30)}
    counts = np.full((3, 30, 4, 4), reading)
    row.refused(
        f"all counts {reading}",
        lambda: prepared(tmp_path / "t", counts, **columns),
        "no sensor varies",
    )


def pressed_rows(index):
    """Return which rows of sensors are pressed in a recording.

    Objects alternate from recording to recording.
    """
    return slice(0, 4) if index % 2 == 0 else slice(4, 8)


def two_grasped_objects():
    """Return readings (R, T, 8, 8) around 0 of six recordings.

    Each is a grasp of one of two objects, with an open hand before and after it.
    """
    rng = np.random.default_rng(0)
    readings = rng.normal(0, 1, (6, 24, 8, 8)) - 40
    for index, recording in enumerate(readings):
        recording[7:18, pressed_rows(index)] += rng.uniform(40, 80, (11, 4, 8))
    return readings


def automatic(path, readings):
    """Return the values that replace `auto`, and the network input, for recordings from files.

    Six arrays are alternately of the mug and of the ball. Their table is in the order of their
    names.
    """
    path.mkdir()
    for index, counts in enumerate(np.reshape(readings, (6, -1, 8, 8))):
        folder = path / "source" / ("mug", "ball")[index % 2]
        folder.mkdir(parents=True, exist_ok=True)
        np.save(folder / f"{index}.npy", counts)
    recordings = read_here(path / "source", path / "table")
    params = recipe("split.by=recording", "split.folds=3")
    result = preprocess_recordings(recordings, params.preprocess, params.split)
    chosen = {note.key: note.value for note in result.choice.notes}
    return chosen, result.frames.inputs(np.arange(len(result.frames.label)))


@pytest.mark.stability("readings far from one")
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_what_is_recommended_and_the_network_input_do_not_depend_on_the_unit(row, tmp_path, kind):
    """Settings other than the scale are the same in every unit.

    The reference is multiplied by 1e3, since the released scale does not fit such readings.
    """
    chosen, expected = automatic(tmp_path / "reference", (1e3 * two_grasped_objects()).astype(kind))
    for index, factor in enumerate((1e-30, 1e-20, 1e20, 8e27)):
        readings = (factor * two_grasped_objects()).astype(kind)
        of_unit, inputs = automatic(tmp_path / f"{index}", readings)
        unit = f"{factor:g} times, {kind.__name__}"
        others = [key for key in chosen if key != "preprocess.scale"]
        differing = [key for key in others if of_unit.get(key) != chosen[key]]
        row(f"settings that differ, {unit}", len(differing), 0, ", ".join(differing))
        ratio = of_unit["preprocess.scale"] / factor / (chosen["preprocess.scale"] / 1e3)
        row(f"scale in the unit, {unit}", abs(ratio - 1), 1e-6)
        row(f"network input, {unit}", max_rel_error(inputs, expected), 2 * ROUNDING)


TOO_SMALL = "no sensor varies by more than .*e-299; expected 1e-30 or more: rescale the readings"
TOO_LARGE = (
    "strongest hundredth of the sensors in contact .* expected 1e-30 to 1e.30: rescale the readings"
)


@pytest.mark.stability("readings far from one")
@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (1e-300, TOO_SMALL),
        (2e28, TOO_LARGE),
        (1e30, r"expected real numbers from -1e\+30 to 1e\+30"),
    ],
)
def test_readings_for_which_params_has_no_scale_are_refused(row, tmp_path, factor, message):
    readings = factor * two_grasped_objects()
    row.refused(f"readings {factor:g} times", lambda: automatic(tmp_path / "t", readings), message)


@pytest.mark.stability("the ends of 16 bits")
def test_the_least_and_the_most_that_16_bits_hold_are_65_535_apart(row, tmp_path):
    lowest = np.iinfo(np.int16).min
    highest = np.iinfo(np.int16).max
    counts = np.full((6, 24, 8, 8), lowest)
    counts += np.random.default_rng(0).integers(0, 3, counts.shape)
    for index, recording in enumerate(counts):
        recording[7:18, pressed_rows(index)] = highest - index
    chosen, inputs = automatic(tmp_path / "t", counts.astype(np.int16))
    scale = chosen["preprocess.scale"]
    row("scale", abs(scale / (highest - lowest) - 1), 0.02, f"{scale:g}")
    outside = (inputs < 0) | (inputs > 1)
    row("network input out of [0, 1]", float(outside.sum()))
    between = (inputs > 1e-4) & (inputs < 0.99)
    row("sensors that read neither 0 nor 1", float(between.mean()))
