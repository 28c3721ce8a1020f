"""`tactile-viewgcn report` for a run that the stages have left in a workspace."""

import json
import re
import shutil
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tactile_viewgcn import cli
from tactile_viewgcn.evaluation.finished_run import read_run
from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.pages.run_page import run_facts, run_page
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.recordings import Recordings
from tests.pages.test_html import parsed, text_of

ROOT = Path(__file__).parents[2]


@pytest.fixture
def workspace(finished, tmp_path, monkeypatch) -> Path:
    """Return a copy of the finished run, which becomes the working folder."""
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_page_says_what_the_files_say(workspace):
    page = run_page(read_run())
    run = read_run()
    text = text_of(page)
    error = json.loads(Path("results/metrics.json").read_text())["whole"]["error"]
    assert f"{percent_interval(error['mean'], error['low'], error['high'])} % of the cases" in text
    assert "Which of 4 objects does the hand hold?" in text
    assert "`" not in page
    assert "python -m studies each_fold" in page
    assert re.search(r"Repeat this run.*?<pre><code>.*?dvc exp run --temp -S", page, re.DOTALL)
    assert "It was tested on 8 recordings, 2 of each object." in text
    assert "Little was tested" in text
    facts = run_facts(run)
    assert {"whole", "recording", "object"} <= set(facts["scores"])
    for name in facts["scores"]:
        assert facts["meanings"][name] in text
    notes = run.notes("choice") + run.notes("info")
    assert len(notes) > 3
    assert [note for note in notes if note.text not in text] == []
    versions = {f"{name} {version(name)}" for name in ("torch", "numpy", "dvc", "mlflow")}
    assert [entry for entry in versions if entry not in text] == []
    assert "pretrain skipped: this system needs no pretrained backbone" in text
    assert parsed(page).tags.isdisjoint({"script", "link", "iframe"})
    assert "&lt;b&gt;Öl &amp; $x$" in page


def test_the_page_has_live_errors_where_the_run_measured_them(workspace):
    text = text_of(run_page(read_run()))
    assert "While the hand still holds the object" in text
    assert "first answer of 95 % or more" in text
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
    message = r"the workspace: no results/metrics\.json; run the line that `tactile"
    with pytest.raises(UserError, match=message):
        read_run()


def test_the_command_writes_the_file_and_an_unknown_run_is_one_line(workspace, monkeypatch, capsys):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    monkeypatch.setattr(sys, "argv", ["tactile-viewgcn", "report", "--out", "new/page.html"])
    with pytest.raises(SystemExit, match=r"^0$"):
        cli.main()
    lines = capsys.readouterr().out.splitlines()
    error = json.loads(Path("results/metrics.json").read_text())["whole"]["error"]
    assert percent_interval(error["mean"], error["low"], error["high"]) in lines[0]
    assert "chance: " in lines[0]
    assert any(line.startswith("new/page.html: ") for line in lines)
    assert lines[-1].startswith(("dvc exp run ", "python -m studies each_fold "))
    assert 1e4 < Path("new/page.html").stat().st_size < 3e6
    for name, says in (
        ("nowhere", "nowhere: no such run"),
        ("0" * 32, "no MLflow store: disabled"),
    ):
        monkeypatch.setattr(sys, "argv", ["tactile-viewgcn", "report", name])
        with pytest.raises(SystemExit, match=r"^1$"):
            cli.main()
        err = capsys.readouterr().err
        assert len(err.splitlines()) == 1 and says in err
    assert not Path("report.html").exists()


def test_compare_answers_a_name_that_no_run_has_by_all_that_a_name_can_be(workspace):
    error = CliRunner().invoke(cli.cli, ["compare", "no-such-run"]).exception
    assert isinstance(error, UserError)
    assert str(error).startswith("no-such-run: no such run")
    for kind in ("DVC experiment or revision", "MLflow run", "`runs` and `results`", "`workspace`"):
        assert kind in str(error)


def test_the_page_of_a_named_run_has_its_name(workspace):
    for name in ("runs", "results"):
        (workspace / "first try" / name).parent.mkdir(exist_ok=True)
        shutil.copytree(name, workspace / "first try" / name)
    Path("report.html").write_text("of the workspace")
    run = CliRunner().invoke(cli.cli, ["report", "first try"], catch_exceptions=False)
    assert "\nreport-first-try.html: " in run.output
    assert Path("report-first-try.html").exists()
    assert Path("report.html").read_text() == "of the workspace"


