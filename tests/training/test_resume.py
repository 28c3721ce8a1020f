"""Training stages that are killed and started again."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.stag_files import metadata, save_matlab5

pytestmark = pytest.mark.slow  # test_checkpoint.py interrupts the same trainings in one process
ROOT = Path(__file__).parents[2]
ENVIRONMENT = os.environ | {"MLFLOW_TRACKING_URI": "disabled", "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
RECIPE = ("views=4", "split.by=recording", "precision=float32", "model.backbone.width=8")
RECIPE += ("pretrain.epochs=12", "finetune.epochs=8")


def command(stage, *words):
    changes = [word for change in RECIPE for word in ("--set", change)]
    return [sys.executable, "-m", f"stages.{stage}", "--record", f"{stage}.json", *changes, *words]


def run(place, stage, *words):
    words = command(stage, *words)
    return subprocess.run(words, cwd=place, env=ENVIRONMENT, stdout=subprocess.PIPE, text=True, check=True).stdout


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with all that the trainings read."""
    place = tmp_path_factory.mktemp("resume")
    (place / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    (place / "needs.json").write_text('{"cluster": true, "pretrain": true}')
    save_matlab5(place / "metadata.mat", metadata(objects=4, recordings=3, frames=12))
    run(place, "ingest", "--set", "data.source=metadata.mat", "--out", "recordings")
    run(place, "preprocess", "--recordings", "recordings", "--out", "frames")
    run(place, "cluster", "--needs", "needs.json", "--frames", "frames", "--out", "views")
    return place


FINETUNE = "--frames frames --views views --backbone backbone.pt --set finetune.feature_reuse=2"


@pytest.mark.parametrize(
    ("stage", "inputs", "out"),
    [("pretrain", "--needs needs.json --frames frames", "backbone.pt"), ("finetune", FINETUNE, "classifier.pt")],
)
def test_a_stage_that_was_killed_goes_on_and_ends_as_one_that_was_not(place, stage, inputs, out):
    words = (*inputs.split(), "--out", out)
    assert "before an interruption" not in run(place, stage, *words)
    whole = (place / out).read_bytes()
    (place / out).unlink()
    process, deadline = subprocess.Popen(command(stage, *words), cwd=place, env=ENVIRONMENT), time.monotonic() + 120
    while not list(place.glob(f"checkpoints/{stage}-*.pt")):  # until an epoch has ended
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.002)
    process.kill()
    assert process.wait() == -9 and not (place / out).exists()
    assert "before an interruption" in run(place, stage, *words)
    assert (place / out).read_bytes() == whole and not list(place.glob("checkpoints/*.pt"))
