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
from tactile_viewgcn.frames.baseline import (
    ROUNDING_SD,
    measure_baseline,
    session_moments,
    trimmed_moments,
)
from tactile_viewgcn.frames.filter import pressed_frames
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

    The counts take the place of the counts in the small table, or in another table.
    """
    mean = table().baseline_mean[:1] if baseline is None else baseline
    columns = pd.DataFrame({"baseline": np.zeros(len(counts), dtype=int)})
    frames = replace(table(), counts=counts, columns=columns, baseline_mean=mean)
    frames = with_settings(frames, transform=transform)
    excess = counts.astype(np.float64) - mean.astype(np.float64)
    exact = (
        np.clip(excess / frames.scale, 0, 1)
        if transform == "clip"
        else np.log1p(np.maximum(excess, 0))
    )
    return max_rel_error(frames.inputs(np.arange(len(exact))), exact)


def exact_moments(counts):
    """Return the mean and standard deviation (H, W) of counts (T, H, W), by exact sums."""
    columns = [[float(x) for x in column] for column in counts.reshape(len(counts), -1).T]
    means = [math.fsum(column) / len(column) for column in columns]
    pairs = zip(columns, means, strict=True)
    spreads = [
        math.sqrt(math.fsum((x - mean) ** 2 for x in column) / len(column))
        for column, mean in pairs
    ]
    return tuple(np.array(values).reshape(counts.shape[1:]) for values in (means, spreads))


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
    off = np.abs(mean - exact).max() / np.spacing(float(offset))
    row(f"mean baseline, in last digits of the offset, {name}", off, 1)
    row(f"noise of the baseline, {name}", max_rel_error(noise, spread), ROUNDING)
    pressed = np.concatenate([counts, counts, counts + kind(120)])
    recordings = written(tmp_path / "t", pressed, object=np.arange(1200) // 400)
    baseline = measure_baseline(recordings, PARAMS.preprocess, session_moments(recordings)).mean
    row(f"network input, {name}", input_error(pressed, baseline), ROUNDING)


@pytest.mark.stability("a million frames of drift")
def test_a_baseline_that_drifts_over_a_million_frames(row):
    drift = BASELINE + np.arange(10**6) // 10**4
    counts = (
        np.stack([drift, 2 * drift - 300, 30 * drift, -drift], axis=1)
        .reshape(-1, 2, 2)
        .astype(np.int16)
    )
    (mean, noise), (exact, spread) = trimmed_moments(counts), exact_moments(counts)
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
    quiet, pressed = np.full((20, 3, 3), 500), np.repeat([0, 1, 2, 3, 40], 4)
    quiet[::3, 2, 2] += 1  # only one sensor has noise
    touched = np.broadcast_to(500 + pressed[:, None, None], (20, 3, 3))
    counts = (unit * np.concatenate([quiet, touched])).astype(kind)
    recordings = written(tmp_path / "t", counts, object=np.arange(40) // 20)
    baseline = measure_baseline(recordings, PARAMS.preprocess, session_moments(recordings))
    contact = pressed_frames(recordings, baseline, 8)
    noise = baseline.noise.ravel()[:8]
    row(
        f"noise of the baseline, {name}", max_rel_error(noise, np.full(8, ROUNDING_SD * unit)), 1e-4
    )
    row(f"frames in contact, {name}", share_different(contact[20:], pressed > 5 * ROUNDING_SD))


def prepared(path, counts, **columns):
    """Return the frames of recordings (R, T, H, W) with different names; folds are recordings."""
    recording = np.repeat(np.arange(len(counts)), counts.shape[1])
    recordings = written(
        path, counts.reshape(-1, *counts.shape[2:]), recording=recording, **columns
    )
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


def two_grasped_objects():
    """Return readings (R, T, 8, 8) around 0 of six recordings.

    Each is a grasp of one of two objects, with an open hand before and after it.
    """
    rng = np.random.default_rng(0)
    readings = rng.normal(0, 1, (6, 24, 8, 8)) - 40
    for number, grasp in enumerate(readings):
        grasp[7:18, 4 * (number % 2) : 4 * (number % 2) + 4] += rng.uniform(40, 80, (11, 4, 8))
    return readings


def automatic(path, readings):
    """Return the values that replace `auto`, and the network input, for recordings from files.

    Six arrays are alternately of the mug and of the ball. Their table is in the order of their
    names.
    """
    path.mkdir()
    for number, counts in enumerate(np.reshape(readings, (6, -1, 8, 8))):
        folder = path / "source" / ("mug", "ball")[number % 2]
        folder.mkdir(parents=True, exist_ok=True)
        np.save(folder / f"{number}.npy", counts)
    recordings = read_here(path / "source", path / "table")
    params = recipe("split.by=recording", "split.folds=3")
    made = preprocess_recordings(recordings, params.preprocess, params.split)
    chosen = {note.key: note.value for note in made.choice.notes}
    return chosen, made.frames.inputs(np.arange(len(made.frames.label)))


@pytest.mark.stability("readings far from one")
@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_what_is_recommended_and_the_network_input_do_not_depend_on_the_unit(row, tmp_path, kind):
    """Settings other than the scale are the same in every unit.

    The reference is multiplied by 1e3, since the released scale does not fit such readings.
    """
    chosen, expected = automatic(tmp_path / "reference", (1e3 * two_grasped_objects()).astype(kind))
    for number, factor in enumerate((1e-30, 1e-20, 1e20, 8e27)):
        of_unit, inputs = automatic(
            tmp_path / f"{number}", (factor * two_grasped_objects()).astype(kind)
        )
        others = [
            key for key in chosen if of_unit.get(key) != chosen[key] and key != "preprocess.scale"
        ]
        row(
            f"settings that differ, {factor:g} times, {kind.__name__}",
            len(others),
            0,
            ", ".join(others),
        )
        ratio = of_unit["preprocess.scale"] / factor / (chosen["preprocess.scale"] / 1e3)
        row(f"scale in the unit, {factor:g} times, {kind.__name__}", abs(ratio - 1), 1e-6)
        row(
            f"network input, {factor:g} times, {kind.__name__}",
            max_rel_error(inputs, expected),
            2 * ROUNDING,
        )


@pytest.mark.stability("readings far from one")
@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (
            1e-300,
            "no sensor varies by more than .*e-299; expected 1e-30 or more: rescale the readings",
        ),
        (
            2e28,
            "strongest hundredth of the sensors in contact .* expected 1e-30 to 1e.30: "
            "rescale the readings",
        ),
        (1e30, r"expected real numbers from -1e\+30 to 1e\+30"),
    ],
)
def test_readings_for_which_params_has_no_scale_are_refused(row, tmp_path, factor, message):
    readings = factor * two_grasped_objects()
    row.refused(f"readings {factor:g} times", lambda: automatic(tmp_path / "t", readings), message)


@pytest.mark.stability("the ends of 16 bits")
def test_the_least_and_the_most_that_16_bits_hold_are_65_535_apart(row, tmp_path):
    lowest, highest = np.iinfo(np.int16).min, np.iinfo(np.int16).max
    counts = np.full((6, 24, 8, 8), lowest)
    counts += np.random.default_rng(0).integers(0, 3, counts.shape)
    for number, grasp in enumerate(counts):
        grasp[7:18, 4 * (number % 2) : 4 * (number % 2) + 4] = highest - number
    chosen, inputs = automatic(tmp_path / "t", counts.astype(np.int16))
    row(
        "scale",
        abs(chosen["preprocess.scale"] / (highest - lowest) - 1),
        0.02,
        f"{chosen['preprocess.scale']:g}",
    )
    row("network input out of [0, 1]", float(((inputs < 0) | (inputs > 1)).sum()))
    row("sensors that read neither 0 nor 1", float(((inputs > 1e-4) & (inputs < 0.99)).mean()))
