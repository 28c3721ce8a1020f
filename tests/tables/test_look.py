"""A look finds frames in common, sensors that stand still, equal ends and another unit.

It gives no false alarm. The recordings of channels or of an array are made here, so it is known
which of them are faulty.
"""

import warnings

import numpy as np
import pandas as pd
import pytest

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.frames.split import split_groups
from tactile_viewgcn.messages import warnings_of
from tactile_viewgcn.tables.look import groups_together, held_together, look_at, write_takes
from tactile_viewgcn.tables.recordings import Recordings
from tactile_viewgcn.tables.remarks import remarks
from tests.glove_data import of_arrays, written

OBJECTS = ["ball", "mug", "pen"]
TOPICS = {"copies", "shared frames", "standing still", "equal ends", "unit"}


def table_of(arrays, labels=None):
    """Return the table of recordings (T, C) or (T, H, W).

    They are of three objects in turn, or have the given labels.
    """
    if labels is None:
        labels = np.arange(len(arrays)) % 3
    labels = np.array(labels)
    frames = [array if np.ndim(array) == 3 else np.asarray(array)[:, None] for array in arrays]
    return of_arrays(frames, OBJECTS, labels, np.zeros(len(arrays), dtype=int))


def warned(recordings):
    """Return the texts of the warnings after a look, by topic."""
    notes = warnings_of(remarks(recordings, look_at(recordings)))
    return {note.topic: note.text for note in notes if note.topic in TOPICS}


def counts(seed, *, recordings=12, frames=40, channels=8):
    """Return recordings (T, C) of readings about 500 with noise, pressed from the tenth frame on.

    The second object is pressed twice as hard as the first, and the third three times as hard.
    """
    rng = np.random.default_rng(seed)
    arrays = [500 + rng.normal(0, 1, (frames, channels)) for _ in range(recordings)]
    for index, array in enumerate(arrays):
        array[10:] += rng.uniform(20, 60, channels) * (1 + index % 3)
    return arrays


def walk(seed, frames, channels, step=2.0):
    """Return a recording (T, C) that wanders slowly."""
    rng = np.random.default_rng(seed)
    return 500 + np.cumsum(rng.normal(0, step, (frames, channels)), axis=0)


def windows(arrays, length, step):
    """Return the windows (length, C) of recordings, which begin `step` frames apart."""
    parts = []
    for array in arrays:
        for start in range(0, len(array) - length + 1, step):
            parts.append(array[start : start + length])
    return parts


#: Functions from a seed to readings (T, C), by their kind
READINGS = {
    "real numbers": lambda seed: walk(seed, 220, 8),
    "tenths": lambda seed: walk(seed, 220, 8).round(1),
    "integers": lambda seed: walk(seed, 220, 8).round(),
    "a single channel": lambda seed: walk(seed, 220, 1),
    "a channel that stands still, and noise": lambda seed: np.column_stack(
        [np.zeros(220), walk(seed, 220, 3)]
    ),
}


@pytest.mark.parametrize("kind", READINGS)
def test_windows_that_overlap_are_warned_of_and_held_out_with_the_others_of_their_recording(kind):
    parts = windows([READINGS[kind](seed) for seed in range(6)], 40, 20)
    whole = np.repeat(np.arange(6), 10)  # the long recording that each part is of
    recordings = table_of(parts, whole % 3)
    text = warned(recordings)["shared frames"]
    assert "54 recordings" in text and "and 51 more. " in text
    look = look_at(recordings)
    columns = held_together(recordings, look).columns
    groups = pd.Series(split_groups(columns, "recording")).groupby(columns["recording"]).first()
    assert (pd.crosstab(groups, whole) > 0).sum(axis=1).eq(1).all()
    assert groups.nunique() == 6


