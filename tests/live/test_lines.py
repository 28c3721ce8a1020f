"""Lines are read as frames by their columns, and lines that are no frames are refused."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactile_viewgcn.live.lines import FrameLines, LineError
from tactile_viewgcn.live.source import LONGEST_LINE
from tactile_viewgcn.messages import UserError

NAMES = ["thumb", "index", "palm"]


def frames(lines, sensors=NAMES, shape=(1, 3)):
    """Return the readings and times of the lines that are frames, and all notes."""
    reader = FrameLines(shape, sensors)
    found = [reader.frame(line.encode()) for line in lines]
    rows = [(frame.counts.ravel().tolist(), frame.time) for frame in found if frame is not None]
    return rows, reader.notes


@pytest.mark.parametrize(
    "lines",
    [
        ["1,2.5,-3"],
        ["1;2,5;-3"],
        ["1\t2.5\t-3\r\n"],
        ["  1  2.5   -3 "],
        ["1, 2.5, -3,"],
        ["# a comment", "", "% another", "1,2.5,-3e0"],
        ["\ufeff1,2.5,-3"],
        ["thumb,index,palm", "1,2.5,-3"],
        ['"palm";"thumb";"index"', "-3;1;2,5"],
        ["palm\tnote\tthumb\tindex", "-3\ta word\t1\t2.5"],
        ["palm,thumb,index", "-3,1,2.5"],
    ],
)
def test_a_line_is_a_frame_in_the_order_of_the_model_s_sensors(lines):
    assert frames(lines)[0] == [([1, 2.5, -3], None)]


@pytest.mark.parametrize(
    ("name", "seconds"),
    [("time", 4), ("timestamp", 4), ("time_ms", 4e-3), ("t [us]", 4e-6), ("header.time", 4)],
)
def test_a_column_of_times_is_named_in_seconds_or_by_its_unit(name, seconds):
    rows, notes = frames([f"thumb,{name},index,palm", "1,4,2,3"])
    assert rows == [([1, 2, 3], pytest.approx(seconds))] and notes == []
    rows, notes = frames([f"{name},a,b,c", "4,1,2,3"], sensors=[])
    assert rows == [([1, 2, 3], pytest.approx(seconds))] and notes == []


def test_columns_that_are_no_sensors_of_the_model_are_named():
    rows, notes = frames(["sample,palm,thumb,index,elbow", "7,3,1,2,9"])
    assert rows == [([1, 2, 3], None)]
    assert notes == ["2 columns left out, no sensors of the model: sample, elbow"]


def test_names_that_come_again_are_read_over_and_may_change_their_order():
    reader = FrameLines((1, 3), NAMES)
    lines = [b"thumb,index,palm", b"1,2,3", b"thumb,index,palm", b"palm,index,thumb", b"3,2,1"]
    found = [reader.frame(line) for line in lines]
    assert [frame is None for frame in found] == [True, False, True, True, False]
    np.testing.assert_array_equal(found[1].counts, found[4].counts)
    assert reader.notes == ["the names of the columns again: read on"]


def test_an_array_is_read_row_after_row():
    reader = FrameLines((2, 3), [])
    assert reader.frame(b"1,2,3,4,5,6").counts.tolist() == [[1, 2, 3], [4, 5, 6]]


def test_numbers_of_columns_at_the_top_are_no_frame():
    rows, notes = frames(["0,1,2", "5,6,7", "0,1,2"], sensors=[])
    assert rows == [([5, 6, 7], None), ([0, 1, 2], None)] and len(notes) == 1


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("1,2", "2 values; expected 3"),
        ("1,2,3,4", "4 values; expected 3; if one of them is the time"),
        ("1,two,3", "column 2 holds 'two'; expected a number"),
        ("1,,3", "column 2 holds ''"),
        ("1,2_0,3", "column 2 holds '2_0'"),
        ("1,2,0x10", "column 3 holds '0x10'"),
        ("ready", "1 value; expected 3"),
        ("glove is ready", "(1 value; expected 3|column 1 holds 'glove')"),
        ("1,2,3\0", "it is no text"),
        ("1,2," + "3" * LONGEST_LINE, "bytes or more; expected a frame"),
    ],
)
@pytest.mark.parametrize("before", [[], ["5,6,7"], ["thumb,index,palm"]])
def test_a_line_that_is_no_frame_is_refused_and_the_next_one_is_read(line, message, before):
    reader = FrameLines((1, 3), NAMES)
    for other in before:
        reader.frame(other.encode())
    if before == ["thumb,index,palm"]:
        message = message.partition("; if")[0]
    with pytest.raises(LineError, match=message):
        reader.frame(line.encode())
    assert reader.frame(b"5,6,7").counts.tolist() == [[5, 6, 7]]


def test_a_time_that_is_no_number_makes_a_line_no_frame():
    reader = FrameLines((1, 3), NAMES)
    reader.frame(b"time,thumb,index,palm")
    with pytest.raises(LineError, match="the time is no finite number"):
        reader.frame(b"nan,1,2,3")
    with pytest.raises(LineError, match="column 1 holds 'noon'"):
        reader.frame(b"noon,1,2,3")


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["thumb,index,wrist"], "no column palm of the model's sensors; found thumb, index, wrist"),
        (["thumb,index,palm,palm"], "are named thumb, index, palm, palm; expected the model's"),
        (["a,b,c", "1,2,3"], "the columns are named a, b, c; expected the model's sensors among"),
    ],
)
def test_columns_without_a_sensor_of_the_model_end_the_input(lines, message):
    """Otherwise the readings of other sensors would be answered."""
    reader = FrameLines((1, 3), NAMES)
    with pytest.raises(UserError, match=message) as error:
        for line in lines:
            with suppress(LineError):
                reader.frame(line.encode())
    assert not isinstance(error.value, LineError)


def test_without_names_in_the_model_a_line_of_words_names_as_many_columns_once():
    rows, _ = frames(["a,b,c", "1,2,3"], sensors=[])
    assert rows == [([1, 2, 3], None)]
    rows, _ = frames(["time,thumb,index,ring", "0.5,1,2,3"], sensors=[])
    assert rows == [([1, 2, 3], 0.5)]  # the index finger
    rows, _ = frames(["index,thumb,middle,ring", "7,1,2,3"], sensors=[])
    assert rows == [([1, 2, 3], None)]  # the number of the line
    rows, _ = frames(["time,seq,thumb,index,ring", "0.5,9,1,2,3"], sensors=[])
    assert rows == [([1, 2, 3], 0.5)]
    with pytest.raises(LineError, match="names 2 sensors"):
        frames(["time,seq,thumb,ring"], sensors=[])
    reader = FrameLines((1, 3), [])
    with pytest.raises(LineError, match="names 4 sensors: a, b, c, d; expected 3"):
        reader.frame(b"a,b,c,d")
    reader.frame(b"a,b,c")
    reader.frame(b"1,2,3")
    with pytest.raises(LineError, match="column 1 holds 'x'"):
        reader.frame(b"x,y,z")


def results(lines, sensors=NAMES):
    """Return for each line the readings, None if it is no frame, or the message of its error."""
    reader = FrameLines((1, 3), sensors)
    found = []
    for line in lines:
        try:
            frame = reader.frame(line.encode())
        except LineError as error:
            found.append(str(error))
        else:
            found.append(None if frame is None else frame.counts.ravel().tolist())
    return found


@pytest.mark.parametrize("mark", ["#", "# ", "%", "## "])
def test_names_behind_the_mark_of_a_comment_are_names(mark):
    rows, notes = frames([f"{mark}index,thumb,palm", "2,1,3", "# thumb,index,palm", "1,2,3"])
    assert rows == [([1, 2, 3], None)] * 2 and notes == []
    rows, _ = frames([f"{mark}time,a,b,c", "0.5,1,2,3"], sensors=[])
    assert rows == [([1, 2, 3], 0.5)]


@pytest.mark.parametrize("comment", ["# logged by hand", "# palm", "# palm is new", "# 1 2 3"])
@pytest.mark.parametrize("sensors", [NAMES, []])
def test_a_comment_that_names_no_columns_is_none(comment, sensors):
    lines = [comment, "1,2,3", comment, "1,2,3"]
    assert results(lines, sensors) == [None, [1, 2, 3]] * 2


@pytest.mark.parametrize("names", ["thumb,index,wrist", "a,b,c"])
def test_names_of_other_sensors_behind_the_mark_of_a_comment_end_the_input(names):
    reader = FrameLines((1, 3), NAMES)
    assert reader.frame(f"# {names}".encode()) is None
    with pytest.raises(UserError, match=f"named {names.replace(',', ', ')}; expected the") as error:
        reader.frame(b"1,2,3")
    assert not isinstance(error.value, LineError)


def test_names_below_the_names_such_as_units_are_no_frame_and_no_error():
    assert results(["thumb,index,palm", "# N,N,N", "1,2,3"])[-1] == [1, 2, 3]
    found = results(["thumb,index,palm", "N,N,N", ",,", "1,2,3"])
    assert found[1].startswith("column 1 holds 'N'") and found[3] == [1, 2, 3]


@pytest.mark.parametrize("sensors", [NAMES, []])
@pytest.mark.parametrize("before", [[], ["1,2,3"]])
def test_a_carriage_return_in_a_line_is_refused(sensors, before):
    found = results([*before, "loading,x\rready,now", "1,2,3\r4,5,6\r\n", "1,2,3\r"], sensors)
    assert found[-1] == [1, 2, 3]
    assert all(text.startswith("it has a carriage return in it") for text in found[-3:-1])


@pytest.mark.parametrize("row", ["1,2,3", "1;2;3", "1 2 3"])
@pytest.mark.parametrize("message", ["glove is ready", "glove,is,ready"])
def test_without_names_in_the_model_a_message_of_as_many_words_names_nothing(row, message):
    assert results([message, row, row], sensors=[]) == [None, [1, 2, 3], [1, 2, 3]]
    found = results([row, message, row], sensors=[])
    assert found[::2] == [[1, 2, 3]] * 2 and isinstance(found[1], str)


def test_a_message_between_the_names_and_the_first_frame_takes_no_names_away():
    rows, _ = frames(["time,a,b,c", "glove is ready", "0.5,1,2,3"], sensors=[])
    assert rows == [([1, 2, 3], 0.5)]
    # nor are the cells of half a line those of a line without names
    found = results(["time,a,b,c", "0.5,1,2", "0.5,1,2,3"], sensors=[])
    assert found == [None, "3 values; expected 4", [1, 2, 3]]


@pytest.mark.parametrize(
    ("before", "message"),
    [
        (["1,2,3"], "warning: thumb disconnected"),
        (["1,2,3"], "palm,disconnected,now"),
        (["1 2 3"], "low battery now"),
        (["1 2 3"], "thumb is off"),
        (["thumb,index,palm", "1,2,3"], "warning: thumb disconnected"),
        (["thumb,index,palm", "1,2,3"], "thumb,disconnected"),
        (["thumb index palm", "1 2 3"], "low battery now"),
    ],
)
def test_a_message_after_the_first_frame_is_refused_and_the_frames_go_on(before, message):
    *_, refused, frame = results([*before, message, before[-1]])
    assert "expected" in refused and frame == [1, 2, 3]


def test_between_tabs_the_first_and_the_last_cell_may_be_empty_if_their_columns_are_left_out():
    assert results(["note\tthumb\tindex\tpalm", "\t1\t2\t3", "x\t1\t2\t3"])[1:] == [[1, 2, 3]] * 2
    assert results(["thumb\tindex\tpalm\tnote", "1\t2\t3\t", "1\t2\t3\tx"])[1:] == [[1, 2, 3]] * 2
    assert results(["thumb\tindex\tpalm\t", "1\t2\t3\t"]) == [None, [1, 2, 3]]
    found = results(["thumb\tindex\tpalm", "\t2\t3", "1\t2\t"])
    assert found[1].startswith("column 1 holds ''")
    assert found[2].startswith("column 3 holds ''")


@pytest.mark.parametrize("names", ["thumb,index,wrist", "a,b,c"])
def test_names_like_those_of_the_frames_end_the_input_after_frames_too(names):
    with pytest.raises(UserError, match=names.replace(",", ", ")):
        results(["thumb,index,palm", "1,2,3", names, "1,2,3"])


CELLS = st.sampled_from(
    ["thumb", "index", "palm", "time", "note", "1", "-2.5", "nan", "", "x", "_", "# ", "\r", "x\ry"]
)
LINES = st.one_of(
    st.binary(max_size=40),
    st.builds(
        lambda cells, mark: mark.join(cells).encode(),
        st.lists(CELLS, max_size=6),
        st.sampled_from([",", ";", "\t", " ", ", "]),
    ),
)


@pytest.mark.parametrize("sensors", [NAMES, []])
@given(lines=st.lists(LINES, max_size=8))
def test_of_any_lines_each_is_a_whole_frame_or_none_or_refused(sensors, lines):
    reader = FrameLines((1, 3), sensors)
    for line in lines:
        try:
            frame = reader.frame(line)
        except UserError:
            continue
        assert frame is None or frame.counts.shape == (1, 3)


@pytest.mark.parametrize("fingers", ["thumb,index,palm", "s1,s2,s3"])
@pytest.mark.parametrize("time", ["", ",time"])
def test_a_first_column_without_a_name_is_the_number_of_the_line(fingers, time):
    """Pandas writes it. The finger `index` beside it is a sensor."""
    cells = ["0,1,2,3", "1,4,5,6"]
    if time:
        cells = [f"{line},0.5" for line in cells]
    rows, notes = frames([f",{fingers}{time}", *cells], sensors=[])
    assert [readings for readings, _ in rows] == [[1, 2, 3], [4, 5, 6]]
    assert notes == ["1 column left out, no sensors of the model: no name"]
