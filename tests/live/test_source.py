"""The lines of the input are joined from parts, and have times and a longest length."""

import time

from tactile_viewgcn.live.source import LONGEST_LINE, LineSource


def read(parts, pause=0.0):
    """Return a function that returns the parts in turn."""
    rest = iter(parts)

    def next_part(_):
        time.sleep(pause)
        return next(rest, b"")

    return next_part


def lines_of(source):
    """Return all lines of the input."""
    lines = []
    while not source.has_ended:
        line = source.next(0.2)
        if line is not None:
            lines.append(line)
    return lines


def test_parts_are_joined_at_the_ends_of_the_lines():
    source = LineSource(read([b"1,", b"2", b"\n3,4\n\n5", b",6", b"\n7", b",8"]))
    assert lines_of(source) == [b"1,2", b"3,4", b"", b"5,6"]
    assert source.cut == b"7,8" and source.number == 4


def test_a_line_that_goes_on_for_long_is_kept_up_to_the_limit_in_linear_time():
    """The time would be quadratic if each read copied the line so far."""
    parts = 8192 * [b"1" * 4096]
    source = LineSource(read([*parts, b"\n1,2\n"]))
    begin = time.process_time()
    first, second = lines_of(source)
    assert time.process_time() - begin < 5
    assert len(first) == LONGEST_LINE and second == b"1,2"


def test_a_line_comes_with_its_end():
    source = LineSource(read([b"1,2\n", *10 * [b"1 "], b"\n"], pause=0.05))
    while source.number < 1:
        source.next(0.01)
    first = source.came_at
    while len(source.cut) < 20:
        assert source.next(0.01) is None
    assert source.came_at == first and time.monotonic() - first > 0.45
    assert source.next(5.0) == b"1 " * 10 and source.came_at - first > 0.5
