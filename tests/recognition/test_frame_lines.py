"""Lines of text as frames, each once it is whole."""

import io
from dataclasses import replace

import numpy as np
import pytest
from tactile_viewgcn.recognition.frame_lines import lines_as_they_come, read_frame

from tactile_viewgcn.errors import UserError
from tests.small_glove import recogniser


def four_sensors():
    """The preprocessing of a model of 2 x 2 sensors with integer counts."""
    return replace(recogniser().preprocessing, live=np.ones((2, 2), bool))


@pytest.mark.parametrize(
    "text", ["1,2,3,4", "[1, 2, 3, 4]", "[[1, 2], [3, 4]]", '{"pressure": [[1, 2], [3, 4]], "time": 0.5}']
)
def test_a_line_is_numbers_with_commas_or_json(text):
    counts, seconds = read_frame(text, 1, four_sensors())
    np.testing.assert_array_equal(counts, [[1, 2], [3, 4]])
    assert seconds == 0.5 if "time" in text else np.isnan(seconds)


@pytest.mark.parametrize(
    "text, message",
    [
        ("1,2,3", r"line 7: 3 numbers; expected 2 x 2 = 4"),
        ("1,2,x,4", r"line 7: ValueError .*expected 4 numbers with commas"),
        ("", r"line 7: ValueError"),
        ('{"counts": [1, 2, 3, 4]}', r"line 7: KeyError"),
        ("[1, 2", r"line 7: JSONDecodeError"),
        ("1,2,nan,4", r"line 7 holds nan; expected a number up to 1e\+30 from every sensor"),
        ("1,2,2.5,4", r"line 7 holds 2.5; expected whole numbers, raw counts as in training"),
    ],
)
def test_any_other_line_is_refused_by_its_number(text, message):
    with pytest.raises(UserError, match=message):
        read_frame(text, 7, four_sensors())


def test_a_line_of_a_growing_file_comes_once_it_is_whole(monkeypatch):
    parts = iter([b"1,2", b"", b"\n", b"", b"3\n", KeyboardInterrupt])

    class Growing(io.BytesIO):
        def readline(self):
            part = next(parts)
            if part is KeyboardInterrupt:
                raise part
            return part

    monkeypatch.setattr("tactile_viewgcn.recognition.frame_lines.WAIT", 0)
    come = lines_as_they_come(Growing(), grows=True)
    assert [next(come), next(come)] == ["1,2\n", "3\n"]
    with pytest.raises(KeyboardInterrupt):
        next(come)
    assert list(lines_as_they_come(io.BytesIO(b"1\n\xff2"), grows=False)) == ["1\n", "\ufffd2"]
