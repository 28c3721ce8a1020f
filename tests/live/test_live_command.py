"""The command `live` answers each change, and says of a bad line what is wrong and its number."""

import json
import os
import signal
import subprocess
import sys
import time
import warnings
from functools import partial

import numpy as np
import pandas as pd
import pytest

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.live import command as module
from tactile_viewgcn.live.command import LiveCommand
from tactile_viewgcn.live.lines import FrameLines
from tactile_viewgcn.live.source import LineSource
from tactile_viewgcn.live.view import JsonView, View
from tactile_viewgcn.messages import UserError
from tests.conftest import ROOT
from tests.glove_data import model_file, recogniser, recording


def lines_of(frames):
    """Return each frame as a line of numbers with commas."""
    return [",".join(map(str, counts.ravel())) for counts in frames]


GRASP = lines_of(recording("cup", 130, before=12, held=8, after=8))
NUMBERED = "the sensor in row 1, column 2 reads"


def with_cell(line, cell):
    """Return the line with another second cell."""
    first, _, *others = line.split(",")
    return ",".join([first, cell, *others])


class Pipe:
    """A pipe that returns bytes in parts, like `os.read`.

    Args:
        parts: bytes, or the seconds until the next part.
    """

    def __init__(self, *parts):
        self.parts = list(parts)

    def __call__(self, size):
        if not self.parts:
            return b""
        if isinstance(self.parts[0], float):
            time.sleep(self.parts.pop(0))
        part = self.parts.pop(0)
        if len(part) > size:
            self.parts.insert(0, part[size:])
        return part[:size]


def run(*parts, model=None, as_json=True, skips=False, **options):
    """Return the exit code, the output, and the lines on standard error.

    Args:
        parts: the input, lists of lines, bytes, or seconds to wait.
        model: the recogniser, by default of the three objects.
        as_json: the output is records, and otherwise a text.
        skips: answers are skipped to keep up.
        options: options of the stream.
    """
    model = model or recogniser()
    printed = []
    errors = []
    data = [part if isinstance(part, bytes | float) else text_of(part) for part in parts]
    stream = model.stream(**options)
    view = View(printed.append, errors.append)
    if as_json:
        view = JsonView(printed.append, errors.append, model.classes)
    reader = FrameLines(model.shape, model.plan.channel_names)
    code = LiveCommand(stream, reader, view, skips=skips).run(LineSource(Pipe(*data)))
    output = "".join(printed)
    if as_json:
        output = [json.loads(line) for line in output.splitlines()]
    return code, output, "".join(errors).splitlines()


def text_of(lines):
    """Return lines as bytes."""
    return ("\n".join(lines) + "\n").encode()


def finals(records):
    """Return the records of final answers."""
    return [record for record in records if record["state"] == "final"]


def test_each_change_is_a_line_of_json_with_the_line_that_brought_it():
    code, records, errors = run(["# logged", *GRASP])
    assert code == 0 and errors == ["28 frames"]
    expected = ["waiting", "ready", "contact", *8 * ["answer"], "final", "ready"]
    assert [record["state"] for record in records] == expected
    assert [record["line"] for record in records[:4]] == [2, 6, 14, 14]
    (final,) = finals(records)
    assert (final["object"], final["frames"], final["frame"]) == ("cup", 8, 24)
    assert final["probabilities"]["cup"] == final["probability"]
    assert final["probability"] > 0.5
    assert sum(final["probabilities"].values()) == pytest.approx(1, abs=1e-5)


BAD = {
    "half a line": (GRASP[14][:99], "no frame: 25 values; expected 80"),
    "a cell more": (GRASP[14] + ",7", "no frame: 81 values; expected 80; if one of them is"),
    "a word": (with_cell(GRASP[14], "abc"), "no frame: column 2 holds 'abc'; expected a number"),
    "NaN": (with_cell(GRASP[14], "nan"), f"no frame: {NUMBERED} nan; expected whole numbers"),
    "infinite": (with_cell(GRASP[14], "inf"), f"no frame: {NUMBERED} inf; expected whole"),
    "a fraction": (with_cell(GRASP[14], "0.5"), f"no frame: {NUMBERED} 0.5; expected whole"),
    "too large": (with_cell(GRASP[14], "40000"), f"no frame: {NUMBERED} 40000; expected whole"),
    "a message": ("low battery", "no frame: 1 value; expected 80"),
    "no text": (GRASP[14] + "\0", "no frame: it is no text; expected numbers in UTF-8"),
}


