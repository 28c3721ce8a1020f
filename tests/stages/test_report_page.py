"""`tactile-viewgcn report` of a run that the stages have left in a workspace."""

import json
import re
import shutil
import sys
from pathlib import Path

import pytest

from tactile_viewgcn import cli
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.pages import html
from tactile_viewgcn.pages.finished_run import read_run
from tactile_viewgcn.pages.run_page import run_page
from tests.pages.test_html import parsed, text_of

ROOT = Path(__file__).parents[2]


@pytest.fixture
def workspace(finished, tmp_path, monkeypatch) -> Path:
    """A copy of the finished run, as the working folder."""
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_page_says_what_the_files_say(workspace):
    page, run = run_page(read_run()), read_run()
    text, error = text_of(page), json.loads(Path("results/metrics.json").read_text())["recording"]["error"]
    assert f"{percent_interval(error['mean'], error['low'], error['high'])} % of the cases" in text
    assert "Which of 4 objects does the hand hold?" in text
    assert "It was tested on 8 recordings, 2 of each object." in text and "Little was tested" in text
    notes = run.notes("choice") + run.notes("info")
    assert len(notes) > 5 and [note for note in notes if note.text not in text] == []
    assert "pretrain left out: this system needs no pretrained backbone" in text
    assert parsed(page).tags.isdisjoint({"script", "link", "iframe"}) and "&lt;b&gt;Öl &amp; $x$" in page


def test_the_page_of_a_network_says_from_how_many_frames_it_answers(workspace, undrawn):
    path = Path("results/metrics.json")
    metrics = json.loads(path.read_text())
    assert metrics["recording"].pop("frames") and "From all frames of" in text_of(run_page(read_run()))
    path.write_text(json.dumps(metrics))
    assert f"From {metrics['views']} pressure frames of" in text_of(run_page(read_run()))


@pytest.fixture
def undrawn(monkeypatch):
    """Pages without pictures, whose drawing takes longer than all else."""
    monkeypatch.setattr(html, "svg", lambda _: ("data:", 100))


def test_a_section_is_shown_where_there_is_something_to_show(workspace, undrawn):
    run = read_run()
    sections = ["What to do next", "Warnings", "Error and time", "Objects", "Worst pairs"]
    sections += ["From raw counts to the answer", "What it was made from", "Words"]
    assert re.findall("<h2>(.+?)</h2>", run_page(run)) == sections
    note = Note("better than by chance", "warning", "leak check", "preprocess.baseline", "grasp", "preprocess")
    run.records["preprocess"].notes.append(note)
    value = {"error": 0.25, "standard_error": 0.125, "seconds": 61.0}
    values = [value | {"members": members, "taken": members == ["trees"]} for members in (["trees"], ["kernel", "svm"])]
    notes = [Note("in columns", topic="candidates", value=each, stage="finetune") for each in [None, *values]]
    run.records["finetune"].notes.extend(notes)
    run.params["data.source"] = "data/virtual/recordings"
    run.records["evaluate"].origin.update({"mlflow.source.git.commit": "0" * 40, "git.dirty": "true"})
    page = run_page(run)
    text = text_of(page).replace("\xa0", " ")
    assert set(re.findall("<h2>(.+?)</h2>", page)) == {*sections, "Candidates"}
    assert "preprocess : leak check: better than by chance." in text and "-S preprocess.baseline=grasp" in text
    assert "trees taken 25.0 % 12.5 % 1 min 1 s kernel + svm 25.0 % 12.5 %" in text
    assert "in columns" not in text
    assert "Simulated data" in text and f"git checkout {'0' * 40} dvc exp run" in text
    assert "the code had changes that were not committed" in text


def test_the_page_says_what_the_frames_of_an_answer_are_of(workspace, undrawn):
    run = read_run()
    assert "come from one recording, as in use" in text_of(run_page(run))
    run.params["split.by"] = "grasp"
    text = text_of(run_page(run))
    assert "come from one grasp, as in use" in text and "of a grasp that it has not learnt from" in text
    assert "first three" in text
    run.metrics["classes"] = 3
    text = text_of(run_page(run))
    assert "first three" not in text


def test_an_unfinished_run_and_one_that_does_not_belong_together_are_refused(workspace):
    path = Path("runs/preprocess.json")
    record = path.read_text()
    path.write_text(record + "\n")
    with pytest.raises(UserError, match="`preprocess` ran again after `evaluate`"):
        read_run()
    path.write_text(record)
    Path("results/metrics.json").unlink()
    with pytest.raises(UserError, match=r"the workspace: no results/metrics\.json; run `dvc repro`"):
        read_run()


def test_the_command_writes_the_file_and_an_unknown_run_is_one_line(workspace, monkeypatch, capsys):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    monkeypatch.setattr(sys, "argv", ["tactile-viewgcn", "report", "--out", "new/page.html"])
    cli.main()
    assert capsys.readouterr().out.startswith("new/page.html: ") and 1e4 < Path("new/page.html").stat().st_size < 3e6
    for name, says in (("nowhere", "nowhere: no experiment"), ("0" * 32, "no MLflow store: disabled")):
        monkeypatch.setattr(sys, "argv", ["tactile-viewgcn", "report", name])
        with pytest.raises(SystemExit, match=r"^1$"):
            cli.main()
        err = capsys.readouterr().err
        assert len(err.splitlines()) == 1 and says in err
    assert not Path("report.html").exists()


@pytest.mark.parametrize(
    "path", ["runs/finetune.json", "results/metrics.json", "results/timing.json", "results/predictions.npz"]
)
@pytest.mark.parametrize("content", [b"", b"{", b"PK\x03\x04 and no more"])
def test_a_damaged_file_ends_in_one_line(workspace, path, content):
    Path(path).write_bytes(content)
    with pytest.raises(UserError, match="damaged, or not written by this version"):
        read_run()