def test_the_results_keep_the_probabilities_that_the_model_answers_with(workspace):
    whole = read_run().predictions.whole
    recogniser = Recogniser("models/classifier.pt")
    assert recogniser.content.temperature not in (None, 1.0)
    answers, _ = recogniser.answer_table(Recordings.read(Path("data/recordings")))
    # the model does not ask its classifier about recordings without contact
    answered = {answer.recording: answer.probabilities for answer in answers if answer.contact}
    tested = [name in answered for name in whole.recordings]
    assert sum(tested) == 6  # 2 of each of the 3 objects
    expected = [answered[name] for name in whole.recordings[tested]]
    np.testing.assert_allclose(whole.probabilities[tested], expected, atol=1e-6)


def test_the_page_compares_probabilities_with_errors(workspace):
    assert "By their probabilities, " in text_of(run_page(read_run()))
    run = read_run()
    count = 30
    labels = np.arange(count) % 4
    probabilities = np.eye(4)[labels] * np.linspace(0.6, 0.9, count)[:, None]
    names = labels.astype(str)
    whole = Trials(labels[None, :, None], labels, labels, names, 8, probabilities=probabilities)
    predictions = replace(run.predictions, trials={"whole": whole})
    page = run_page(replace(run, predictions=predictions))
    # three parts of 10 answers each
    expected_errors = re.findall(r'<td class="n">10</td><td class="n">([\d.]+)', page)
    assert expected_errors == ["35.3", "25.0", "14.7"]


def test_the_page_has_a_row_for_the_time_of_each_stage(workspace):
    timing = json.loads(Path("results/timing.json").read_text())
    timing["seconds"] = {"simulate": 20.0} | timing["seconds"]
    Path("results/timing.json").write_text(json.dumps(timing))
    assert CliRunner().invoke(cli.cli, ["report"]).exit_code == 0
    page = Path("report.html").read_text("utf-8")
    rows = re.findall(r"<tr><td>\s*<b>(\w+)</b>", page.partition("<h3>Time</h3>")[2])
    assert rows[: len(timing["seconds"])] == list(timing["seconds"])


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
    error = CliRunner().invoke(cli.cli, ["report"]).exception
    assert "damaged, or not written by this version" in str(error)


def test_the_card_is_of_the_model_in_the_workspace(workspace, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    shown = CliRunner().invoke(cli.cli, ["report", "--card", "new/card.md"])
    assert shown.exit_code == 0, shown.output
    assert shown.output.startswith("new/card.md: the model card, ")
    lines = Path("new/card.md").read_text("utf-8").splitlines()
    metrics = json.loads(Path("results/metrics.json").read_text())
    for name in ("whole", "recording", "object"):
        error = metrics[name]["error"]
        interval = percent_interval(error["mean"], error["low"], error["high"])
        (line,) = [line for line in lines if line.startswith(f"| `{name}` |")]
        assert f"| {interval} |" in line
    assert "4 objects: `empty_hand`, `<b>Öl & $x$`, " in "\n".join(lines)
    assert any(line.startswith(r"| \<b\>Öl \& \$x\$ | ") for line in lines)
    # the model's file says so
    assert "| Shape of a frame | 32 rows, 32 columns |" in lines
    assert "They are calibrated for whole recordings: " in "\n".join(lines)


def test_the_card_needs_the_model(workspace):
    Path("models/classifier.pt").unlink()
    error = CliRunner().invoke(cli.cli, ["report", "--card", "card.md"]).exception
    assert "the workspace: no models/classifier.pt; run the line" in str(error)
    assert not Path("card.md").exists() and not Path("report.html").exists()


@pytest.mark.filterwarnings("default")  # MLflow's own
def test_mlflow_has_the_card_as_the_description_of_the_model(workspace, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", f"sqlite:///{workspace / 'mlflow.db'}")
    from mlflow import MlflowClient

    run_id = read_run().records["evaluate"].run_id
    client = MlflowClient(f"sqlite:///{workspace / 'mlflow.db'}")
    (output,) = client.get_run(run_id).outputs.model_outputs
    card = client.get_logged_model(output.model_id).tags["mlflow.note.content"]
    assert "model_card.md" in {file.path for file in client.list_artifacts(run_id)}
    # the command gives the same card of the run
    shown = CliRunner().invoke(cli.cli, ["report", run_id, "--card", "card.md"])
    assert shown.exit_code == 0, shown.output
    assert Path("card.md").read_text("utf-8") == card
    assert f"tactile-viewgcn predict {run_id} NEW_RECORDINGS" in card