@pytest.mark.parametrize(("line", "message"), BAD.values(), ids=BAD)
def test_a_line_that_is_no_frame_is_said_and_left_out(line, message):
    lines = [*GRASP[:14], line, *GRASP[14:]]
    code, records, errors = run(lines)
    assert code == 0
    assert len(errors) == 2 and errors[0].startswith(f"line 15: {message}"), errors
    assert errors[1] == "28 frames, 1 line without a frame"
    _, expected, _ = run(GRASP)
    assert finals(records)[0]["probabilities"] == finals(expected)[0]["probabilities"]


def test_of_many_bad_lines_a_few_are_said_and_all_are_counted():
    lines = [*GRASP[:6], *1234 * ["1,2"], *GRASP[6:]]
    _, records, errors = run(lines)
    heads = [error.partition(":")[0] for error in errors[:-1]]
    assert heads == [f"line {number}" for number in (*range(7, 17), 106, 1006)]
    assert "(100 lines so far, the next are counted)" in errors[10]
    assert errors[-1] == "28 frames, 1,234 lines without a frame"
    assert len(finals(records)) == 1


def test_a_last_line_without_an_end_may_be_cut_and_is_no_frame():
    whole = text_of(GRASP[:20])
    code, records, errors = run(whole + GRASP[20][:-1].encode())
    assert code == 0 and finals(records)[0]["frames"] == 8
    assert errors == [
        "line 21: no frame: the input ended in it, so it may be cut",
        "line 20: the input ended in the grasp",
        "20 frames, 1 line without a frame",
    ]


def test_lines_that_come_in_any_parts_are_the_same_lines():
    data = text_of(GRASP)
    _, expected, _ = run(data)
    _, records, _ = run(*[data[start : start + 97] for start in range(0, len(data), 97)])
    for record in (*records, *expected):
        record["time"] = record["seconds"] = None  # when the parts came
    assert records == expected


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "the input has 0 lines and no frame; expected a line of .* numbers, one for each"),
        (["low battery"] * 3, "the input has 3 lines and no frame"),
    ],
)
def test_an_input_without_a_frame_is_a_mistake(lines, message):
    content = "".join(f"{line}\n" for line in lines)
    with pytest.raises(UserError, match=message):
        run(content.encode())


def test_the_wait_for_an_open_hand_begins_with_the_first_frame(monkeypatch):
    monkeypatch.setattr(module, "MOST_WAITING", 1.0)
    _, _, errors = run(1.5, GRASP)
    assert errors == ["28 frames"]
    _, _, errors = run(GRASP[:1], 1.5, GRASP[1:])
    assert errors[0].startswith("line 1: no open hand in 1 frame, so no answer")


def test_a_glove_that_never_shows_an_open_hand_has_no_answer_and_a_line_that_says_so():
    cup = recording("cup", 131, before=0, held=40, after=0)
    code, records, errors = run(lines_of(cup))
    assert code == 0 and [record["state"] for record in records] == ["waiting"]
    assert errors[0].startswith("line 40: no open hand in 40 frames, so no answer: open your hand")
    assert errors[0].endswith("try --tare")
    assert errors[1:] == ["40 frames"]
    # readings that are never steady
    unsteady = lines_of(cup * (1 + np.arange(40) % 2)[:, None, None])
    _, _, errors = run(unsteady, tare=True)
    assert errors[0].endswith("is the glove or the unit a different one?")
    # without a baseline any steady frames are the open hand, so --tare would change nothing
    constant = recogniser("preprocess.baseline=none", "preprocess.filter=auto")
    _, _, errors = run(unsteady[:20], model=constant)
    assert errors[0].endswith("is the glove or the unit a different one?")


