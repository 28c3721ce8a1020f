"""Progress without a terminal: lines, by a clock of the test's own."""

import pytest

from tactile_viewgcn import progress
from tactile_viewgcn.progress import say, shown, steps, working


@pytest.fixture
def now(monkeypatch):
    """Return a list whose only item is the time."""
    time = [0.0]
    monkeypatch.setattr(progress, "clock", lambda: time[0])
    # tqdm's thread looks at the real clock
    monkeypatch.setattr(progress._Lines, "monitor_interval", 0)
    return time


def test_a_line_comes_every_ten_seconds_with_the_time_that_is_left(now, capsys):
    with shown():
        for _ in steps(range(40), "reading", "files"):
            now[0] += 4.0
    assert capsys.readouterr().err.splitlines()[:2] == [
        "reading: 3 of 40 files, about 148 s left",
        "reading: 6 of 40 files, about 136 s left",
    ]


def test_what_takes_less_than_ten_seconds_and_a_program_that_does_not_ask_print_nothing(
    now, capsys
):
    with shown():
        assert list(steps(range(3), "reading", "files")) == [0, 1, 2]
    for _ in steps(range(40), "reading", "files"):
        now[0] += 60
    say("done")
    assert capsys.readouterr() == ("", "")


def test_one_line_names_the_steps_that_are_under_way_and_waits_after_any_other_line(now, capsys):
    with shown(), working("finetune"):
        for fold in steps(range(2), "svm", "folds"):
            now[0] += 9
            say(f"fold {fold} begins")
            with progress.progress("solving", "parts", 4, done=1) as bar:
                for _ in range(3):
                    now[0] += 6
                    bar.update()
    assert capsys.readouterr().err.splitlines() == [
        "fold 0 begins",
        "finetune: 21 s; svm: 0 of 2 folds; solving: 3 of 4 parts, about 6 s left",
        "fold 1 begins",
        "finetune: 48 s; svm: 1 of 2 folds, about 48 s left; solving: 3 of 4 parts, about 6 s left",
    ]


def test_a_step_in_which_nothing_is_counted_says_that_it_goes_on(now, capsys):
    with shown(), working("preprocess"):
        (bar,) = progress._Lines.under_way
        now[0] += 25
        bar.miniters = 1  # as tqdm's monitor does before it calls
        bar.refresh()
        assert bar.miniters > 1  # the monitor calls again
    assert capsys.readouterr().err == "preprocess: 25 s\n"
    assert progress._Lines.under_way == []
