"""What a stage imports, which is what it waits for and depends on."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.frames import write_frames
from tests.glove_data import SMALL, recipe, table, trained
from tests.stages.running import changed

ROOT = Path(__file__).parents[2]


def test_the_virtual_glove_takes_no_torch_which_is_not_asked_for_its_errors_where_it_was_never_loaded():
    code = (
        "import sys, stages.simulate\n"
        "from tactile_viewgcn.errors import user_message as line\n"
        "assert 'out of memory' in line(MemoryError()) and line(RuntimeError('x')) is None\n"
        "assert not {'torch', 'mlflow', 'sklearn', 'matplotlib'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


UNCLUSTERED = """
import runpy, sys

for stage, words in {stages}.items():
    sys.argv = [stage, *words, *sys.argv[1:]]
    runpy.run_module(f"stages.{{stage}}", run_name="__main__")
    del sys.argv[1 : len(words) + 1]
print("imported", *sys.modules)
"""
FILES = {
    "needs": "--out needs.json",
    "cluster": "--frames frames.h5 --needs needs.json --out views.h5 --record cluster.json",
    "evaluate": "--frames frames.h5 --classifier classifier.pt --out results --record evaluate.json",
}


@pytest.mark.slow
@pytest.mark.stability("libraries")
def test_an_unclustered_run_without_tracking_takes_no_scikit_learn_and_no_mlflow(row, place):
    write_frames(place / "frames.h5", table())
    save_classifier(place / "classifier.pt", trained(), recipe().model, table())
    changes = (*SMALL, "cluster.method=none", "evaluate.trials=1", "evaluate.confidence_threshold=0", "device=cpu")
    program = UNCLUSTERED.format(stages={stage: words.split() for stage, words in FILES.items()})
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled", "PYTHONPATH": str(ROOT)}
    run = [sys.executable, "-c", program, *changed(*changes)]
    done = subprocess.run(run, check=False, cwd=place, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    imported = done.stdout.split("imported")[-1].split()
    row("scikit-learn in an unclustered run", "sklearn" in imported)
    row("MLflow in a run with tracking disabled", "mlflow" in imported)