def test_frames_that_stop_are_said_once_and_the_stream_goes_on(monkeypatch):
    monkeypatch.setattr(module, "MOST_QUIET", 0.3)
    monkeypatch.setattr(module, "TICK", 0.05)
    code, records, errors = run(GRASP[:16], 1.0, GRASP[16:])
    assert code == 0
    assert errors == ["line 16: no line for 0 s; still reading", "28 frames"]
    assert finals(records)[0]["frames"] == 8


def test_an_input_that_has_ended_is_not_called_quiet(monkeypatch):
    monkeypatch.setattr(module, "MOST_QUIET", 0.0)  # as while a model was loaded
    _, _, errors = run(GRASP[:16], GRASP[16:])
    assert errors == ["28 frames"]


def test_bytes_without_the_end_of_a_line_are_no_line(monkeypatch):
    monkeypatch.setattr(module, "MOST_QUIET", 0.3)
    monkeypatch.setattr(module, "TICK", 0.05)
    slow_parts = 12 * [0.05, b"1 "]
    _, _, errors = run(GRASP[:16], *slow_parts, b"\n", GRASP[16:])
    assert errors == [
        "line 16: no line for 0 s; still reading",
        "line 17: no frame: 1 value; expected 80",
        "28 frames, 1 line without a frame",
    ]


def test_readings_on_another_scale_are_said_with_their_line():
    frames = recording("cup", 132, before=12, held=8, after=8)
    frames[12:20][frames[12:20] > 520] += 5000
    _, records, errors = run(lines_of(frames))
    assert len(errors) == 3 and errors[2] == "28 frames"
    for error, line in zip(errors, (13, 25), strict=False):
        assert error.startswith(f"line {line}: one in a hundred readings in contact is ")
    assert finals(records)[0]["object"] is None


def test_answers_are_skipped_while_lines_wait_and_no_frame_is_lost():
    code, records, errors = run(GRASP, skips=True)
    assert code == 0 and errors == ["28 frames, 8 answers skipped to keep up"]
    (final,) = finals(records)
    assert final["frames"] == 8 and final["object"] == "cup"


def test_times_that_fall_begin_a_new_recording():
    names = ",".join(f"s{index}" for index in range(80))
    first_lines = [f"{60_000 + 100 * index},{line}" for index, line in enumerate(GRASP[:18])]
    second_lines = [f"{100 * index},{line}" for index, line in enumerate(GRASP)]
    lines = [f"time_ms,{names}", *first_lines, *second_lines]
    _, records, errors = run(lines)
    assert errors[:2] == [
        "line 20: the time falls from 61.7 to 0 s: a new recording begins",
        "line 20: the input ended in the grasp",
    ]
    first, second = finals(records)
    assert first["seconds"] == pytest.approx(0.5)
    assert second["seconds"] == pytest.approx(0.7)
    assert first["frames"] == 6 and second["frames"] == 8


@pytest.mark.parametrize("time", ["9999", "-9999"])
def test_the_time_of_a_line_that_is_no_frame_is_not_taken(time):
    names = ",".join(f"s{index}" for index in range(80))
    lines = [f"time,{names}"]
    lines += [f"{index / 10},{line}" for index, line in enumerate(GRASP)]
    bad = f"{time},{with_cell(GRASP[16], 'nan')}"
    _, records, errors = run([*lines[:16], bad, *lines[16:]])
    (final,) = finals(records)
    assert final["frames"] == 8 and final["seconds"] == pytest.approx(0.7)
    assert errors[0].startswith(f"line 17: no frame: {NUMBERED} nan")
    assert errors[1:] == ["28 frames, 1 line without a frame"]


def test_without_times_the_seconds_are_those_between_the_lines():
    _, records, _ = run(GRASP[:13], 0.5, GRASP[13:])
    (final,) = finals(records)
    assert 0.45 < final["seconds"] < 2


