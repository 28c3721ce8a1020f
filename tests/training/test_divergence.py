"""A training that diverges, as the stages tell of it: in their output, their record, and the results made from it."""

import json

import pytest
from click.testing import CliRunner

from stages.evaluate import evaluate
from stages.pretrain import pretrain
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.frames import write_frames
from tests.small_tables import ROOT, SMALL, fewer_anchors, recipe, table, trained

CHANGES = [word for change in (*SMALL, "precision=float32", "device=cpu") for word in ("--set", change)]


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    monkeypatch.setenv("DVC_ROOT", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    (tmp_path / "needs.json").write_text('{"pretrain": true}')
    write_frames(tmp_path / "frames.h5", fewer_anchors(table(), 4))
    return tmp_path


def run_pretrain(*changes):
    inputs, outputs = ("--needs", "needs.json", "--frames", "frames.h5"), ("--out", "backbone.pt")
    words = [*CHANGES, *(w for change in changes for w in ("--set", change)), *inputs, *outputs]
    return CliRunner().invoke(pretrain, [*words, "--record", "pretrain.json"])


def test_one_that_diverges_after_an_epoch_leaves_that_epochs_weights_and_says_so(place, monkeypatch):
    monkeypatch.setattr("tactile_viewgcn.training.pretraining.lr_lambda", lambda _: {0: 1.0, 1: 1e30}.get)
    result = run_pretrain("pretrain.epochs=2")
    assert result.exit_code == 0, result.output
    assert "pretrain: 1 epoch (training diverged in epoch 2 at a learning rate of 5e+27" in result.output
    assert "lower lr in params.yaml; the weights after epoch 1 are kept)" in result.output
    record = json.loads((place / "pretrain.json").read_text())
    assert record["counts"]["diverged_in_epoch"] == 2 and record["threads.fewest"] <= record["threads.most"]
    assert (place / "backbone.pt").exists()


@pytest.mark.parametrize("lost", [{}, {"diverged_in_epoch": 3.0}])
def test_results_of_a_training_that_diverged_say_so(place, lost):
    save_classifier(place / "classifier.pt", trained(), recipe().model, table())
    record = {"stage": "finetune", "run_id": None, "seconds": 1.0, "peak_mb": 1.0, "inputs": {}, "counts": lost}
    (place / "finetune.json").write_text(json.dumps(record))
    files = ("--frames", "frames.h5", "--classifier", "classifier.pt", "--after", "finetune.json", "--out", "results")
    result = CliRunner().invoke(evaluate, [*CHANGES, *files, "--record", "evaluate.json"])
    assert result.exit_code == 0, result.output
    sentence = "finetune diverged in epoch 3, and this is what the weights before it give"
    assert (sentence in result.output) == bool(lost)
    metrics = json.loads((place / "results" / "metrics.json").read_text())
    assert metrics.get("diverged_in_epoch", {}) == ({"finetune": 3.0} if lost else {})
