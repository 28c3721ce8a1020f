"""On a terminal, `live` shows one line that fits it, and a line for each final answer."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.live import view as module
from tactile_viewgcn.live.stream import Update
from tactile_viewgcn.live.view import CLEAR, JsonView, TerminalView, described, fitted

HELD = Update("answer", 41, 4.1, "mug", 0.62, np.array([0.38, 0.62], np.float32), 20, 2.0)


def columns(text):
    """Return how many columns of a terminal a text takes. Chinese letters take two."""
    wide = [letter for letter in text if "\u4e00" <= letter <= "\u9fff"]
    return len(text) + len(wide)


@pytest.fixture
def clock(monkeypatch):
    """Replace the module `time`, and return the replacement, whose attribute `now` is the time."""

    class Clock:
        now = 100.0

        def monotonic(self):
            return self.now

    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    return clock


def terminal(width=80):
    """Return a view on a terminal, and the lists of the texts that it prints and says."""
    printed = []
    errors = []
    view = TerminalView(printed.append, errors.append, width=lambda: width, letters="#.")
    return view, printed, errors


def test_a_line_has_state_object_bar_percent_and_seconds():
    text = described(HELD)
    assert text.split() == ["answer", "mug", 12 * "#" + 8 * ".", "62", "%", "2.0", "s"]
    assert described(replace(HELD, seconds=None)).endswith("62 %  20 frames")
    assert described(replace(HELD, probability=1.0)).count("#") == 20
    assert described(replace(HELD, probability=0.02)).count("#") == 0
    assert described(replace(HELD, object="m\x1b[31mug")).count("\x1b") == 0
    contact = Update("contact", 3, 0.3, frames=1, seconds=0.0)
    assert described(contact) == "contact  no answer yet  0.0 s"
    assert described(replace(contact, note="too weak")) == "contact  no answer: too weak  0.0 s"
    assert described(Update("waiting", 0)) == "waiting  open your hand"
    assert described(Update("ready", 4)) == "ready    take an object"


@pytest.mark.parametrize("name", ["mug", "a very long name of an object " * 3, "茶碗" * 30])
@pytest.mark.parametrize("width", [80, 40, 20])
def test_the_line_fits_the_terminal_and_ends_with_the_frames_a_second(clock, name, width):
    view, printed, _ = terminal(width)
    for frame in range(150):
        clock.now = 100 + frame / 50
        view.count_frame()
    view.show(replace(HELD, object=name), 7)
    view.draw()
    (text,) = printed
    assert text.startswith(CLEAR) and text.endswith("  50 frames/s")
    assert columns(text.removeprefix(CLEAR)) <= width - 1


def test_it_is_drawn_at_once_where_the_state_changes_and_else_twenty_times_a_second(clock):
    view, printed, errors = terminal()
    view.show(Update("ready", 4), 5)
    view.draw()
    for frame in range(100):
        clock.now = 200 + frame / 1000
        view.show(HELD, 6 + frame)
        view.draw()
    assert len(printed) == 1 + 2
    clock.now += 0.01
    view.say("line 9: no frame: a\tword")
    view.draw()
    assert errors == ["line 9: no frame: a\\tword\n"] and printed[-2] == CLEAR
    assert "mug" in printed[-1]


def test_the_lines_of_final_answers_stay(clock):
    view, printed, _ = terminal()
    view.show(HELD, 5)
    view.draw()
    view.show(replace(HELD, state="final", note="the input ended in the grasp " * 3), 6)
    view.end()
    final = printed[1].removeprefix(CLEAR)
    assert final.startswith("final    mug")
    assert final.endswith("\n")
    assert len(final) <= 80
    assert printed[2:] == ["\r\x1b[K"]  # to the beginning of the line, which is cleared


def test_a_text_is_cut_or_filled_to_columns():
    assert fitted("mug", 5) == "mug  " and fitted("mugs", 2) == "mu"
    assert fitted("茶碗", 3) == "茶 " and fitted("e\u0301e", 2) == "e\u0301e"


def test_json_has_letters_of_a_terminal_escaped():
    printed = []
    view = JsonView(printed.append, printed.append, ["a", "m\x1b\nü"])
    view.show(replace(HELD, object="m\x1b\nü"), 3)
    assert printed[0].count("\n") == 1
    assert "\x1b" not in printed[0]
    assert printed[0].isascii()
