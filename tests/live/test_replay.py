"""The command `replay` prints a recording's lines at their times, and ends quietly."""

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn.live import replay as module
from tactile_viewgcn.live.replay import replay
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.readers.source import Form
from tests.readers.files import save

ROOT = Path(__file__).parents[2]
LOGGED = """timestamp,thumb,index
1700000000.0,512.1,498
1700000000.5,0.1,-3e-07
1700000002.0,530.6,499.25
"""


class Clock:
    """A replacement of the module `time`, in which a sleep takes no time."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


def played(source, monkeypatch, *, speed=1.0, name=None):
    """Return the lines of a recording, the seconds at which they were printed, and the note."""
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    lines = []
    seconds = []
    notes = []

    def print_line(line):
        lines.append(line)
        seconds.append(clock.now - 100)

    form = Form(labelled=False)
    replay(str(source), form, name=name, speed=speed, out=print_line, note=notes.append)
    return lines, seconds, notes


def test_a_table_with_names_begins_with_them_and_keeps_its_numbers_and_its_pace(
    tmp_path, monkeypatch
):
    (tmp_path / "1.csv").write_text(LOGGED)
    lines, seconds, notes = played(tmp_path / "1.csv", monkeypatch)
    assert lines == [
        "time,thumb,index",
        "0.0,512.1,498.0",
        "0.5,0.1,-3e-07",
        "2.0,530.6,499.25",
    ]
    assert seconds == [0, 0, 0.5, 2]
    assert notes == ["1: 3 frames by their times, about 1 a second"]
    _, seconds, notes = played(tmp_path / "1.csv", monkeypatch, speed=4)
    assert seconds == [0, 0, 0.125, 0.5]
    assert notes[0].endswith(", 4 times as fast")
    _, seconds, notes = played(tmp_path / "1.csv", monkeypatch, speed=0)
    assert seconds == [0] * 4 and notes == ["1: 3 frames as fast as possible"]


def test_names_without_times_stand_above_the_sensors_alone(tmp_path, monkeypatch):
    (tmp_path / "1.csv").write_text("thumb,palm\n1.5,2\n1.75,3\n")
    lines, _, notes = played(tmp_path / "1.csv", monkeypatch, speed=2)
    assert lines == ["thumb,palm", "1.5,2.0", "1.75,3.0"]
    assert notes == ["1: 2 frames without times, at 10 a second, 2 times as fast"]


def test_an_array_has_no_names_its_rows_stand_one_after_another_and_the_rate_is_said(
    tmp_path, monkeypatch
):
    counts = np.arange(18, dtype=np.int16).reshape(3, 2, 3)
    save(tmp_path / "1.npy", counts)
    lines, seconds, notes = played(tmp_path / "1.npy", monkeypatch)
    assert lines == ["0,1,2,3,4,5", "6,7,8,9,10,11", "12,13,14,15,16,17"]
    assert seconds == pytest.approx([0, 0.1, 0.2])
    assert notes == ["1: 3 frames without times, at 10 a second"]


def test_numbers_in_single_precision_are_read_back_as_they_were(tmp_path, monkeypatch):
    counts = np.random.default_rng(0).normal(size=(4, 1, 5)).astype(np.float32)
    save(tmp_path / "1.npy", counts)
    lines, _, _ = played(tmp_path / "1.npy", monkeypatch, speed=0)
    read = np.array([line.split(",") for line in lines], dtype=np.float32)
    assert (read == counts[:, 0]).all()
    assert max(map(len, lines[0].split(","))) < 14


def test_a_slow_reader_costs_the_wait_and_no_frame(tmp_path, monkeypatch):
    (tmp_path / "1.csv").write_text(LOGGED)
    clock = Clock()
    monkeypatch.setattr(module, "time", clock)
    seconds = []

    def print_line(line):
        seconds.append(clock.now - 100)
        clock.now += 0.75  # the reader takes that long

    form = Form(labelled=False)
    replay(str(tmp_path / "1.csv"), form, name=None, speed=1, out=print_line, note=str)
    assert seconds == [0, 0.75, 1.5, 2.75]


def test_of_several_recordings_one_has_to_be_named(tmp_path, monkeypatch):
    for index in range(3):
        save(tmp_path / "mug" / f"{index}.npy", np.full((2, 2, 2), index, dtype=np.int16))
    with pytest.raises(UserError, match=r"3 recordings; expected --name of mug/0, mug/1, mug/2"):
        played(tmp_path, monkeypatch)
    with pytest.raises(UserError, match="no recording 4; expected --name of mug/0, mug/1, mug/2"):
        played(tmp_path, monkeypatch, name="4")
    assert played(tmp_path, monkeypatch, name="mug/2")[0] == ["2,2,2,2"] * 2


@pytest.mark.parametrize("speed", [1e-300, np.nan, np.inf, -1.0])
def test_a_speed_that_is_none_is_refused(tmp_path, monkeypatch, speed):
    (tmp_path / "1.csv").write_text(LOGGED)
    with pytest.raises(UserError, match=rf"--speed {speed:g}; expected 0 or a number from 0\.001"):
        played(tmp_path / "1.csv", monkeypatch, speed=speed)
    assert played(tmp_path / "1.csv", monkeypatch, speed=0.001)[1] == [0, 0, 500, 2000]


def command(source, *words, stdout):
    """Start the command `replay`."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, "-m", "tactile_viewgcn", "replay", str(source), *words],
        env=environment,
        stdout=stdout,
        stderr=subprocess.PIPE,
        text=True,
        # tests that run in the background ignore Ctrl-C, and so would the command
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )


def test_it_ends_quietly_when_nobody_reads_the_lines_any_more(tmp_path):
    save(tmp_path / "1.npy", np.zeros((5000, 4, 4), dtype=np.int16))
    with command(tmp_path / "1.npy", "--speed", "0", stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == "0," * 15 + "0\n"
        process.stdout.close()
        assert process.stderr.read() == "1: 5,000 frames as fast as possible\n"


def test_each_line_is_there_when_its_frame_is_due_and_ctrl_c_ends_it_quietly(tmp_path):
    save(tmp_path / "1.npy", np.zeros((5000, 4, 4), dtype=np.int16))
    with command(tmp_path / "1.npy", stdout=subprocess.PIPE) as process:
        for _ in range(3):  # of 500 seconds
            assert process.stdout.readline() == "0," * 15 + "0\n"
        process.send_signal(signal.SIGINT)
        assert process.stderr.read() == "1: 5,000 frames without times, at 10 a second\n"
        assert process.wait() == 130
