"""A stream has early and final answers, equal to the answers of `predict`, or a reason for none."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from sklearn.exceptions import NotFittedError

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.live.stream import LiveStream
from tactile_viewgcn.messages import EMPTY_HAND, UserError
from tactile_viewgcn.recognition.growing import TOO_WEAK
from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.conftest import ROOT
from tests.glove_data import OBJECTS, answer_of, empty_hand, pressed, recogniser, recording
from tests.live.test_no_look_ahead import SMALL

GRASP = "preprocess.baseline=grasp"
SYSTEMS = {
    "kernels": (GRASP,),
    "trees": (GRASP, "model.members=[trees]"),
    "mvcnn": (GRASP, "model.system=mvcnn", *SMALL),
    "view_gcn": (GRASP, "model.system=view_gcn", *SMALL),
    "cnn_lstm": (GRASP, "model.system=cnn_lstm", *SMALL),
}
CHANNELS = ROOT / "tests/recognition/model_files/0.4.0_members.pt"


def answered(stream, frames, **options):
    """Return all updates for frames that are pushed one by one, and for the end of the input."""
    updates = []
    for counts in frames:
        updates += stream.push(counts, **options)
    return updates + stream.close()


def states(updates):
    """Return the states of updates."""
    return [update.state for update in updates]


def finals(updates):
    """Return the updates that are final answers."""
    return [update for update in updates if update.state == "final"]


@pytest.mark.parametrize("changes", SYSTEMS.values(), ids=SYSTEMS)
@pytest.mark.parametrize("name", ["ball", "pen"])
def test_a_grasp_after_an_open_hand_has_the_final_probabilities_of_predict(name, changes):
    model = recogniser(*changes)
    frames = recording(name, 100)
    (final,) = finals(answered(model.stream(), frames))
    expected = answer_of(model, frames)
    assert final.frames == 20
    assert expected.contact == 20
    np.testing.assert_allclose(final.probabilities, expected.probabilities, atol=2e-6)
    assert final.object == model.classes[int(expected.probabilities.argmax())]
    assert final.probability == final.probabilities.max()


@pytest.mark.parametrize("name", OBJECTS)
def test_the_baseline_of_a_session_is_that_of_the_frames_so_far(name):
    """`predict` also uses the open hand after the grasp, for the mean and for the noise."""
    frames = recording(name, 101)
    (final,) = finals(answered(recogniser().stream(), frames))
    expected = answer_of(recogniser(), frames).probabilities
    assert final.object == name
    np.testing.assert_allclose(final.probabilities, expected, atol=0.02)


def test_states_answers_frames_and_seconds_of_two_grasps():
    frames = np.concatenate(
        [recording("cup", 102, before=12, held=6), recording("pen", 103, before=0, held=4)]
    )
    updates = recogniser().stream().push(frames, 0.1 * np.arange(len(frames)) + 7)
    grasp = ["contact", "answer"]
    expected = ["waiting", "ready", *grasp, *5 * ["answer"], "final", "ready"]
    assert states(updates) == [*expected, *grasp, *3 * ["answer"], "final", "ready"]
    assert [update.frame for update in updates][:4] == [0, 4, 12, 12]
    answered_frames = [update.frames for update in updates if update.state == "answer"]
    assert answered_frames == [*range(1, 7), *range(1, 5)]
    first, second = finals(updates)
    assert (first.object, first.frames, first.frame) == ("cup", 6, 12 + 6 + 4)
    assert first.time == pytest.approx(7 + 2.2)
    assert first.seconds == pytest.approx(0.5)
    assert (second.object, second.frames) == ("pen", 4)
    assert second.seconds == pytest.approx(0.3)
    assert all(update.note == "" for update in updates)
    without = recogniser().stream().push(frames)
    assert {(update.time, update.seconds) for update in without} == {(None, None)}


def test_the_class_has_the_stream_of_its_recogniser(tmp_path):
    recogniser().content.write(tmp_path / "classifier.pt")
    stream = TactileClassifier.load(tmp_path / "classifier.pt").stream(sure=0.9, every=2)
    assert isinstance(stream, LiveStream)
    assert stream.classes == ["ball", "cup", "pen"]
    assert finals(answered(stream, recording("ball", 104)))[0].object == "ball"


def test_a_class_that_is_not_fitted_has_no_stream():
    with pytest.raises(NotFittedError):
        TactileClassifier().stream()


def test_an_answer_that_is_sure_closes_the_grasp_until_the_hand_opens():
    frames = np.concatenate([recording("cup", 105), recording("pen", 106, before=0)])
    whole = answered(recogniser().stream(), frames)
    probabilities = [update.probability for update in whole if update.state == "answer"][:20]
    sure = sorted(probabilities)[10]
    first = int(np.argmax(np.array(probabilities) >= sure))
    updates = answered(recogniser().stream(sure=sure), frames)
    expected = ["waiting", "ready", "contact", *first * ["answer"], "final", "waiting"]
    assert states(updates)[: first + 5] == expected
    early = finals(updates)[0]
    assert (early.object, early.frame, early.frames) == ("cup", 30 + first, first + 1)
    assert early.probability >= sure and "closed early" in early.note
    # the hand is ready again with the fifth frame after the whole grasp, of 20 frames
    ready = [update.frame for update in updates if update.state == "ready"]
    assert ready[:2] == [4, 30 + 20 + 4]
    assert finals(updates)[1].object == "pen"


def test_answers_come_every_few_frames_and_those_that_are_not_wanted_are_counted():
    frames = recording("cup", 107, before=12, held=10)
    updates = answered(recogniser().stream(every=4), frames)
    assert [update.frames for update in updates if update.state == "answer"] == [1, 5, 9]
    stream = recogniser().stream()
    updates = []
    for index, counts in enumerate(frames):
        updates += stream.push(counts, answer=index in (14, 15))
    assert [update.frames for update in updates if update.state == "answer"] == [3, 4]
    assert stream.skipped == 8
    (final,) = finals(updates)
    (expected,) = finals(answered(recogniser().stream(), frames))
    np.testing.assert_allclose(final.probabilities, expected.probabilities, atol=1e-6)


def test_a_grasp_is_closed_when_it_is_as_long_as_the_stream_allows():
    frames = np.concatenate([recording("cup", 108, held=30), recording("pen", 109, before=0)])
    updates = answered(recogniser().stream(longest=12), frames)
    first = finals(updates)[0]
    assert (first.object, first.frames, first.frame) == ("cup", 12, 30 + 11)
    assert first.note == "closed with 12 frames, the most that are kept"
    after = [update for update in updates if update.frame > first.frame]
    assert states(after)[:3] == ["ready", "contact", "answer"]
    assert after[0].frame == 30 + 30 + 4 and finals(updates)[1].object == "pen"


def test_the_end_of_the_input_in_a_grasp_is_its_end_and_the_next_frame_begins_anew():
    stream = recogniser().stream()
    frames = recording("cup", 110, after=0)
    updates = answered(stream, frames)
    assert states(updates)[-2:] == ["answer", "final"]
    assert updates[-1].note == "the input ended in the grasp"
    assert updates[-1].object == "cup"
    np.testing.assert_array_equal(updates[-1].probabilities, updates[-2].probabilities)
    # with another baseline, as of another glove
    updates = answered(stream, recording("pen", 111, after=0) + np.int16(9))
    assert states(updates)[:3] == ["waiting", "ready", "contact"]
    assert updates[0].frame == len(frames) and updates[-1].object == "pen"
    assert stream.close() == []


def test_what_reads_as_little_as_an_empty_hand_has_no_answer():
    """The touch adds seven counts. In training, the weakest object adds more than thirty."""
    frames = empty_hand(112)
    frames[20:26, pressed("pen")] += 7
    updates = answered(recogniser().stream(), frames)
    assert states(updates) == ["waiting", "ready", "contact", "final", "ready"]
    (final,) = finals(updates)
    assert final.object is None
    assert final.probabilities is None
    assert final.note == TOO_WEAK


def test_a_hand_that_closes_slowly_is_answered_as_soon_as_it_presses():
    frames = recording("cup", 113, before=20, held=6, after=0)
    closing = recording("cup", 113, before=3, held=0, after=0)
    closing[:, pressed("cup")] += 8
    updates = answered(recogniser().stream(), np.concatenate([frames[:20], closing, frames[20:]]))
    found = [(update.state, update.frames) for update in updates]
    assert found[2:5] == [("contact", 1), ("answer", 4), ("answer", 5)]


def test_readings_far_stronger_than_in_the_training_are_said_once_in_the_grasp_and_at_its_end():
    frames = recording("cup", 114, before=20, held=8)
    frames[20:28, pressed("cup")] += 5000
    updates = answered(recogniser().stream(), frames)
    assert states(updates) == ["waiting", "ready", "contact", "contact", "final", "ready"]
    for update in (updates[3], updates[4]):
        assert update.object is None
        assert "is the glove or the unit a different one?" in update.note
    # the next grasp is answered
    two_grasps = np.concatenate([frames, recording("pen", 115, before=0)])
    updates = answered(recogniser().stream(), two_grasps)
    assert finals(updates)[1].object == "pen"


def test_an_open_hand_in_a_smaller_unit_is_said(monkeypatch):
    model = recogniser()
    monkeypatch.setattr(model, "plan", replace(model.plan, dtype="float64"))
    updates = model.stream().push(empty_hand(116) / 1000.0)
    assert states(updates) == ["waiting", "ready"]
    assert "as an open hand read in the training" in updates[1].note


def test_the_empty_hand_is_a_class_only_of_what_is_held():
    model = recogniser("preprocess.empty_hand_class=true")
    assert EMPTY_HAND in model.classes
    updates = answered(model.stream(), empty_hand(117))
    assert states(updates) == ["waiting", "ready"]
    (final,) = finals(answered(model.stream(), recording("cup", 118)))
    assert final.object == "cup" and len(final.probabilities) == 4


def test_channels_without_an_open_hand_are_one_grasp_of_at_most_so_many_frames():
    model = Recogniser(CHANNELS)
    rng = np.random.default_rng(0)
    frames = rng.integers(0, 2, (25, 6)).astype(np.int16)
    frames[:, :2] += 31
    updates = answered(model.stream(longest=10), frames)
    grasp = ["contact", *9 * ["answer"], "final", "ready"]
    assert states(updates) == [*grasp, *grasp, "contact", *5 * ["answer"], "final"]
    first, _, third = finals(updates)
    expected = answer_of(model, frames[:10]).probabilities
    np.testing.assert_allclose(first.probabilities, expected, atol=2e-6)
    expected = answer_of(model, frames[20:]).probabilities
    np.testing.assert_allclose(third.probabilities, expected, atol=2e-6)


@pytest.mark.parametrize(
    ("frames", "message"),
    [
        (np.zeros((8, 9), int), r"frame 3 has shape \(8, 9\); expected \(8, 10\), or \(frames, 8"),
        (np.zeros((2, 80), int), r"frame 3 has shape \(2, 80\); expected"),
        ([[1, 2], [3]], r"frame 3 is ragged; expected \(8, 10\)"),
        (np.full((8, 10), np.nan), "frame 3: the sensor in row 1, column 1 reads nan; expected wh"),
        (np.full((8, 10), 0.5), "reads 0.5; expected whole numbers from -32768 to 32767"),
        (np.full((8, 10), 40_000), "reads 40000; expected whole numbers"),
        (np.full((8, 10), "a"), "frame 3: pressure is of type <U1"),
    ],
)
def test_a_frame_that_is_none_is_refused_and_nothing_of_it_is_taken(frames, message):
    stream = recogniser().stream()
    whole = recording("cup", 119)
    updates = stream.push(whole[:3])
    with pytest.raises(UserError, match=message):
        stream.push(frames)
    infinite = whole[:4].astype(float)
    infinite[1, 2, 1] = np.inf
    with pytest.raises(UserError, match=r"frame 4: the sensor in row 3, column 2 reads inf"):
        stream.push(infinite)
    with pytest.raises(UserError, match=r"time has shape \(2,\); expected \(3,\)"):
        stream.push(whole[:3], [1.0, 2.0])
    updates += stream.push(whole[3:].astype(float))
    expected = recogniser().stream().push(whole)
    assert states(updates) == states(expected)
    for update, other in zip(updates, expected, strict=True):
        np.testing.assert_array_equal(update.probabilities, other.probabilities)


@pytest.mark.parametrize("longest", [1, 3, 5, 7])
def test_where_every_frame_counts_each_is_of_an_answered_grasp(longest):
    """The frames of the open hand at the beginning, which are found five at a time, count too."""
    model = recogniser("preprocess.filter=none", GRASP)
    assert not model.separates_grasps and recogniser(GRASP).separates_grasps
    frames = recording("cup", 130, before=12, held=8, after=8)
    updates = answered(model.stream(longest=longest), frames)
    grasps = finals(updates)
    parts = [range(28)[first : first + longest] for first in range(0, 28, longest)]
    assert [final.frames for final in grasps] == [len(part) for part in parts]
    assert states(updates).count("contact") == len(grasps)
    assert states(updates)[0] == "waiting"
    assert states(updates).count("waiting") == 1
    is_held = [not set(part).isdisjoint(range(12, 20)) for part in parts]
    assert [final.object is not None for final in grasps] == is_held


def test_where_every_frame_counts_a_sure_answer_waits_for_an_open_hand():
    model = recogniser("preprocess.filter=none", GRASP)
    frames = recording("cup", 130, before=12, held=8, after=8)
    updates = answered(model.stream(sure=1e-9), frames)
    early = finals(updates)[0]
    assert (early.frame, early.frames, early.note) == (12, 13, "closed early")
    after = [(update.state, update.frame) for update in updates if update.frame >= 12]
    # the hand is open from frame 20 on
    assert after[:3] == [("final", 12), ("waiting", 12), ("contact", 24)]


@pytest.mark.parametrize("dtype", [np.int16, np.float64])
def test_an_array_that_is_reused_for_each_frame_is_copied(dtype):
    """A program can do this if it reads into one buffer."""
    frames = recording("cup", 130, before=12, held=8, after=8).astype(dtype)
    buffer = np.zeros_like(frames[0])
    stream = recogniser().stream()
    updates = []
    for counts in frames:
        buffer[:] = counts
        updates += stream.push(buffer)
    expected = answered(recogniser().stream(), frames)
    assert states(updates) == states(expected)
    (final,) = finals(updates)
    (expected_final,) = finals(expected)
    np.testing.assert_array_equal(final.probabilities, expected_final.probabilities)
    assert final.frames == 8


@pytest.mark.parametrize(
    "time", ["now", np.nan, np.inf, [None], {}, pytest.param(10**400, id="large")]
)
def test_a_time_that_is_no_finite_number_is_refused_and_the_frame_is_not_taken(time):
    stream = recogniser().stream()
    frames = recording("cup", 119)
    with pytest.raises(UserError, match=r"time is .*; expected "):
        stream.push(frames[0], time)
    assert stream.push(frames[0], 0.5)[0].frame == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sure": 0.0}, "sure is 0.0; expected a probability"),
        ({"sure": 1.5}, "sure is 1.5"),
        ({"sure": np.nan}, "sure is nan"),
        ({"longest": 0}, "longest is 0"),
        ({"every": 0}, "every is 0"),
    ],
)
def test_an_option_out_of_its_range_is_refused(options, message):
    with pytest.raises(UserError, match=message):
        recogniser().stream(**options)


def test_memory_is_the_same_after_ten_times_as_many_frames():
    frames = np.concatenate([recording("cup", 120, held=60), recording("pen", 121, before=0)])
    stream = recogniser().stream(longest=50, every=25)
    used = []
    tracemalloc.start()
    for repeats in (5, 45):
        for _ in range(repeats):
            stream.push(frames)
        used.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert used[1] - used[0] < 20_000, used
