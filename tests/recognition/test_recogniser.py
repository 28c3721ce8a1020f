"""The trained recogniser: answers to recordings by their frames in contact, and refusals."""

from contextlib import nullcontext
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import pytest
import torch
from scipy.special import softmax

from tactile_viewgcn.frames.training_readings import measured_on
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.recognition.estimator import train
from tactile_viewgcn.recognition.model_file import build_classifier, save_classifier
from tactile_viewgcn.recognition.raw_counts import fault_of
from tactile_viewgcn.recognition.recogniser import Recogniser, recording_of
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.tables.recordings import in_memory, recordings_of
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import (
    CPU,
    HELD,
    SHAPE,
    answer_of,
    empty_hand,
    recipe,
    recogniser,
    recording,
    table,
    with_settings,
    write,
)


def answered(model, path):
    """Return the answers to the recordings at a path, by the recordings' names, and the notes."""
    with recordings_of(path, Form(labelled=False)) as recordings:
        answers, notes = model.answer_table(recordings)
    return {answer.recording: answer for answer in answers}, notes


def best(answer):
    """Return the object of the largest probability."""
    return recogniser().classes[int(answer.probabilities.argmax())]


@pytest.mark.parametrize(
    ("name", "held"),
    [("ball", HELD), ("cup", HELD), ("pen", HELD), ("pen", 3), ("", 0)],
)
def test_a_recording_is_answered_by_all_its_frames_in_contact(name, held):
    counts = recording(name, 50, held=held).astype(np.float64)
    counts[:2, 0, 0] = 32_767, -32_768  # int16, the type in training, ends at these readings
    answer = answer_of(recogniser(), counts)
    assert (answer.contact, answer.probabilities.shape) == (held, (3,))
    assert answer.probabilities.sum() == pytest.approx(1, abs=1e-5)
    if held:
        assert best(answer) == name
    else:  # the empty hand is no class of this model
        assert (answer.probabilities == np.float32(1 / 3)).all()


@pytest.mark.parametrize(
    "counts, message",
    [
        (np.zeros((5, 8, 9), np.int16), "counts: .*8 x 9; expected 8 x 10"),
        (np.full((5, *SHAPE), 0.5), "counts: holds 0.5; .*-32768 to 32767"),
        (np.full((5, *SHAPE), 40_000), "counts: holds 40000; .*-32768 to 32767"),
        (
            np.full((5, *SHAPE), 2**31, np.uint32),
            r"counts holds 2.14748e\+09 in frame 0, .* to 2.14748e\+09",
        ),
    ],
)
def test_a_different_layout_or_type_and_numbers_that_are_not_finite_are_refused(counts, message):
    with pytest.raises(UserError, match=f"^{message}"):
        answer_of(recogniser(), counts)


def test_an_answer_that_is_not_finite_is_refused(monkeypatch):
    monkeypatch.setattr(recogniser().content, "temperature", np.nan)
    with pytest.raises(UserError, match=r"^counts: the model's answer is not finite; expected"):
        answer_of(recogniser(), recording("pen", 50))


