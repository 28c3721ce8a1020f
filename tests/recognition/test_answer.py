"""Answers to recordings without labels: frames in contact, what they are told by, refusals."""

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.recognition.answer import (
    NO_CONTACT,
    OBJECT,
    UNKNOWN,
    answer_contact,
    answer_recording,
    answer_table,
    answer_together,
    bisecting,
)
from tactile_viewgcn.recognition.novelty import spread_sets
from tactile_viewgcn.tables.recordings import recordings_of
from tests.glove_data import HELD, OBJECTS, SHAPE, empty_hand, recogniser, recording, write


def answered(model, path, **options):
    """Answers to what lies at a path, and notes."""
    with recordings_of(path, labelled=False) as recordings:
        return answer_table(model, recordings, **options)


def best(answer):
    return recogniser().classes[int(answer.probabilities.argmax())]


@pytest.mark.parametrize("name", OBJECTS)
def test_a_recording_is_told_by_its_frames_in_contact(name):
    answer = answer_recording(recogniser(), recording(name, 50))
    assert (answer.status, best(answer)) == (OBJECT, name)
    assert (answer.used, answer.contact) == (8, HELD)
    assert answer.probabilities.sum() == pytest.approx(1, abs=1e-5)


def test_an_open_hand_is_no_contact_and_has_no_probabilities():
    answer = answer_recording(recogniser(), empty_hand(50))
    assert (answer.status, answer.used, answer.contact) == (NO_CONTACT, 0, 0)
    assert np.isnan(answer.probabilities).all() and answer.probabilities.shape == (3,)


@pytest.mark.parametrize("name", OBJECTS)
def test_a_recording_without_an_open_hand_has_the_training_s_baseline(tmp_path, name):
    write(tmp_path / "1.h5", recording(name, 51, before=0, after=0))
    ((row,), (note,)) = answered(recogniser(), tmp_path)
    assert (row.contact, best(row)) == (HELD, name)
    assert note.text == "session 'session' has fewer than 5 frames of the open hand: the training's is taken"


def test_a_few_frames_in_contact_are_all_used_once():
    answer = answer_recording(recogniser(), recording("pen", 53, held=3))
    assert (answer.used, answer.contact, best(answer)) == (3, 3, "pen")
    assert np.isnan(answer.novelty)


def test_a_confidence_threshold_takes_fewer_frames():
    early = answer_recording(recogniser(), recording("pen", 54), stop_at=0.4)
    assert early.used == 1 and best(early) == "pen"
    nothing_like_it = np.random.default_rng(0).normal(0, 1, (12, *SHAPE))
    unsure = answer_contact(recogniser(), nothing_like_it, stop_at=0.999)
    assert (unsure.used, unsure.grasp_again, early.grasp_again) == (8, True, False)


def test_what_presses_other_sensors_is_unlike_anything_seen():
    excess = np.zeros((10, *SHAPE))
    excess[:, :2] = 40.0
    answer = answer_contact(recogniser(), excess)
    assert answer.status == UNKNOWN and answer.novelty > 1
    assert best(answer) in OBJECTS


def test_view_sets_are_spread_evenly_and_lie_between_each_other():
    np.testing.assert_array_equal(spread_sets(8, 4), [[1, 3, 5, 7]])
    np.testing.assert_array_equal(spread_sets(16, 4, 2), [[1, 5, 9, 13], [3, 7, 11, 15]])
    np.testing.assert_array_equal(spread_sets(2, 4), [[0, 0, 1, 1]])


def test_the_first_frames_of_the_bisecting_order_are_spread_over_all():
    np.testing.assert_array_equal(bisecting(np.arange(8)), [0, 4, 2, 6, 1, 5, 3, 7])
    np.testing.assert_array_equal(np.sort(bisecting(np.arange(5))), np.arange(5))
    np.testing.assert_array_equal(bisecting(np.array([7])), [7])


@pytest.mark.parametrize(
    "counts, message",
    [
        (np.zeros((5, 8, 9), np.int16), r"counts: frames of 8 x 9; expected 8 x 10, as the model was trained on"),
        (np.full((5, *SHAPE), 0.5), r"counts holds 0.5; expected whole numbers from -32768 to 32767"),
        (np.full((5, *SHAPE), 40_000), r"counts holds 40000; expected whole numbers from -32768 to 32767"),
        (np.full((5, *SHAPE), 2**31, np.uint32), r"^counts holds counts from 2147483648 to 2147483648; expected"),
        (np.full((5, *SHAPE), np.inf, np.float16), r"^counts holds inf in frame 0, row 0, column 0"),
    ],
)
def test_another_layout_type_or_no_numbers_are_refused(counts, message):
    with pytest.raises(UserError, match=message):
        answer_recording(recogniser(), counts)


