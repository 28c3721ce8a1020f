"""The table of live answers, for a stream whose frames say which object they hold."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from tactile_viewgcn.evaluation import live
from tactile_viewgcn.evaluation.live import (
    Grasps,
    affordable,
    answer_live,
    live_rows,
    numbered_grasps,
    stream_grasps,
)
from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.live.stream import Update
from tactile_viewgcn.messages import EMPTY_HAND
from tactile_viewgcn.recognition.growing import TOO_WEAK
from tactile_viewgcn.tables.frames import TEST, TRAIN
from tests.glove_data import recipe, table, written

CLASSES = [EMPTY_HAND, "cup", "pen"]
OPEN = [0, 0]
CUP = {level: [1, level] for level in (50, 70, 85, 97)}
PEN = {level: [2, level] for level in (50, 60, 90)}


class Stream:
    """A stream of frames (1, 2), each the index of an object and its probability in per cent.

    The object 0 is an open hand.
    """

    def __init__(self):
        self.frame = -1
        self.begin = None
        self.frames = 0
        self.answers_requested = 0

    def push(self, frames, time=None, *, answer=True):
        self.frame += 1
        self.answers_requested += answer
        label, level = frames[0]
        updates = []
        if label == 0:
            return self.close()
        if not self.frames:
            self.begin = time
            updates.append(Update("contact", self.frame, time))
        self.frames += 1
        seconds = None if time is None else time - self.begin
        known = [CLASSES[label], level / 100, None, self.frames, seconds]
        self.last = [time, *known]
        if answer:
            updates.append(Update("answer", self.frame, time, *known))
        return updates

    def close(self):
        if not self.frames:
            return []
        self.frames = 0
        return [Update("final", self.frame, *self.last)]


def recordings_at(path, frames, *, grasp=None, step=0.2):
    """Return recordings of these frames, numbered from 0, at 5 frames a second or without times."""
    lengths = [len(recording) for recording in frames]
    recording = np.repeat(np.arange(len(frames)), lengths)
    frame = np.concatenate([np.arange(length) for length in lengths])
    columns = {"recording": recording, "frame": frame, "time": frame * step}
    if grasp is not None:
        columns["grasp"] = np.array(grasp)
    return written(path, np.concatenate(frames)[:, None].astype(np.int16), **columns)


def numbered(*rows):
    """Return a table of numbered grasps with these rows."""
    columns = ["recording", "grasp", "label", "group", "is_tested"]
    return pd.DataFrame(rows, columns=columns)


#: A cup of two grasps, taken for a pen at first; a pen that the stream does not find; an empty hand
THREE = [
    [OPEN, OPEN, PEN[50], CUP[70], CUP[85], CUP[97], OPEN, OPEN, CUP[85], OPEN],
    [OPEN] * 4,
    [OPEN] * 4,
]
THREE_NUMBERED = numbered((0, 0, 1, 7, True), (1, 0, 2, 8, True), (2, 0, 0, 9, True))


@pytest.fixture
def three(tmp_path):
    """Return the recordings of THREE."""
    return recordings_at(tmp_path / "table", THREE)


def test_grasps_are_found_one_after_another_and_those_that_are_not_found_have_no_answer(three):
    grasps, answers, unit = stream_grasps(Stream, three, THREE_NUMBERED, CLASSES)
    assert unit == "s"
    assert grasps["group"].tolist() == [7, 7, 8, 9]
    assert grasps["contact"].tolist() == pytest.approx([0.6, 0, np.nan, np.nan], nan_ok=True)
    assert grasps["right_unanswered"].tolist() == [False, False, False, True]
    assert answers["grasp"].tolist() == [0, 0, 0, 0, 0, 1, 1]
    assert answers["contact"].tolist() == pytest.approx([0, 0.2, 0.4, 0.6, 0.6, 0, 0])
    assert answers["right"].tolist() == [False, True, True, True, True, True, True]
    assert answers["is_final"].tolist() == [False] * 4 + [True, False, True]


def test_errors_are_those_of_the_latest_answer_at_each_time(three):
    rows = live_rows(stream_grasps(Stream, three, THREE_NUMBERED, CLASSES), 0)
    table = pd.DataFrame(rows).set_index(["answer", "level"])
    so_far = table.loc["so far"]
    assert list(so_far.index) == [0.25, 0.5, 1, 2, 4]
    # the pen has no answer; the empty hand needs none
    assert so_far["error"].tolist() == [0.25] * 5
    assert so_far["share"].tolist() == [0.25, 0.25, 0, 0, 0]
    assert so_far["contact"].tolist() == pytest.approx([0.1, 0.2, 0.3, 0.3, 0.3])
    sure = table.loc["sure"]
    assert sure["error"].tolist()[:3] == [0, 0, 0]
    assert sure["share"].tolist() == [0.5, 0.25, 0.25]
    assert sure["contact"].tolist() == pytest.approx([0.2, 0.6, 0.6])
    assert set(table["unit"]) == {"s"}


def test_a_wrong_first_answer_counts_until_it_is_corrected_and_a_sure_one_for_good():
    grasps = pd.DataFrame(
        {"group": [0, 1], "contact": [3.0, 0.3], "right_unanswered": [False, False]}
    )
    answers = pd.DataFrame(
        [
            (0, 0.0, 0.95, False, False),
            (0, 0.4, 0.70, False, False),
            (0, 1.5, 0.85, True, False),
            (0, 3.0, 0.99, True, True),
            (1, 0.3, 0.99, True, True),
        ],
        columns=["grasp", "contact", "probability", "right", "is_final"],
    )
    table = pd.DataFrame(live_rows(Grasps(grasps, answers, "s"), 0))
    assert table["error"].tolist() == [1, 0.5, 0.5, 0, 0, 0, 1, 1, 1]
    assert table["share"].tolist() == [1, 0.5, 0.5, 0.5, 0, 1, 0.5, 0.5, 0.5]
    # two groups: the interval is as wide as two answers leave it
    assert table.loc[3, ["low", "high"]].tolist() == pytest.approx([0, 1 - 0.025**0.5])
    assert table.loc[6, ["low", "high"]].isna().all()  # a single group


def test_where_the_stream_finds_nothing_every_grasp_is_wrong_and_nothing_is_sure(tmp_path):
    recordings = recordings_at(tmp_path / "table", [[OPEN] * 4] * 2)
    known = numbered((0, 0, 1, 7, True), (1, 0, 2, 8, True))
    rows = live_rows(stream_grasps(Stream, recordings, known, CLASSES), 0)
    assert [row["error"] for row in rows] == [1] * 6 + [None] * 3
    assert [row["contact"] for row in rows] == [None] * 9


def test_without_times_frames_are_counted(tmp_path):
    recordings = recordings_at(tmp_path / "table", THREE, step=np.nan)
    rows = live_rows(stream_grasps(Stream, recordings, THREE_NUMBERED, CLASSES), 0)
    assert [row["level"] for row in rows[:5]] == [1, 2, 4, 8, 16]
    assert [row["error"] for row in rows[:6]] == [0.5, 0.25, 0.25, 0.25, 0.25, 0.25]
    assert rows[0]["unit"] == "frames"
    assert rows[5]["contact"] == 2.5


def test_of_numbered_grasps_only_those_of_the_evaluated_set_count(tmp_path):
    frames = [[OPEN, CUP[70], CUP[70], OPEN, CUP[85], CUP[85], OPEN, OPEN, OPEN, OPEN]]
    recordings = recordings_at(tmp_path / "table", frames, grasp=[0, 0, 0, 0, 1, 1, 1, 2, 2, 2])
    known = numbered((0, 0, 1, 3, False), (0, 1, 1, 4, True), (0, 2, 1, 5, True))
    grasps, answers, _ = stream_grasps(Stream, recordings, known, CLASSES)
    assert grasps["group"].tolist() == [4, 5]
    assert np.isnan(grasps["contact"][1])
    assert answers["probability"].tolist() == [0.85, 0.85, 0.85]


def test_numbered_grasps_that_the_stream_joins_count_once_and_never_with_training_frames(tmp_path):
    frames = [[OPEN, CUP[70], CUP[70], CUP[85], CUP[85], OPEN, OPEN]]
    recordings = recordings_at(tmp_path / "table", frames, grasp=[0, 0, 0, 1, 1, 1, 2])
    known = numbered((0, 0, 1, 3, True), (0, 1, 1, 3, True), (0, 2, 1, 3, True))
    grasps, _, _ = stream_grasps(Stream, recordings, known, CLASSES)
    assert grasps["contact"].tolist() == pytest.approx([0.6])
    known = numbered((0, 0, 1, 3, False), (0, 1, 1, 4, True), (0, 2, 1, 5, True))
    grasps, answers, _ = stream_grasps(Stream, recordings, known, CLASSES)
    # the third is not found, and the second cannot be told from the first
    assert grasps["group"].tolist() == [5]
    assert answers.empty


class LateStream(Stream):
    """Closes a grasp after three successive frames of the open hand; a real stream needs five."""

    def __init__(self):
        super().__init__()
        self.open = 0

    def push(self, frames, time=None, *, answer=True):
        label, _ = frames[0]
        if label:
            self.open = 0
            return super().push(frames, time, answer=answer)
        self.frame += 1
        self.open += 1
        if self.open < 3:
            return []
        return self.close()


@pytest.mark.parametrize("step", [0.2, np.nan])
def test_a_grasp_that_is_closed_in_the_next_one_counts_as_the_one_in_which_it_was_held(
    tmp_path, step
):
    # Grasp 0 ends with an open frame. Its final answer comes with the second frame of grasp 1.
    frames = [[OPEN, CUP[70], CUP[70], OPEN, OPEN, OPEN, CUP[85], CUP[97], OPEN, OPEN, OPEN]]
    grasp = [0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1]
    recordings = recordings_at(tmp_path / "table", frames, grasp=grasp, step=step)
    known = numbered((0, 0, 1, 3, True), (0, 1, 1, 4, False))
    grasps, answers, _ = stream_grasps(LateStream, recordings, known, CLASSES)
    assert grasps["group"].tolist() == [3]
    assert answers["probability"].tolist() == pytest.approx([0.7, 0.7, 0.7])


def test_contact_in_the_last_frame_belongs_to_the_grasp_of_that_frame(tmp_path):
    frames = [[OPEN, OPEN, OPEN, CUP[70]]]
    recordings = recordings_at(tmp_path / "table", frames, grasp=[0, 0, 0, 1])
    known = numbered((0, 0, 2, 3, True), (0, 1, 1, 4, True))
    grasps, answers, _ = stream_grasps(Stream, recordings, known, CLASSES)
    assert grasps["group"].tolist() == [4, 3]
    assert answers["right"].tolist() == [True, True]


class Untouched(Stream):
    """Finds a grasp whose readings are too weak for an answer."""

    def close(self):
        if not self.frames:
            return []
        self.frames = 0
        return [Update("final", self.frame, frames=1, seconds=0.0, note=TOO_WEAK)]

    def push(self, frames, time=None, *, answer=True):
        return super().push(frames, time, answer=False)


def test_a_hand_that_touches_nothing_is_the_empty_hand_as_for_predict(tmp_path):
    recordings = recordings_at(tmp_path / "table", [[OPEN, CUP[50], OPEN]] * 2)
    known = numbered((0, 0, 0, 3, True), (1, 0, 1, 4, True))
    _, answers, _ = stream_grasps(Untouched, recordings, known, CLASSES)
    assert answers["right"].tolist() == [True, False]


@pytest.mark.parametrize("is_tested", [True, False])
def test_where_no_grasp_is_tested_as_a_whole_there_are_no_rows_and_a_note(
    tmp_path, monkeypatch, is_tested
):
    # the tested grasp is joined with one of the training set, or no grasp is tested
    frames = [[OPEN, CUP[70], CUP[70], OPEN]]
    recordings = recordings_at(tmp_path / "table", frames, grasp=[0, 0, 1, 1])
    known = numbered((0, 0, 1, 3, False), (0, 1, 1, 3, is_tested))
    monkeypatch.setattr(live, "numbered_grasps", lambda *_: known)
    labels = np.zeros(1, dtype=int)
    whole = Trials(np.zeros((1, 1, 2), int), labels, labels, np.array(["x"]), 5)
    rows, (note,) = answer_live(Stream, recordings, table(), whole, whole.correct[0], recipe())
    assert rows == []
    assert "no live answers" in note.text


@pytest.mark.parametrize(
    ("second", "text"),
    [
        ([OPEN, CUP[70], CUP[70], OPEN], "the stream finds 2: "),
        ([OPEN, OPEN, OPEN, OPEN], "the stream finds 1, and none in 1 split group: "),
    ],
)
def test_a_note_says_how_many_of_the_numbered_grasps_the_stream_finds(
    tmp_path, monkeypatch, second, text
):
    frames = [[OPEN, CUP[70], CUP[70], OPEN], second]
    recordings = recordings_at(tmp_path / "table", frames, grasp=[0, 0, 1, 1] * 2)
    known = numbered((0, 0, 1, 3, True), (0, 1, 1, 3, True), (1, 0, 1, 4, True), (1, 1, 1, 4, True))
    monkeypatch.setattr(live, "numbered_grasps", lambda *_: known)
    names = np.array(recordings.recordings)
    whole = Trials(np.ones((1, 2, 2), int), np.ones(2, int), np.array([3, 4]), names, 5)
    classes = replace(table(), classes=CLASSES)
    _, (note,) = answer_live(Stream, recordings, classes, whole, whole.correct[0], recipe())
    assert note.text.startswith(f"the recordings have 4 tested grasps, {text}")


def test_at_high_rates_answers_are_requested_twenty_times_a_second(tmp_path):
    frames = [[OPEN, *[CUP[70]] * 1001, OPEN]]
    recordings = recordings_at(tmp_path / "table", frames, step=0.001)
    streams = []

    def new_stream():
        streams.append(Stream())
        return streams[-1]

    _, answers, _ = stream_grasps(new_stream, recordings, numbered((0, 0, 1, 3, True)), CLASSES)
    expected = [*np.arange(21) / 20, 1.0]
    assert answers["contact"].tolist() == pytest.approx(expected)
    assert streams[0].answers_requested == 1 + 21  # before contact each frame may begin it


def test_recordings_are_taken_as_long_as_their_frames_and_answers_are_few_enough(
    tmp_path, monkeypatch
):
    recordings = recordings_at(tmp_path / "table", [[OPEN] * 11] * 10)  # 2 s each
    numbers = np.arange(10)
    assert affordable(recordings, numbers).tolist() == list(range(10))
    monkeypatch.setattr(live, "MOST_ANSWERS", 33)  # 11 a recording, since it has 11 frames
    assert affordable(recordings, numbers).tolist() == [0, 4, 9]
    monkeypatch.setattr(live, "ANSWERS_A_SECOND", 2)  # 4 a recording
    assert len(affordable(recordings, numbers)) == 8
    monkeypatch.setattr(live, "MOST_FRAMES", 12)
    assert affordable(recordings, numbers).tolist() == [0]


def test_the_sets_of_a_grasp_are_those_of_its_kept_frames():
    frames = table()
    known = numbered_grasps(frames, TEST)
    sides = frames.columns.groupby(["recording", "grasp"])["side"].agg(set)
    assert len(known) == len(sides)
    for row in known.itertuples():
        assert row.is_tested == (sides[row.recording, row.grasp] == {TEST})
    assert known["is_tested"].any()
    assert numbered_grasps(frames, TRAIN)["is_tested"].any()


@pytest.mark.parametrize(
    ("is_right", "error"),
    [([1, 0, 1], 0.0), ([0, 1, 0], 1.0), ([1, 0, 0], 0.5), ([np.nan, 0, 0], 1.0)],
)
def test_the_row_of_predict_is_of_the_recordings_that_are_streamed(
    three, monkeypatch, is_right, error
):
    """The first and the last recording are streamed."""
    frames = replace(table(), classes=CLASSES)
    monkeypatch.setattr(live, "numbered_grasps", lambda *_: THREE_NUMBERED)
    monkeypatch.setattr(live, "MOST_FRAMES", 14)  # of 18: two of three recordings
    best = np.array([[[1, 0], [1, 0], [0, 1]]])
    labels = np.array([1, 2, 0])
    whole = Trials(best, labels, labels, np.array(three.recordings), 5)
    rows, (note,) = answer_live(Stream, three, frames, whole, np.array(is_right), recipe())
    assert rows[-1]["answer"] == "predict"
    assert rows[-1]["error"] == error
    assert note.text.startswith("2 of 3 recordings, evenly chosen, were answered")


def test_there_is_no_row_of_predict_if_it_has_no_answer(three, monkeypatch):
    monkeypatch.setattr(live, "numbered_grasps", lambda *_: THREE_NUMBERED)
    labels = np.array([1, 2, 0])
    whole = Trials(labels[None, :, None], labels, labels, np.array(three.recordings), 5)
    classes = replace(table(), classes=CLASSES)
    rows, _ = answer_live(Stream, three, classes, whole, np.full(3, np.nan), recipe())
    assert "predict" not in [row["answer"] for row in rows]


@pytest.mark.parametrize(("held", "warns"), [(1, True), (2, False)])
def test_a_stream_that_finds_most_grasps_silent_is_a_warning(tmp_path, monkeypatch, held, warns):
    frames = [[OPEN, CUP[70], OPEN]] * held + [[OPEN, OPEN, OPEN]] * (4 - held)
    recordings = recordings_at(tmp_path / "table", frames)
    known = numbered(*[(index, 0, 1, index, True) for index in range(4)])
    monkeypatch.setattr(live, "numbered_grasps", lambda *_: known)
    labels = np.ones(4, dtype=int)
    names = np.array(recordings.recordings)
    whole = Trials(labels[None, :, None], labels, np.arange(4), names, 5)
    classes = replace(table(), classes=CLASSES)
    _, notes = answer_live(Stream, recordings, classes, whole, np.ones(4), recipe())
    texts = [note.text for note in notes if note.level == "warning"]
    assert len(texts) == warns
    if warns:
        assert "no contact in 3 of 4 grasps" in texts[0] and "--tare" in texts[0]
