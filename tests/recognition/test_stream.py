"""Answers to frames as they come: contacts, early answers."""

import json

import numpy as np
import pytest
from tactile_viewgcn.recognition.stream import GAP_FRAMES, OPEN_FRAMES, Contact, Stream, follow

from tactile_viewgcn.recognition import stream as stream_module
from tactile_viewgcn.recognition.answer import OBJECT, UNKNOWN, answer_contact
from tests.small_glove import BEFORE, HELD, recogniser, recording

TWO = np.concatenate([recording("cup", 70), recording("pen", 71)])


def lines(counts):
    return [",".join(map(str, frame.ravel())) + "\n" for frame in counts]


def answers(counts, **options):
    stream = Stream(recogniser(), **options)
    rows = [row for row in follow(stream, recogniser(), lines(counts)) if not isinstance(row, str)]
    return rows, [recogniser().classes[int(row.answer.probabilities.argmax())] for row in rows]


def test_each_contact_has_an_answer_when_it_has_ended():
    rows, best = answers(TWO)
    assert best == ["cup", "pen"]
    assert [row.frames for row in rows] == [BEFORE + HELD + GAP_FRAMES, 60 + BEFORE + HELD + GAP_FRAMES]
    assert [(row.answer.used, row.answer.contact) for row in rows] == [(8, HELD), (8, HELD)]


def test_the_latency_is_the_time_from_a_line_to_its_answer(monkeypatch):
    """On a clock that only the classification, of 250 ms, and the wait for a line, of a second, let go on."""
    clock = [0.0]

    def waiting():
        for text in lines(TWO[: BEFORE + 2 * HELD]):
            clock[0] += 1
            yield text

    def answered(*given, **options):
        clock[0] += 0.25
        return answer_contact(*given, **options)

    monkeypatch.setattr(stream_module, "answer_contact", answered)
    monkeypatch.setattr(stream_module.time, "perf_counter", lambda: clock[0])
    *_, row = follow(Stream(recogniser()), recogniser(), waiting())
    assert row.latency_ms == pytest.approx(250)


def test_a_contact_that_the_last_frame_leaves_open_has_its_answer_at_the_end():
    rows, best = answers(TWO[: BEFORE + 10])
    assert best == ["cup"] and rows[0].answer.contact == 10


def test_a_confident_answer_comes_in_the_middle_of_the_contact_and_once():
    rows, best = answers(TWO, stop_at=0.5)
    assert best == ["cup", "pen"]
    assert [row.frames for row in rows] == [BEFORE + 1, 60 + BEFORE + 1]
    assert [row.answer.used for row in rows] == [1, 1]


def test_the_baseline_is_noted_and_a_stream_that_begins_in_contact_has_the_training_s():
    first, *_ = follow(Stream(recogniser()), recogniser(), lines(TWO))
    assert first == f"ready: the first {OPEN_FRAMES} frames are the baseline"
    first, row = follow(Stream(recogniser()), recogniser(), lines(recording("pen", 72, before=0, held=40)))
    assert "are contact: the training's baseline" in first
    assert recogniser().classes[int(row.answer.probabilities.argmax())] == "pen"


def test_a_drift_of_the_open_hand_is_no_contact():
    slow = (np.arange(900) * 0.01)[:, None, None]  # nine standard deviations of noise in the end
    drifting = np.rint(recording("cup", 73, before=900, held=0, after=0) + slow).astype(np.int16)
    assert answers(drifting)[0] == []


def test_a_long_contact_keeps_frames_evenly():
    contact = Contact(0.0)
    for number in range(3000):
        contact.add(np.full((1, 1), number))
    assert contact.count == 3000
    np.testing.assert_array_equal(contact.stack().ravel(), np.arange(0, 3000, 4))


def test_an_interrupt_ends_the_stream_with_the_answer_to_the_open_contact():
    def interrupted():
        yield from lines(TWO[: BEFORE + 12])
        raise KeyboardInterrupt

    *_, row = follow(Stream(recogniser()), recogniser(), interrupted())
    assert row.answer.contact == 12


def test_times_of_the_frames_are_those_of_the_answer():
    text = [json.dumps({"pressure": frame.tolist(), "time": 0.1 * i}) for i, frame in enumerate(TWO[:60])]
    *_, row = follow(Stream(recogniser()), recogniser(), text)
    assert (row.start, row.end) == pytest.approx((0.1 * BEFORE, 0.1 * (BEFORE + HELD + GAP_FRAMES - 1)))


def test_a_contact_of_another_scale_is_unlike_anything_seen_and_the_next_is_answered():
    strong = recording("cup", 70)
    strong[BEFORE : BEFORE + HELD] += (9 * (strong[BEFORE : BEFORE + HELD] - 500).clip(0)).astype(np.int16)
    rows, best = answers(np.concatenate([strong, recording("pen", 71)]))
    assert [row.answer.status for row in rows] == [UNKNOWN, OBJECT] and best[1] == "pen"


def test_where_every_frame_is_taken_the_training_s_baseline_is_subtracted():
    model = recogniser("preprocess.filter=none")
    stream = Stream(model)
    above = stream._above(recording("cup", 70)[0])
    assert abs(above.mean()) < 1  # the open hand reads 503 in the mean