@pytest.mark.parametrize("rate", [1 / 50, -1 / 50])
def test_windows_with_a_clock_of_their_own_are_known_by_the_other_readings(rate):
    parts = windows([walk(seed, 220, 8) for seed in range(6)], 40, 20)
    clocked = [np.column_stack([part, rate * np.arange(40)]) for part in parts]
    labels = np.repeat(np.arange(6), 10) % 3
    assert "54 recordings" in warned(table_of(clocked, labels))["shared frames"]


@pytest.mark.parametrize("length", [12, 20, 40])
def test_short_windows_of_slow_sensors_are_known_though_a_sensor_only_rises_in_some(length):
    time = np.arange(220)
    rng = np.random.default_rng(0)
    waves = [np.sin(time[:, None] / rng.uniform(8, 30, 6) + rng.uniform(0, 6, 6)) for _ in range(6)]
    parts = windows([100 * wave for wave in waves], length, length // 2)
    labels = np.repeat(np.arange(6), len(parts) // 6) % 3
    text = warned(table_of(parts, labels))["shared frames"]
    assert f"{len(parts) - 6} recordings" in text


def test_recordings_whose_sensors_only_rise_are_no_copies():
    rng = np.random.default_rng(0)
    rising = [500 + np.cumsum(rng.uniform(0.1, 1, (20, 4)), axis=0) for _ in range(30)]
    assert warned(table_of(rising)) == {}
    falling = [1000 - array for array in rising]
    assert warned(table_of(rising[:15] + falling[15:])) == {}


def test_a_glove_that_froze_is_named_though_its_clock_goes_on():
    arrays = frozen(counts(0), {1, 4}, 0)
    clocked = [np.column_stack([array, np.arange(40) / 50]) for array in arrays]
    text = warned(table_of(clocked))["standing still"]
    assert "2 recordings: X[1], X[4]" in text


def test_windows_that_only_touch_and_recordings_that_are_alike_are_not_warned_of():
    apart = windows([walk(seed, 240, 8) for seed in range(6)], 40, 40)
    assert warned(table_of(apart)) == {}
    assert warned(table_of(counts(0))) == {}


def quantised(seed, *, channels, levels):
    """Return recordings (T, C) of few levels, in which many frames are equal.

    The sensors rest most of the time, and are pressed in the middle.
    """
    rng = np.random.default_rng(seed)
    arrays = []
    for index in range(60):
        force = np.clip(np.sin(np.linspace(-1, 4, 80)), 0, None)[:, None]
        pattern = rng.uniform(0.3, 1, channels) * (np.arange(channels) % 3 != index % 3)
        arrays.append(np.floor(force * pattern * levels))
    return arrays


@pytest.mark.parametrize(("channels", "levels"), [(2, 4), (5, 3), (5, 20), (64, 6), (3, 255)])
def test_equal_frames_of_sensors_with_few_levels_are_chance(channels, levels):
    assert warned(table_of(quantised(0, channels=channels, levels=levels))) == {}


def test_switches_of_fingers_that_close_in_the_same_order_are_no_copies():
    rng = np.random.default_rng(0)
    arrays = []
    for _ in range(200):
        starts = np.sort(rng.integers(5, 30, 5))
        arrays.append((np.arange(40)[:, None] >= starts).astype(int))
    assert warned(table_of(arrays)) == {}


def test_a_resting_hand_whose_noise_has_two_levels_is_no_copy():
    rng = np.random.default_rng(0)
    assert warned(table_of([rng.integers(0, 2, (300, 2)) for _ in range(120)])) == {}


def test_single_frames_of_few_levels_are_no_copies_and_copied_ones_are():
    rng = np.random.default_rng(0)
    few = [rng.integers(0, 4, (1, 5)) for _ in range(300)]
    assert warned(table_of(few)) == {}
    many = [rng.normal(500, 50, (1, 16)) for _ in range(60)]
    text = warned(table_of([*many, many[4], many[7]]))["copies"]
    assert "X[60] repeats X[4]" in text and "X[61] repeats X[7]" in text


def test_a_copy_whose_zeros_have_a_sign_is_a_copy():
    arrays = [np.maximum(array - 501, 0.0) for array in counts(0)]
    arrays.append(np.where(arrays[4] == 0, -0.0, arrays[4]))
    assert "X[12] repeats X[4]" in warned(table_of(arrays))["copies"]


def test_motions_that_each_recording_repeats_are_no_frames_in_common():
    """A machine repeats the same steps. Each recording begins with another step."""
    steps = np.random.default_rng(0).normal(500, 50, (20, 8))
    arrays = [np.tile(np.roll(steps, first, axis=0), (10, 1)) for first in range(9)]
    assert warned(table_of(arrays)) == {}


def test_pieces_under_other_objects_are_named_as_wrong_labels():
    parts = windows([walk(seed, 220, 8) for seed in range(6)], 40, 20)
    assert "of different objects" in warned(table_of(parts))["shared frames"]


def test_pieces_that_the_source_holds_together_are_named_only_as_wrong_labels():
    parts = windows([walk(seed, 220, 8) for seed in range(6)], 40, 20)
    whole = np.repeat(np.arange(6), 10)  # the long recording that each part is of
    labels = whole % 3
    recordings = table_of(parts, labels)
    recordings.columns["take"] = np.repeat(whole, 40)
    assert warned(recordings) == {}
    labels[15] = 2  # a piece of a recording of the mug
    mislabelled = table_of(parts, labels)
    mislabelled.columns["take"] = recordings.columns["take"]
    text = warned(mislabelled)["shared frames"]
    assert "X[15]" in text
    assert "of different objects" in text
    assert "X[14] (" not in text


def test_an_open_hand_that_was_cut_out_as_an_empty_hand_is_no_copy():
    arrays = counts(0)
    labels = [1 + index % 2 for index in range(12)]
    open_hands = [array[:9] for array in arrays]
    recordings = table_of([*arrays, *open_hands], [*labels, *12 * [0]])
    assert "shared frames" in warned(recordings)
    recordings.objects = ["empty_hand", "mug", "pen"]
    assert warned(recordings) == {}


def test_a_table_keeps_what_is_held_out_together(tmp_path):
    whole = np.random.default_rng(0).normal(500, 9, (6, 60, 4, 6))
    parts = windows(whole, 40, 20)
    recording = np.arange(12)
    table = written(
        tmp_path / "t",
        np.concatenate(parts),
        object=np.repeat(recording // 4, 40),
        recording=np.repeat(recording, 40),
        time=np.tile(np.arange(40.0), 12),
    )
    assert "take" not in table.columns
    write_takes(tmp_path / "t", table, look_at(table))
    again = Recordings.read(tmp_path / "t")
    np.testing.assert_array_equal(again.columns["take"], np.repeat(recording // 2 * 2, 40))
    np.testing.assert_array_equal(again.counts, table.counts)
    sound = written(tmp_path / "s", whole.reshape(-1, 4, 6), recording=np.repeat(np.arange(6), 60))
    write_takes(tmp_path / "s", sound, look_at(sound))
    assert "take" not in Recordings.read(tmp_path / "s").columns


def test_groups_of_recordings_with_common_frames_become_one():
    parts = windows([walk(seed, 220, 8) for seed in range(6)], 40, 20)
    recordings = table_of(parts, np.repeat(np.arange(6), 10) % 3)
    recording = recordings.columns["recording"].astype(int)
    groups = groups_together(recordings, look_at(recordings), recording)
    np.testing.assert_array_equal(np.unique(groups, return_inverse=True)[1], recording // 10)
    person = recording // 20  # each person has two of the long recordings
    np.testing.assert_array_equal(groups_together(recordings, look_at(recordings), person), person)
    alike = table_of(counts(0))
    groups = groups_together(alike, look_at(alike), np.arange(480))
    np.testing.assert_array_equal(groups, np.arange(480))


@pytest.mark.parametrize("sessions", [1, 2])
def test_pieces_of_several_sessions_are_said_not_to_be_held_out_by_session(sessions):
    parts = windows([walk(seed, 130, 4) for seed in range(6)], 40, 20)
    number = np.arange(len(parts))
    frames = [part[:, None] for part in parts]
    table = of_arrays(frames, OBJECTS, number // 5 % 3, number % sessions)
    text = warned(table)["shared frames"]
    assert "Pieces of one object are held out together here" in text
    assert ("not by split.by=session" in text) == (sessions == 2)


def test_fit_says_that_windows_overlap():
    parts = windows([walk(seed, 130, 4) for seed in range(6)], 40, 20)
    labels = [OBJECTS[index % 3] for index in np.repeat(np.arange(6), 5)]
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        fitted = TactileClassifier(system="kernel").fit(parts, labels)
    texts = [str(warning.message) for warning in seen]
    assert any("frames of a different one" in text and "`groups`" in text for text in texts)
    assert "shared frames" in {note.topic for note in fitted.notes_}


def frozen(arrays, chosen, frame):
    """Return recordings, of which the chosen ones repeat a frame to their ends."""
    arrays = [array.copy() for array in arrays]
    for index in chosen:
        arrays[index][frame:] = arrays[index][frame]
    return arrays


@pytest.mark.parametrize("dtype", [float, int])
def test_a_frozen_glove_is_named(dtype):
    arrays = [array.astype(dtype) for array in counts(0)]
    text = warned(table_of(frozen(arrays, {1, 4}, 0)))["standing still"]
    assert "X[1]" in text
    assert "X[4]" in text
    assert "X[2]" not in text
    text = warned(table_of(frozen(arrays, {2, 5, 7}, 15)))["equal ends"]
    assert all(f"X[{index}] (the last 25 of 40)" in text for index in (2, 5, 7))
    assert "X[3]" not in text


@pytest.mark.parametrize("value", [0, 500, 1023])
def test_a_dead_cable_in_the_recordings_of_one_object_is_named(value):
    arrays = [array.round() for array in counts(0)]
    for array in arrays[1::3]:
        array[:, 5] = value
    text = warned(table_of(arrays))["standing still"]
    assert "column 6 in all of mug" in text and "column 5" not in text


@pytest.mark.parametrize(("frames", "every"), [(40, 6), (600, 25)])
def test_a_dead_cable_of_a_sensor_that_changes_seldom_is_named(frames, every):
    arrays = [array.round() for array in counts(0, frames=frames)]
    for index, array in enumerate(arrays):
        array[:, 5] = 500 + (index % 3 != 1) * (np.arange(frames) // every % 2)
    assert "column 6 in all of mug" in warned(table_of(arrays))["standing still"]


@pytest.mark.parametrize(("noise", "frames", "side"), [(1, 12, 256), (0.5, 31, 128)])
def test_a_sensor_of_many_that_stands_still_by_chance_is_not_named(noise, frames, side):
    """With a noise of one count, twelve frames of a sensor are equal once in 100,000 recordings."""
    rng = np.random.default_rng(0)
    arrays = rng.normal(500, noise, (12, frames, side, side)).round()
    assert (arrays == arrays[:, :1]).all(axis=1).any()
    assert warned(table_of(arrays)) == {}
    arrays[:, :, 0, 5] = rng.normal(500, 2, (12, frames)).round()
    arrays[1::3, :, 0, 5] = 500
    assert "row 1, column 6 in all of mug" in warned(table_of(arrays))["standing still"]


def test_sensors_that_nothing_touches_in_some_recordings_are_not_faulty():
    arrays = counts(0, recordings=24, channels=64)
    # sensors read 0 without touch, and each object touches a third of them
    for index, array in enumerate(arrays):
        array[:, np.arange(64) % 3 != index % 3] = 500
        array -= 500
    assert warned(table_of([array.round() for array in arrays])) == {}


def padded(arrays, fill, at_end=True):
    """Return recordings filled up to 120 frames, with zeros or with the frame at that end."""
    filled = []
    for array in arrays:
        frame = array[-1:] if at_end else array[:1]
        if fill == "zeros":
            frame = np.zeros_like(frame)
        padding = np.repeat(frame, 120 - len(array), axis=0)
        filled.append(np.concatenate([array, padding] if at_end else [padding, array]))
    return filled


@pytest.mark.parametrize("at_end", [True, False])
@pytest.mark.parametrize("fill", ["zeros", "value"])
@pytest.mark.parametrize("longer", [0, 20])
def test_padding_is_named_and_whether_its_length_tells_the_object(fill, at_end, longer):
    rng = np.random.default_rng(0)
    arrays = []
    for index in range(24):
        frames = 40 + longer * (index % 3) + rng.integers(0, 9)
        arrays.append(500 + rng.normal(0, 1, (frames, 8)))
    text = warned(table_of(padded(arrays, fill, at_end)))["equal ends"]
    assert "24 recordings" in text
    assert ("differs between the objects" in text) == (longer > 0)


def test_padding_is_named_where_frames_repeat_and_a_hand_at_rest_is_not():
    rng = np.random.default_rng(0)
    slow = [500 + (rng.random((frames, 2)) < 0.2).astype(int) for frames in range(50, 74)]
    assert "24 recordings" in warned(table_of(padded(slow, "zeros")))["equal ends"]
    grips = [rng.uniform(80, 200, 6) * rng.normal(1, 0.1, (30, 6)) for _ in range(24)]
    # frames before and after a firm grip that begins and ends within a frame
    rests = rng.integers(5, 20, (24, 2))
    held = [np.pad(grip, (rest, (0, 0))) for grip, rest in zip(grips, rests, strict=True)]
    assert warned(table_of(held)) == {}


@pytest.mark.parametrize("of_object", [True, False], ids=["of one object", "of some of each"])
@pytest.mark.parametrize(
    ("offset", "factor"),
    [
        (500, 3.3 / 1023),
        (500, 1 / 16),
        (500, 9.81),
        (500, 1000),
        (0, 3.3 / 1023),
        (0, 102),
    ],
)
def test_recordings_in_another_unit_are_named_with_the_factor(offset, factor, of_object):
    arrays = [array - 500 + offset for array in counts(0, recordings=24)]
    step = 3 if of_object else 4
    chosen = range(1, 24, step)
    for index in chosen:
        arrays[index] = arrays[index] * factor
    text = warned(table_of(arrays))["unit"]
    assert f"{len(chosen)} recordings" in text and f"X[{chosen[0]}]" in text
    assert ("weaker" in text) == (factor < 1)
    times = float(text.partition("about ")[2].partition(" times")[0])
    assert times == pytest.approx(max(factor, 1 / factor), rel=0.5)


def test_whole_counts_that_often_stand_still_are_named_in_another_unit_too():
    """A step of 0 tells nothing of the unit."""
    arrays = [array.round() for array in counts(0, recordings=24)]
    assert (np.diff(np.stack(arrays), axis=1) == 0).mean() > 0.2
    arrays[4] *= 16
    text = warned(table_of(arrays))["unit"]
    assert "1 recording about 15.4 times stronger" in text and "X[4]" in text


def test_half_of_the_recordings_in_volts_are_found_too():
    arrays = counts(0, recordings=24)
    for index in range(12, 24):
        arrays[index] = arrays[index] * (3.3 / 1023)
    assert "12 recordings" in warned(table_of(arrays))["unit"]


def test_a_light_grip_and_an_empty_hand_are_no_other_unit():
    rng = np.random.default_rng(0)
    arrays = []
    for force in 8 * [0.0, 2.0, 400.0]:
        arrays.append(rng.normal(0, 0.3, (60, 8)) + force * rng.uniform(0.5, 1, 8))
    assert warned(table_of(arrays)) == {}
    # muscles of different strength
    strengths = [30 * 0.7 ** (index % 12) for index in range(24)]
    muscles = [rng.normal(0, strength, (60, 8)) for strength in strengths]
    assert warned(table_of(muscles)) == {}