@pytest.mark.parametrize(
    ("kind", "edge", "times", "towards"), [(0, 0, 1 / 4, 0), (0, 1, 4, 1e9), (1, 0, 1 / 4, 0)]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_readings_may_be_four_times_weaker_or_stronger_than_in_the_training_and_no_more(
    kind, edge, times, towards, sign
):
    """Readings of kind 0 are above the baseline, of kind 1 raw. A shear force has both signs."""
    plan = replace(recogniser().plan, dtype="float64")
    limit = plan.strong_readings[kind][edge] * times
    outside = np.nextafter(limit, towards)
    for reading, fault in (limit, False), (outside, True):
        readings = [np.full((3, *SHAPE), weakest) for weakest, _ in plan.strong_readings]
        readings[kind] = np.full((3, *SHAPE), sign * reading)
        excess, raw = readings
        # the last two frames have no contact, so they may read anything
        counts = np.concatenate([raw, np.full((2, *SHAPE), 1e6)])
        assert bool(fault_of(plan, counts, np.arange(5) < 3, excess)) == fault


@pytest.mark.parametrize("name", ["empty_hand", "pen"])
def test_only_an_object_has_a_strength_that_is_compared_with_the_training_s(name):
    counts = empty_hand(92)
    zero = np.zeros(1, dtype=np.int64)
    counts[-3:] = 30_000
    if name == "empty_hand":
        expectation = nullcontext()
    else:
        expectation = pytest.raises(UserError, match="one in a hundred")
    with expectation:
        table = in_memory([recording_of(counts, "X")], [name], zero, zero, ["today"])
        recogniser().answer_table(table)


def channels(folder, names, rate):
    """Write two tables (40, 2) of each of two objects, and return their folder.

    The clocks of the tables differ.

    Args:
        folder: a folder, which is made.
        names: the names of the two sensors.
        rate: frames in a second.
    """
    rng = np.random.default_rng(0)
    frames = np.arange(40)
    for label, repeat in product(("left", "right"), (1, 2)):
        readings = rng.normal(0, 1, (40, 2))
        pressed_sensor = ("left", "right").index(label)
        readings[21:, pressed_sensor] += 20
        rows = np.column_stack([1.7e9 * (repeat - 1) + frames / rate, readings])
        path = folder / label / f"{repeat}.csv"
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savetxt(path, rows, "%.4f", ",", header=f"time,{names}", comments="")
    return folder


@pytest.mark.parametrize(
    ("names", "rate", "message"),
    [
        ("thumb,index", 50, None),
        ("thumb,index", 53, None),
        ("thumb,index", 100, "4 of 4 recordings: left/1 100 Hz, left/2 100 Hz"),
        ("thumb,index", 25, "4 of 4 recordings: left/1 25 Hz"),
        ("index,thumb", 50, "sensor 1 is index; expected thumb of thumb, index"),
    ],
)
def test_sensors_in_a_different_order_are_refused_and_a_different_rate_is_warned_of(
    tmp_path, names, rate, message
):
    with recordings_of(channels(tmp_path / "trained", "thumb,index", 50)) as table:
        params = recipe("model.system=sensors", "model.members=[svm]", "split.validation=0")
        train(table, params, table.columns["recording"], tmp_path / "classifier.pt")
    model = Recogniser(tmp_path / "classifier.pt")
    new = channels(tmp_path / "new", names, rate)
    if names != "thumb,index":
        with pytest.raises(UserError, match=message):
            answered(model, new)
        return
    _, notes = answered(model, new)
    warnings = [note.text for note in notes if note.topic == "frame rate"]
    if message is None:
        assert warnings == []
    else:
        (warning,) = warnings
        assert warning.startswith(message)


@pytest.mark.parametrize(
    ("changes", "others", "instead", "high"),
    [
        ([], {}, "the training set's", 0),
        ([], {"empty": empty_hand(63)}, "", 60),
        ([], {"open": recording("cup", 63)}, "the training set's", 0),
        (
            ["preprocess.baseline=grasp"],
            {"open": recording("cup", 63)},
            "the training set's baseline",
            0,
        ),
        (
            ["preprocess.baseline=grasp"],
            {"empty": empty_hand(63)},
            "the session's empty hand",
            20,
        ),
        (["preprocess.baseline=grasp"], {}, "the training set's baseline", 0),
    ],
)
def test_a_recording_without_an_open_hand_has_the_baseline_of_its_empty_hand_or_of_the_training(
    tmp_path, changes, others, instead, high
):
    """The counts can be higher than in the training set.

    No answer depends on other recordings in the same call, except on the empty hand.
    """
    model = recogniser(*changes)
    offset = np.int16(high)
    arrays = {"held": recording("pen", 62, before=0, after=0)} | others
    for name, counts in arrays.items():
        attributes = {"object": "empty_hand"} if name == "empty" else {}
        write(tmp_path / f"{name}.h5", counts + offset, **attributes)
    answers, notes = answered(model, tmp_path)
    assert best(answers["held"]) == "pen"
    assert answers["held"].contact == HELD
    assert len(notes) == bool(instead)
    assert all(instead in note.text for note in notes)
    if "empty" not in answers:
        for name, counts in arrays.items():
            expected = answer_of(model, counts + offset).probabilities
            np.testing.assert_array_equal(answers[name].probabilities, expected)


def test_the_weakest_readings_are_of_objects():
    frames = table()
    empty = frames.label == frames.classes.index("empty_hand")
    counts = np.where(empty[:, None, None], 0, frames.counts).astype(np.int16)
    plan = measured_on(replace(frames, counts=counts))
    weakest, strongest = np.transpose(plan.strong_readings)
    expected_weakest, expected_strongest = np.transpose(measured_on(frames).strong_readings)
    np.testing.assert_array_equal(weakest, expected_weakest)
    assert strongest[0] == pytest.approx(514, abs=1)
    assert strongest[1] == expected_strongest[1]


def test_times_count_from_a_recording_s_first_frame_wherever_its_clock_begins():
    tables = [
        pd.DataFrame({"time": begin + np.array([0, 0.5, 1.5]), "a": [1.0, 2, 3]})
        for begin in (-7, 0, 1.7e9)
    ]
    zeros = np.zeros(3, dtype=int)
    recordings = [recording_of(columns, "X") for columns in tables]
    table = in_memory(recordings, ["pen"], zeros, zeros, ["today"])
    np.testing.assert_allclose(table.columns["time"], [0, 0.5, 1.5] * 3, atol=1e-6)


def test_a_recording_keeps_its_times_beside_one_without():
    timed = pd.DataFrame({"time": [3, 4, 6], "a": [1.0, 2, 3]})
    recordings = [recording_of(columns, "X") for columns in (timed, timed[["a"]])]
    zeros = np.zeros(2, dtype=int)
    table = in_memory(recordings, ["pen"], zeros, zeros, ["today"])
    np.testing.assert_array_equal(table.columns["time"], [0, 1, 3, np.nan, np.nan, np.nan])


def test_of_an_array_the_frames_may_be_last():
    counts = np.arange(24).reshape(2, 3, 4)
    frames = recording_of(counts, "X", frames_last=True).values["pressure"]
    assert frames.shape == (4, 2, 3)
    assert frames[1].tolist() == counts[..., 1].tolist()


def test_a_session_with_many_baselines_has_their_mean():
    baselines = np.array([514, 510, 520, 700], np.float32)
    means = np.tile(baselines[:, None, None], (1, 12, 12))
    # session one has two baselines in the training set, and session two has one; the test set has
    # the fourth
    baseline = np.arange(len(table())) % 3
    baseline[table().on(TEST)] = 3
    many = table().with_columns(session=(baseline == 2).astype(int), baseline=baseline)
    many = replace(many, sessions=["one", "two", "none"])
    plan = measured_on(replace(many, baseline_mean=means))
    assert plan.sessions == ["one", "two"]
    assert (plan.baselines[0] == 512).all() and (plan.baselines[1] == 520).all()
    assert (plan.mean_baseline() == 516).all()  # the session without frames does not count


@pytest.mark.parametrize("system", ["view_gcn", "stag", "cnn_lstm", "conv_lstm", "gvcnn"])
@pytest.mark.parametrize("transform", ["clip", "log"])
def test_a_saved_network_answers_as_in_the_evaluation(tmp_path, system, transform):
    torch.manual_seed(0)
    params = recipe(f"model.system={system}", "model.backbone.width=8")
    frames = with_settings(table(), transform=transform)
    classifier = build_classifier(torch.from_numpy(viewpoints(4)), 4, params.model, (12, 12)).eval()
    save_classifier(tmp_path / "classifier.pt", classifier, params.model, frames)
    index = frames.on(TEST)[:12:3]
    classifier.prepare(CPU)
    values = classifier.frame_values(frames.inputs(index))
    (expected,) = softmax(classifier.view_sets(values, np.arange(4)[None]), axis=1)
    excess = frames.counts[index] - frames.baseline_mean[frames.baseline[index]]
    stored = Recogniser(tmp_path / "classifier.pt")
    probabilities = np.exp(stored.content.answer(stored.classifier, excess))
    np.testing.assert_allclose(probabilities, expected, atol=1e-5)
