"""`tactile-viewgcn report` of a run that the stages have left in a workspace."""

import json
import shutil
import sys
from importlib.metadata import version
from pathlib import Path

import pytest
from click.testing import CliRunner

from tactile_viewgcn import cli
from tactile_viewgcn.evaluation.finished_run import read_run
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import UserError
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
    text, error = (
        text_of(page),
        json.loads(Path("results/metrics.json").read_text())["whole"]["error"],
    )
    assert f"{percent_interval(error['mean'], error['low'], error['high'])} % of the cases" in text
    assert (
        "Which of 4 objects does the hand hold?" in text
        and "`" not in page
        and "python -m studies each_fold" in page
    )
    assert (
        "It was tested on 8 recordings, 2 of each object." in text and "Little was tested" in text
    )
    notes = run.notes("choice") + run.notes("info")
    assert len(notes) > 3 and [note for note in notes if note.text not in text] == []
    versions = {f"{name} {version(name)}" for name in ("torch", "numpy", "dvc", "mlflow")}
    assert [entry for entry in versions if entry not in text] == []
    assert "pretrain skipped: this system needs no pretrained backbone" in text
    assert (
        parsed(page).tags.isdisjoint({"script", "link", "iframe"})
        and "&lt;b&gt;Öl &amp; $x$" in page
    )


def test_the_page_has_live_errors_where_the_run_measured_them(workspace):
    text = text_of(run_page(read_run()))
    assert "While the hand still holds the object" in text and "sure by 95 %" in text
    Path("results/live.csv").unlink()  # as of an earlier version
    assert "While the hand still holds the object" not in text_of(run_page(read_run()))


def test_an_unfinished_run_and_one_that_does_not_belong_together_are_refused(workspace):
    path = Path("runs/preprocess.json")
    record = path.read_text()
    path.write_text(record + "\n")
    with pytest.raises(UserError, match="`preprocess` ran again after `evaluate`"):
        read_run()
    path.write_text(record)
    Path("results/metrics.json").unlink()
    with pytest.raises(
        UserError, match=r"the workspace: no results/metrics\.json; run the line that `tactile"
    ):
        read_run()


def test_the_command_writes_the_file_and_an_unknown_run_is_one_line(workspace, monkeypatch, capsys):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    monkeypatch.setattr(sys, "argv", ["tactile-viewgcn", "report", "--out", "new/page.html"])
    with pytest.raises(SystemExit, match=r"^0$"):
        cli.main()
    lines = capsys.readouterr().out.splitlines()
    error = json.loads(Path("results/metrics.json").read_text())["whole"]["error"]
    assert (
        percent_interval(error["mean"], error["low"], error["high"]) in lines[0]
        and "chance: " in lines[0]
    )
    assert any(line.startswith("new/page.html: ") for line in lines)
    assert lines[-1].startswith(("dvc exp run ", "python -m studies each_fold "))
    assert 1e4 < Path("new/page.html").stat().st_size < 3e6
    for name, says in (
        ("nowhere", "nowhere: no experiment"),
        ("0" * 32, "no MLflow store: disabled"),
    ):
        monkeypatch.setattr(sys, "argv", ["tactile-viewgcn", "report", name])
        with pytest.raises(SystemExit, match=r"^1$"):
            cli.main()
        err = capsys.readouterr().err
        assert len(err.splitlines()) == 1 and says in err
    assert not Path("report.html").exists()


@pytest.mark.parametrize(
    "path",
    [
        "runs/finetune.json",
        "results/metrics.json",
        "results/timing.json",
        "results/predictions.npz",
    ],
)
@pytest.mark.parametrize("content", [b"", b"{", b"PK\x03\x04 and no more"])
def test_a_damaged_file_ends_in_one_line(workspace, path, content):
    Path(path).write_bytes(content)
    assert "damaged, or not written by this version" in str(
        CliRunner().invoke(cli.cli, ["report"]).exception
    )