def test_whole_counts_are_the_same_in_any_type_of_numbers(tmp_path):
    counts = recording("pen", 54)
    same = [answer_recording(recogniser(), counts.astype(kind)).probabilities for kind in (np.int16, np.uint16, float)]
    np.testing.assert_allclose(same[1:], [same[0]] * 2, atol=1e-6)
    write(tmp_path / "real.h5", counts.astype(float))
    write(tmp_path / "fractions.h5", counts + 0.25)
    ((row,), _) = answered(recogniser(), tmp_path / "real.h5")
    np.testing.assert_allclose(row.probabilities, same[0], atol=1e-6)
    with pytest.raises(UserError, match=r"fractions.h5 holds \d+.25; expected whole numbers"):
        answered(recogniser(), tmp_path / "fractions.h5")


def test_another_scale_is_refused(tmp_path):
    counts = recording("ball", 55)
    write(tmp_path / "one.h5", 500 + (counts - 500) * 12)
    with pytest.raises(UserError, match=r"one in a hundred readings in contact is above \d+ counts over its baseline"):
        answered(recogniser(), tmp_path)


def test_recordings_without_object_and_session_are_read_where_labels_are_not_needed(tmp_path):
    write(tmp_path / "b" / "1.h5", recording("cup", 56))
    write(tmp_path / "a.h5", recording("pen", 57), object="pen", session="monday")
    rows, notes = answered(recogniser(), tmp_path)
    assert [(row.recording, row.object, best(row), row.frames) for row in rows] == [
        ("a", "pen", "pen", 60),
        ("b/1", "", "cup", 60),
    ]
    assert notes == []
    with pytest.raises(UserError, match="no attribute 'object'"):
        open_source(tmp_path)


def test_windows_of_seconds_are_answered_one_by_one(tmp_path):
    write(tmp_path / "1.h5", np.concatenate([recording("cup", 58), recording("pen", 59)]))
    rows, _ = answered(recogniser(), tmp_path, window=6.0)
    assert [best(row) for row in rows] == ["cup", "pen"]
    assert [row.start for row in rows] == pytest.approx([0, 6.0])
    assert [row.end for row in rows] == pytest.approx([5.9, 11.9])


def test_a_session_s_empty_hand_gives_the_baseline_where_it_is_recorded(tmp_path):
    high = np.int16(60)
    write(tmp_path / "empty.h5", empty_hand(60) + high, object="empty_hand")
    write(tmp_path / "held.h5", recording("ball", 61, before=0, after=0) + high)
    rows, _ = answered(recogniser(), tmp_path)
    assert [row.status for row in rows] == [NO_CONTACT, OBJECT]
    assert best(rows[1]) == "ball" and rows[1].contact == HELD


@pytest.mark.parametrize(
    "others, instead, high",
    [
        ({"open": recording("cup", 63)}, "their session's open hand", 20),
        ({"empty": empty_hand(63)}, "their session's empty hand", 20),
        ({}, "the training's baseline", 0),
    ],
)
def test_a_recording_without_an_open_hand_alone_does_without_its_grasp_s_baseline(tmp_path, others, instead, high):
    """A model of the baseline grasp: the other recordings keep theirs."""
    model, offset = recogniser("preprocess.baseline=grasp"), np.int16(high)
    write(tmp_path / "held.h5", recording("pen", 62, before=0, after=0) + offset)
    for name, counts in others.items():
        write(tmp_path / f"{name}.h5", counts + offset, **({"object": "empty_hand"} if name == "empty" else {}))
    rows, notes = answered(model, tmp_path)
    answers = {row.recording: row for row in rows}
    assert best(answers["held"]) == "pen" and answers["held"].contact == HELD
    (note,) = notes
    assert note.text.startswith(f"1 of {1 + len(others)} recording") and note.text.endswith(
        f"so {instead} is used: held"
    )
    if "open" in answers:
        alone = answer_recording(model, recording("cup", 63) + offset)
        np.testing.assert_allclose(answers["open"].probabilities, alone.probabilities, atol=1e-6)


def test_recordings_of_one_object_are_answered_together(tmp_path):
    """The sum of the answers' logarithms, as sure as two recordings of an object were in the training."""
    model = recogniser()
    answers = [answer_recording(model, recording("pen", seed, held=2)) for seed in (70, 71)]
    answer = answer_together(model, [*answers, answer_recording(model, empty_hand(72))])
    one, two, _ = model.calibration.by_recordings
    sums = one / two * sum(np.log(each.probabilities.astype(float)) for each in answers)
    np.testing.assert_allclose(answer.probabilities, np.exp(sums) / np.exp(sums).sum(), atol=1e-5)
    assert (answer.status, best(answer), answer.used, answer.contact) == (OBJECT, "pen", 4, 4)
    alone = answer_together(model, answers[:1])
    np.testing.assert_allclose(alone.probabilities, answers[0].probabilities, atol=1e-5)
    nothing = answer_together(model, [answer_recording(model, empty_hand(72))])
    assert nothing.status == NO_CONTACT and np.isnan(nothing.probabilities).all()
