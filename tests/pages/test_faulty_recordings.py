"""Recordings with a known fault, as `inspect` shows them: it names the faulty recordings only."""

import warnings

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.cli import cli

OBJECTS = ("ball", "mug", "pen")
NAMES = [f"s{number}" for number in range(6)]


def sound(rng, label, *, frames=60):
    """Return a recording (T, 6); two sensors of the object are pressed in the middle."""
    readings = 500 + rng.normal(0, 1, (frames, 6))
    readings[frames // 4 : frames // 4 * 3, 2 * label : 2 * label + 2] += rng.uniform(20, 60, 2)
    return readings


def unchanged(readings, label, number):
    return {}


def frozen(readings, label, number):
    if label == 1:
        readings[:] = readings[0]


def frozen_later(readings, label, number):
    if label == 1:
        readings[20:] = readings[20]


def loose_cable(readings, label, number):
    if label == 1:
        readings[:, 3] = 0


def padded(readings, label, number):
    if label == 1:
        readings[45:] = 0


def padded_before(readings, label, number):
    if label == 1:
        readings[:15] = readings[15]


def in_volts(readings, label, number):
    if label == 1:
        readings *= 3.3 / 1023


def amplified(readings, label, number):
    if label == 1:
        readings *= 16


#: The fault of all recordings of the mug, and what is named.
FAULTS = {
    frozen: "mug/0",
    frozen_later: "mug/0",
    loose_cable: "s3",
    padded: "mug/0",
    padded_before: "mug/0",
    in_volts: "mug/0",
    amplified: "mug/0",
}


def rigidity(label, number, frames):
    return {"rigidity": np.full(frames, [0.1, 5.5, 0.7][label])}


def one_hot(label, number, frames):
    return {f"is_{name}": np.full(frames, int(each == label)) for each, name in enumerate(OBJECTS)}


def tells_nothing(label, number, frames):
    return {"slipped": np.full(frames, number % 2)}


def sequence(label, number, frames):
    return {"packet": 100 * ((7 * number + 5 * label) % 11) + np.arange(frames)}


def since_the_start(label, number, frames):
    steps = np.random.default_rng(number).exponential(0.02, frames)
    steps[0] = 0
    return {"tRel": np.cumsum(steps)}


COLUMNS = {rigidity: "rigidity", one_hot: "is_ball", tells_nothing: "slipped", sequence: "packet"}
COLUMNS[since_the_start] = "tRel"


def inspected(folder):
    """Return what `inspect` prints of a folder, in one line, without the command."""
    result = CliRunner().invoke(cli, ["inspect", str(folder)], catch_exceptions=False)
    assert result.exit_code == 0
    return " ".join(result.output.partition("To use")[0].split())


def saved(folder, fault=unchanged, columns=None):
    """Write eighteen recordings with that fault, as tables in a folder for each object."""
    rng = np.random.default_rng(0)
    for label, name in enumerate(OBJECTS):
        (folder / name).mkdir(parents=True)
        for number in range(6):
            readings = sound(rng, label)
            fault(readings, label, number)
            table = pd.DataFrame(readings.round(2), columns=NAMES)
            if columns:
                table = table.assign(**columns(label, number, len(table)))
            table.to_csv(folder / name / f"{number}.csv", index=False)
    return folder


def test_of_sound_recordings_nothing_is_named_and_nothing_is_promised(tmp_path):
    text = inspected(saved(tmp_path / "glove"))
    assert "Yes" not in text and "mug/" not in text and "s3" not in text
    assert "augmented" in text


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_what_is_faulty_in_readings_is_named(fault, tmp_path):
    text = inspected(saved(tmp_path / "glove", fault))
    assert FAULTS[fault] in text and "ball/" not in text and "pen/" not in text


def dead(readings, label, number):
    readings[:, 3] = 512


def test_a_channel_that_reads_the_same_everywhere_is_named(tmp_path):
    text = inspected(saved(tmp_path / "glove", dead))
    assert "5 of 6 sensors vary; s3 reads the same in all frames" in text


@pytest.mark.parametrize("columns", COLUMNS, ids=lambda columns: columns.__name__)
def test_columns_that_are_no_sensor_are_named_with_the_change_that_leaves_them_out(
    columns, tmp_path
):
    text = inspected(saved(tmp_path / "glove", columns=columns))
    assert f"leave_out:{COLUMNS[columns]}" in text.replace(' "', '"').replace(
        "leave_out: ", "leave_out:"
    )
    assert "leave_out:s" not in text.replace("leave_out:slipped", "")


def test_a_counter_that_is_known_by_its_name_is_no_sensor_and_named(tmp_path):
    def counter(label, number, frames):
        return {".header.seq": 100 * number + np.arange(frames)}

    text = inspected(saved(tmp_path / "glove", columns=counter))
    assert "6 of 6 sensors vary" in text and "('.header.seq') is not a sensor (line number)" in text


@pytest.mark.parametrize("unit", ["ms", "us"])
def test_times_in_another_unit_than_seconds_are_asked_about(unit, tmp_path):
    factor = {"ms": 1e3, "us": 1e6}[unit]

    def times(label, number, frames):
        return {"timestamp": factor * np.arange(frames) / 50}

    assert "time_ms" in inspected(saved(tmp_path / "glove", columns=times))


def windows(rng):
    """Return windows (40, 4) that overlap by half, of three wandering recordings of each object,
    and their objects.
    """
    parts, labels = [], []
    for name in OBJECTS:
        for _ in range(3):
            readings = 500 + np.cumsum(rng.normal(0, 2, (220, 4)), axis=0)
            parts += [readings[start : start + 40].round(2) for start in range(0, 181, 20)]
            labels += [name] * 10
    return parts, labels


def test_overlapping_windows_are_named_and_count_as_the_recording_that_they_are_of(tmp_path):
    for number, (part, name) in enumerate(zip(*windows(np.random.default_rng(0)), strict=True)):
        (tmp_path / name).mkdir(exist_ok=True)
        pd.DataFrame(part, columns=NAMES[:4]).to_csv(
            tmp_path / name / f"{number:03d}.csv", index=False
        )
    text = inspected(tmp_path)
    assert "ball/001" in text and "Each object has 3 recordings" in text


def test_fit_warns_of_overlapping_windows():
    parts, labels = windows(np.random.default_rng(0))
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        TactileClassifier(system="kernel").fit(parts, labels)
    assert any("X[1]" in str(warning.message) for warning in seen)