@pytest.fixture(scope="module")
def named():
    """Return a recogniser of channels that have names."""
    rng = np.random.default_rng(0)
    X = []
    for index in range(12):
        readings = rng.normal(0, 1, (30, 3))
        readings[:, index % 2] += 20
        X.append(pd.DataFrame(readings, columns=["thumb", "index", "palm"]))
    with warnings.catch_warnings(action="ignore"):
        fitted = TactileClassifier(system="svm").fit(X, np.arange(12) % 2)
    return fitted.recogniser_


def test_sensors_are_found_by_their_names(named):
    rows = np.random.default_rng(1).normal(0, 1, (9, 3))
    rows[:, 1] += 20
    plain = [",".join(map(str, row)) for row in rows]
    mixed = [f"{index};{row[2]};x;{row[0]};{row[1]}" for index, row in enumerate(rows)]
    code, records, errors = run(["sample;palm;note;thumb;index", *mixed], model=named)
    _, expected, _ = run(plain, model=named)
    assert code == 0
    assert errors[0] == "line 1: 2 columns left out, no sensors of the model: sample, note"
    (final,) = finals(records)
    (other,) = finals(expected)
    assert final["object"] == "1"
    assert final["probabilities"] == other["probabilities"]


def test_columns_without_a_sensor_end_the_stream_with_the_last_answer(named):
    lines = ["thumb,index,palm", "0,20,0", "1,19,0", "thumb,index,wrist", "0,20,0"]
    printed = []
    errors = []
    view = JsonView(printed.append, errors.append, named.classes)
    reader = FrameLines(named.shape, named.plan.channel_names)
    command = LiveCommand(named.stream(), reader, view, skips=False)
    with pytest.raises(UserError, match=r"^line 4: the names of the columns: no column palm of"):
        command.run(LineSource(Pipe(text_of(lines))))
    (final,) = finals(map(json.loads, printed))
    assert (final["object"], final["frames"]) == ("1", 2)


def test_lines_of_text_show_changes_of_the_state_and_the_object():
    _, output, _ = run(GRASP, as_json=False)
    lines = output.splitlines()
    states = [line.split()[2] for line in lines]
    assert states == ["waiting", "ready", "contact", "answer", "final", "ready"]
    assert "cup" in lines[3]
    assert "cup" in lines[4]
    assert "%" in lines[4]


def command(path, *words, **options):
    """Start the command as a process of its own, which reads a pipe."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [sys.executable, "-m", "tactile_viewgcn", "live", str(path), *words],
        env=environment,
        stdin=pipe,
        stdout=pipe,
        stderr=pipe,
        text=True,
        **options,
    )


@pytest.mark.parametrize(
    ("signal_number", "code"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 143)],
    ids=["Ctrl-C", "SIGTERM"],
)
def test_a_signal_ends_the_stream_with_the_last_answer_and_its_exit_code(
    tmp_path, signal_number, code
):
    process = command(model_file(tmp_path / "classifier.pt"), "--json", "--every", "1")
    process.stdin.write("\n".join(GRASP[:16]) + "\n")
    process.stdin.flush()
    records = []
    answers = 0
    while answers < 4:
        records.append(json.loads(process.stdout.readline()))
        answers += records[-1]["state"] in ("answer", "final")
    process.send_signal(signal_number)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == code
    (final,) = finals(map(json.loads, output.splitlines()))
    assert final["object"] == "cup"
    assert final["probabilities"] == records[-1]["probabilities"]
    assert errors.splitlines()[-2:] == ["line 16: the input ended in the grasp", "16 frames"]


def test_the_command_reads_a_file_with_all_its_answers_and_ends(tmp_path):
    model = model_file(tmp_path / "classifier.pt")
    process = command(model, "--json")
    output, errors = process.communicate("\n".join(GRASP) + "\n", timeout=60)
    assert process.returncode == 0 and finals(map(json.loads, output.splitlines()))
    assert errors.startswith(f"loading {model}\nmodel: kernel")
    (tmp_path / "grasp.csv").write_text("\n".join(GRASP) + "\n")
    with (tmp_path / "grasp.csv").open() as file:
        result = subprocess.run(
            [sys.executable, "-m", "tactile_viewgcn", "live", str(model), "--json"],
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdin=file,
            capture_output=True,
            text=True,
            check=True,
        )
    records = list(map(json.loads, result.stdout.splitlines()))
    assert sum(record["state"] == "answer" for record in records) == 8
    # a file has no rate
    assert all(record["seconds"] is None and record["time"] is None for record in records)
    assert finals(records)[0]["frames"] == 8


def test_a_closed_standard_input_is_said(tmp_path):
    result = subprocess.run(
        ["sh", "-c", f"{sys.executable} -m tactile_viewgcn live {tmp_path / 'model.pt'} <&-"],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    assert result.stderr.startswith("Error: standard input is closed; expected lines of numbers")
    assert len(result.stderr.splitlines()) == 1


SLOW_MODEL = """
import sys, time
from tactile_viewgcn.cli import main
from tactile_viewgcn.recognition import prediction

