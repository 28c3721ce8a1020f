"""`inspect` names recordings with a known fault, and no sound ones."""

import warnings

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.cli import cli

OBJECTS = ("ball", "mug", "pen")
NAMES = ["s0", "s1", "s2", "s3", "s4", "s5"]


def sound(rng, label, *, frames=60):
    """Return a recording (T, 6). Two sensors of the object are pressed in the middle."""
    readings = 500 + rng.normal(0, 1, (frames, 6))
    readings[frames // 4 : frames // 4 * 3, 2 * label : 2 * label + 2] += rng.uniform(20, 60, 2)
    return readings


def unchanged(readings, label, index):
    return {}


def frozen(readings, label, index):
    if label == 1:
        readings[:] = readings[0]


def frozen_later(readings, label, index):
    if label == 1:
        readings[20:] = readings[20]


def loose_cable(readings, label, index):
    if label == 1:
        readings[:, 3] = 0


def padded(readings, label, index):
    if label == 1:
        readings[45:] = 0


def padded_before(readings, label, index):
    if label == 1:
        readings[:15] = readings[15]


def in_volts(readings, label, index):
    if label == 1:
        readings *= 3.3 / 1023


def amplified(readings, label, index):
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


def rigidity(label, index, frames):
    return {"rigidity": np.full(frames, [0.1, 5.5, 0.7][label])}


def one_hot(label, index, frames):
    return {f"is_{name}": np.full(frames, int(name == OBJECTS[label])) for name in OBJECTS}


def tells_nothing(label, index, frames):
    return {"slipped": np.full(frames, index % 2)}


def sequence(label, index, frames):
    return {"packet": 100 * ((7 * index + 5 * label) % 11) + np.arange(frames)}


def since_the_start(label, index, frames):
    steps = np.random.default_rng(index).exponential(0.02, frames)
    steps[0] = 0
    return {"tRel": np.cumsum(steps)}


#: Columns that are no sensor, and a name that is printed.
COLUMNS = {
    rigidity: "rigidity",
    one_hot: "is_ball",
    tells_nothing: "slipped",
    sequence: "packet",
    since_the_start: "tRel",
}


def inspected(folder):
    """Return what `inspect` prints of a folder, in one line, without the command."""
    result = CliRunner().invoke(cli, ["inspect", str(folder)], catch_exceptions=False)
    assert result.exit_code == 0
    return " ".join(result.output.partition("To use")[0].split())


def saved(folder, fault=unchanged, columns=None):
    """Write six recordings of each object as tables, and return their folder.

    Args:
        folder: where the recordings are written.
        fault: function that changes readings (T, 6) in place.
        columns: function that returns more columns.
    """
    rng = np.random.default_rng(0)
    for label, name in enumerate(OBJECTS):
        (folder / name).mkdir(parents=True)
        for index in range(6):
            readings = sound(rng, label)
            fault(readings, label, index)
            table = pd.DataFrame(readings.round(2), columns=NAMES)
            if columns:
                table = table.assign(**columns(label, index, len(table)))
            table.to_csv(folder / name / f"{index}.csv", index=False)
    return folder


def test_of_sound_recordings_nothing_is_named_and_nothing_is_promised(tmp_path):
    text = inspected(saved(tmp_path / "glove"))
    assert "Yes" not in text
    assert "mug/" not in text
    assert "s3" not in text
    assert "augmented" in text


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_what_is_faulty_in_readings_is_named(fault, tmp_path):
    text = inspected(saved(tmp_path / "glove", fault))
    assert FAULTS[fault] in text
    assert "ball/" not in text
    assert "pen/" not in text


def dead(readings, label, index):
    readings[:, 3] = 512


def test_a_channel_that_reads_the_same_everywhere_is_named(tmp_path):
    text = inspected(saved(tmp_path / "glove", dead))
    assert "5 of 6 sensors vary; s3 reads the same in all frames" in text


@pytest.mark.parametrize("columns", COLUMNS, ids=lambda columns: columns.__name__)
def test_columns_that_are_no_sensor_are_named_with_the_change_that_leaves_them_out(
    columns, tmp_path
):
    text = inspected(saved(tmp_path / "glove", columns=columns))
    joined = text.replace(' "', '"').replace("leave_out: ", "leave_out:")  # without line breaks
    assert f"leave_out:{COLUMNS[columns]}" in joined
    assert "leave_out:s" not in text.replace("leave_out:slipped", "")


def test_a_counter_that_is_known_by_its_name_is_no_sensor_and_named(tmp_path):
    def counter(label, index, frames):
        return {".header.seq": 100 * index + np.arange(frames)}

    text = inspected(saved(tmp_path / "glove", columns=counter))
    assert "6 of 6 sensors vary" in text
    assert "('.header.seq') is not a sensor (line number)" in text


@pytest.mark.parametrize("unit", ["ms", "us"])
def test_times_in_another_unit_than_seconds_are_asked_about(unit, tmp_path):
    factor = {"ms": 1e3, "us": 1e6}[unit]

    def times(label, index, frames):
        return {"timestamp": factor * np.arange(frames) / 50}

    assert "time_ms" in inspected(saved(tmp_path / "glove", columns=times))


def windows(rng):
    """Return windows (40, 4) that overlap by half, and the name of each window's object.

    Each object has three recordings, whose readings wander.
    """
    parts = []
    labels = []
    for name in OBJECTS:
        for _ in range(3):
            readings = 500 + np.cumsum(rng.normal(0, 2, (220, 4)), axis=0)
            parts += [readings[start : start + 40].round(2) for start in range(0, 181, 20)]
            labels += [name] * 10
    return parts, labels


def test_overlapping_windows_are_named_and_count_as_the_recording_that_they_are_of(tmp_path):
    for index, (part, name) in enumerate(zip(*windows(np.random.default_rng(0)), strict=True)):
        (tmp_path / name).mkdir(exist_ok=True)
        table = pd.DataFrame(part, columns=NAMES[:4])
        table.to_csv(tmp_path / name / f"{index:03d}.csv", index=False)
    text = inspected(tmp_path)
    assert "ball/001" in text and "Each object has 3 recordings" in text


def test_fit_warns_of_overlapping_windows():
    parts, labels = windows(np.random.default_rng(0))
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        TactileClassifier(system="kernel").fit(parts, labels)
    assert any("X[1]" in str(warning.message) for warning in seen)
