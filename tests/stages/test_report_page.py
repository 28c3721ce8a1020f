"""`tactile-viewgcn report` of a run that the stages have left in a workspace."""

import json
import os
import re
import shutil
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.finished_run import read_run
from tactile_viewgcn.evaluation.run_page import run_page
from tests.stag_files import metadata, save_matlab5
from tests.stages.running import run_stage
from tests.tables import SMALL
from tests.test_html import parsed

ROOT = Path(__file__).parents[2]
RECORDS = [f"runs/{stage}.json" for stage in ("ingest", "preprocess", "cluster", "pretrain", "finetune")]
FILES = {
    "ingest": "--source metadata.mat --out data/recordings.h5",
    "preprocess": "--recordings data/recordings.h5 --out data/frames.h5 --kept data/kept.csv",
    "cluster": "--frames data/frames.h5 --out data/views.h5",
    "pretrain": "--needs data/needs.json --frames data/frames.h5 --out models/backbone.pt",
    "finetune": "--frames data/frames.h5 --views data/views.h5 --backbone models/backbone.pt "
    "--out models/classifier.pt",
    "evaluate": "--frames data/frames.h5 --classifier models/classifier.pt --out results "
    + " ".join(f"--after {record}" for record in RECORDS),
}


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """A workspace with the files of a finished run, of four objects and a system without a network."""
    place = tmp_path_factory.mktemp("workspace")
    shutil.copy(ROOT / "params.yaml", place)
    tree = metadata(objects=4, recordings=6, frames=12)
    tree["objects"][0, 1] = "<b>Öl & $x$"
    save_matlab5(place / "metadata.mat", tree)
    (place / "data").mkdir()
    (place / "data" / "needs.json").write_text('{"pretrain": false}')
    changes = (*SMALL, "data.source=metadata.mat", "model.system=lda", "device=cpu")
    words = [word for change in changes for word in ("--set", change)]
    for stage, files in FILES.items():
        result = run_stage(stage, *files.split(), "--record", f"runs/{stage}.json", *words, cwd=place)
        assert result.returncode == 0, result.stderr
    return place


@pytest.fixture
def workspace(finished, tmp_path, monkeypatch) -> Path:
    """A copy of the finished run, as the working folder."""
    shutil.copytree(finished, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def text_of(page):
    return re.sub(r"\s+", " ", unescape(re.sub(r"<[^>]+>", " ", page.partition("<body>")[2])))


def test_the_page_says_what_the_files_say(workspace):
    page = run_page(read_run())
    metrics, record = (json.loads(Path(name).read_text()) for name in ("results/metrics.json", "runs/preprocess.json"))
    text = text_of(page)
    assert f"{100 * metrics['recording']['error']['mean']:.1f} % of the cases" in text
    assert "Which of 4 objects does the hand hold?" in text and "Simulated" not in text
    assert f"{record['counts']['frames.train']:,}" in text
    assert [note for note in record["notes"] if note not in text] == []
    assert "pretrain left out: this system needs no pretrained backbone" in text and "Clusters on the hand" in text
    assert parsed(page).tags.isdisjoint({"script", "link", "iframe"}) and "&lt;b&gt;Öl &amp; $x$" in page


def test_warnings_and_curves_are_shown_where_there_are_some(workspace):
    quiet = text_of(run_page(read_run()))
    assert "No stage gave a warning" in quiet and "Training curves" not in quiet
    run = read_run()
    run.records["preprocess"]["notes"].append("leak check: told\n  warning: better than by chance: choose another")
    run.records["finetune"]["curves"]["loss"] = [3.0, 2.0]
    text = text_of(run_page(run))
    assert "No stage gave a warning" not in text and "better than by chance: choose another" in text
    assert "Training curves" in text and "2 epochs" in text


def test_the_page_of_simulated_recordings_says_so(workspace):
    run = read_run()
    run.params["data.source"] = "data/virtual/recordings"
    assert "Simulated data" in text_of(run_page(run))


def test_a_run_that_does_not_belong_together_is_refused(workspace):
    path = Path("runs/preprocess.json")
    path.write_text(path.read_text() + "\n")
    with pytest.raises(UserError, match="`preprocess` ran again after `evaluate`"):
        read_run()


@pytest.mark.parametrize("name", ["results/metrics.json", "runs/finetune.json"])
def test_an_unfinished_run_is_refused(workspace, name):
    Path(name).unlink()
    with pytest.raises(UserError, match=f"the workspace: no {name}; run `dvc repro`"):
        read_run()


def test_the_command_writes_the_file_and_an_unknown_run_is_one_line(workspace):
    def call(*words):
        command = [sys.executable, "-m", "tactile_viewgcn", "report", *words]
        environment = os.environ | {"PYTHONPATH": str(ROOT), "MLFLOW_TRACKING_URI": "disabled"}
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    result = call("--out", "new/page.html")
    assert result.returncode == 0 and result.stdout.startswith("new/page.html: "), result.stderr
    assert 1e4 < Path("new/page.html").stat().st_size < 3e6
    for name, says in (("nowhere", "nowhere: no experiment"), ("0" * 32, "MLFLOW_TRACKING_URI is disabled")):
        result = call(name)
        assert result.returncode == 1 and len(result.stderr.splitlines()) == 1 and says in result.stderr
    assert not Path("report.html").exists()