def load_model(_):
    print("loading", flush=True)
    time.sleep(60)

prediction.load_model = load_model
sys.argv = ["tactile-viewgcn", "live", "classifier.pt"]
main()
"""


def test_ctrl_c_while_the_model_is_loaded_has_its_exit_code():
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW_MODEL],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # tests that run in the background ignore Ctrl-C, and so would the command
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    with process:
        assert process.stdout.readline() == "loading\n"
        process.send_signal(signal.SIGINT)
        assert process.stderr.read() == "loading classifier.pt\n"
        assert process.wait(timeout=20) == 130


@pytest.mark.parametrize(
    ("signal_number", "code"),
    [(signal.SIGINT, 130), (signal.SIGTERM, 143)],
    ids=["Ctrl-C", "SIGTERM"],
)
def test_a_second_signal_ends_a_command_whose_answers_nobody_reads(tmp_path, signal_number, code):
    lines = tmp_path / "grasps.csv"
    lines.write_text("\n".join(GRASP * 60) + "\n")  # more answers than a pipe holds
    model = model_file(tmp_path / "classifier.pt")
    with lines.open() as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "tactile_viewgcn", "live", str(model), "--json"],
            env=os.environ | {"PYTHONPATH": str(ROOT)},
            stdin=file,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
    try:
        assert process.stdout.readline()
        time.sleep(3)  # the pipe is full
        process.send_signal(signal_number)
        time.sleep(1)
        assert process.poll() is None
        process.send_signal(signal_number)
        assert process.wait(timeout=20) == code
    finally:
        process.kill()
        process.stdout.close()


def test_a_program_that_reads_no_more_ends_the_command_without_a_traceback(tmp_path):
    process = command(model_file(tmp_path / "classifier.pt"), "--json")
    process.stdout.close()
    process.stdout = None
    _, errors = process.communicate("\n".join(GRASP) + "\n", timeout=60)
    assert process.returncode == 1 and "Traceback" not in errors


def test_a_terminal_shows_a_line_in_place_and_is_no_input(tmp_path):
    path = model_file(tmp_path / "classifier.pt")
    master, slave = os.openpty()
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "80", "PYTHONUTF8": "1"}
    words = [sys.executable, "-m", "tactile_viewgcn", "live", str(path)]
    refused = subprocess.run(
        words, env=environment, stdin=slave, capture_output=True, text=True, check=False
    )
    assert refused.returncode == 1 and len(refused.stderr.splitlines()) == 1
    assert "standard input is a terminal" in refused.stderr
    subprocess.run(
        words,
        env=environment,
        input="\n".join(GRASP) + "\n",
        stdout=slave,
        stderr=subprocess.PIPE,
        text=True,
        check=True,
    )
    os.close(slave)
    shown = os.read(master, 1 << 16).decode()
    os.close(master)
    lines = shown.split("\r")
    assert any(line.startswith("\x1b[Kfinal    cup") and "█" in line for line in lines)
    assert max(map(len, lines)) <= 80 + len("\x1b[K")
