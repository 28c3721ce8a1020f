"""The stages at their command line: what they print, leave behind and refuse."""

import ast
import json
import os
import shutil
import signal
import subprocess
import sys
import traceback
from contextlib import ExitStack, chdir, redirect_stderr, redirect_stdout
from importlib import import_module
from io import StringIO
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import click
import h5py
import numpy as np
import pytest
import torch
import yaml
from click.testing import CliRunner
from scipy import io

from stages.command import stage
from stages.job import Job
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import md5
from tactile_viewgcn.frames.table import write_frames
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tracking import Run
from tests.stag_files import as_weights, metadata, save_matlab5
from tests.tables import SMALL, recipe, table, trained

ROOT = Path(__file__).parents[2]


def run_stage(name, *words, cwd):
    """A stage as its command line runs it, in this process: exit code and what it prints."""
    command, before = getattr(import_module(f"stages.{name}"), name), signal.getsignal(signal.SIGTERM)
    code, out, err = 0, StringIO(), StringIO()
    with ExitStack() as stack:
        stack.enter_context(patch.dict(os.environ, {"MLFLOW_TRACKING_URI": "disabled"}))
        for manager in (chdir(cwd), redirect_stdout(out), redirect_stderr(err)):
            stack.enter_context(manager)
        stack.callback(signal.signal, signal.SIGTERM, before)
        try:
            command([str(word) for word in words], prog_name=name)
        except SystemExit as end:
            code = end.code
        except Exception:
            code = 1
            traceback.print_exc()
    return SimpleNamespace(returncode=code, stdout=out.getvalue(), stderr=err.getvalue())


def refused(result) -> str:
    """The one line of a refused run."""
    lines = result.stderr.strip().splitlines()
    assert result.returncode == 1, result.stderr
    assert len(lines) == 1 and lines[0].startswith("Error: "), result.stderr
    return lines[0]


@pytest.fixture
def place(tmp_path):
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    return tmp_path


def ingest(place, tree=None, source="metadata.mat"):
    if tree is not None:
        save_matlab5(place / source, tree)
    return run_stage("ingest", "--source", source, "--out", "recordings.h5", "--record", "ingest.json", cwd=place)


def preprocess(place, *changes):
    words = [word for change in changes for word in ("--set", change)]
    outputs = ("--out", "frames.h5", "--kept", "kept.csv", "--record", "preprocess.json")
    return run_stage("preprocess", "--recordings", "recordings.h5", *outputs, *words, cwd=place)


def left(place) -> set[str]:
    return {path.name for path in place.iterdir()} - {"params.yaml", "metadata.mat", "recordings.h5", "ingest.json"}


PACKAGES = [ROOT / "stages", *(path.parent for path in sorted((ROOT / "tactile_viewgcn").rglob("__init__.py")))]


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_package_files_hold_nothing_that_a_stage_could_depend_on(package):
    """The lists of code leave them out; what is exported late is in files of its own."""
    docstring, *more = ast.parse((package / "__init__.py").read_text()).body
    assert isinstance(docstring, ast.Expr)
    assert [ast.unparse(each).split("(")[0] for each in more] in (
        [],
        ["from typing import Any", "__all__ = ['TactileClassifier']", "def __getattr__"],
    )


def test_the_virtual_glove_takes_no_torch():
    code = "import sys, stages.simulate; assert not {'torch', 'mlflow', 'sklearn', 'matplotlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


UNCLUSTERED = """
import sys
from stages.cluster import cluster
from stages.evaluate import evaluate

given = [*sys.argv[1:], "--frames", "frames.h5"]
cluster([*given, "--out", "views.h5", "--record", "cluster.json"], standalone_mode=False)
outputs = ["--classifier", "classifier.pt", "--out", "results", "--record", "evaluate.json"]
evaluate([*given, *outputs], standalone_mode=False)
print("imported", *sys.modules)
"""


@pytest.mark.slow
@pytest.mark.stability("libraries")
def test_an_unclustered_run_without_tracking_takes_no_scikit_learn_and_no_mlflow(row, place):
    write_frames(place / "frames.h5", table())
    save_classifier(place / "classifier.pt", trained(), recipe().model, table())
    changes = (*SMALL, "cluster.method=none", "evaluate.trials=1", "evaluate.confidence_threshold=0", "device=cpu")
    words = [word for change in changes for word in ("--set", change)]
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled", "PYTHONPATH": str(ROOT)}
    run = [sys.executable, "-c", UNCLUSTERED, *words]
    done = subprocess.run(run, check=False, cwd=place, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    imported = done.stdout.split("imported")[-1].split()
    row("scikit-learn in an unclustered run", "sklearn" in imported)
    row("MLflow in a run with tracking disabled", "mlflow" in imported)


def test_dvc_hands_on_a_source_whatever_letters_its_path_has(place):
    name = 'it\'s a "b" `c` $HOME & ${seed};#*.mat'
    shutil.copy(ROOT / "dvc.yaml", place)
    for package in ("stages", "tactile_viewgcn"):
        shutil.copytree(ROOT / package, place / package, ignore=shutil.ignore_patterns("__pycache__"))
    save_matlab5(place / name, metadata(objects=3, frames=10))
    tree = yaml.safe_load((place / "params.yaml").read_text())
    tree["data"]["source"] = name
    (place / "params.yaml").write_text(yaml.safe_dump(tree))
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled", "DVC_NO_ANALYTICS": "1"}
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for words in (("init", "--no-scm", "-q"), ("repro", "ingest")):
        command = [sys.executable, "-m", "dvc", *words]
        result = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True, check=False)
        assert result.returncode == 0, result.stderr
    assert "90 frames of 32 x 32" in result.stdout
    locked = yaml.safe_load((place / "dvc.lock").read_text())["stages"]["ingest"]["deps"]
    assert name in {dep["path"] for dep in locked}


def test_a_run_leaves_its_record(place):
    result = ingest(place, metadata(objects=3, frames=10))
    assert result.returncode == 0, result.stderr
    record = json.loads((place / "ingest.json").read_text())
    assert record["stage"] == "ingest" and record["seconds"] > 0 and record["peak_mb"] > 10
    assert record["inputs"] == {"source": {"path": "metadata.mat", "md5": md5(place / "metadata.mat")}}
    assert record["counts"]["frames"] == 90 and record["params"]["values"] == {"data.source": "data/virtual/recordings"}
    assert record["origin"]["python"].startswith("3.") and int(record["origin"]["cores"]) >= 1
    assert "90 frames of 32 x 32, 548 sensors, 3 objects, 9 recordings, 1 sessions" in result.stdout


def without(tree, name):
    return {key: value for key, value in tree.items() if key != name}


def with_a_nan(tree):
    return tree | {"pressure": np.where(tree["frame"][:, :, None] == 3, np.nan, tree["pressure"])}


def without_frames(tree):
    return {key: value[:0] if len(value) == 90 else value for key, value in tree.items()}


BAD_FILES = {
    "without pressure": (lambda tree: without(tree, "pressure"), "no field pressure; found objectId"),
    "of another rank": (lambda tree: tree | {"pressure": tree["pressure"][:, 0]}, "pressure has shape (90, 32);"),
    "not a number": (with_a_nan, "pressure of frame 3 of recording "),
    "id out of range": (lambda tree: tree | {"objectId": tree["objectId"] + 1}, "object id 3 of frame 60 is out of"),
    "short column": (lambda tree: tree | {"ts": tree["ts"][:-1]}, "ts has 89 values for 90 frames"),
    "zero frames": (without_frames, "no frames"),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_a_bad_file_is_refused_in_one_line_and_nothing_is_written(place, case):
    spoil, says = BAD_FILES[case]
    line = refused(ingest(place, spoil(metadata(objects=3, frames=10))))
    assert "metadata.mat" in line and says in line
    assert left(place) == set() and not (place / "recordings.h5").exists()


def test_a_missing_file_is_refused(place):
    assert "metadata.mat: no such file or folder" in refused(ingest(place))


def test_what_is_no_mat_file_is_refused(place):
    (place / "metadata.mat").write_text("frames, frames, frames\n" * 100)
    assert "metadata.mat: not a readable MAT-file" in refused(ingest(place))


@pytest.mark.parametrize("share", [0.1, 0.5, 0.95])
def test_a_truncated_file_is_refused(place, share):
    path = save_matlab5(place / "metadata.mat", metadata(objects=3, frames=10))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    assert "metadata.mat: " in refused(ingest(place))
    assert not (place / "recordings.h5").exists()


def test_a_session_without_an_empty_hand_is_refused(place):
    tree = metadata(objects=3, frames=10, sessions=2)
    keep = ~((tree["objectId"] == 0) & (tree["batchId"] == 1)).ravel()
    ingest(place, {name: value[keep] if len(value) == len(keep) else value for name, value in tree.items()})
    line = refused(preprocess(place, "preprocess.baseline=empty_hand"))
    assert "session '001' has 0 frames of 'empty_hand'" in line and "set it to auto" in line
    assert preprocess(place, "preprocess.baseline=quiet").returncode == 0


def test_what_was_decided_stands_in_the_record_beside_what_was_asked(place):
    ingest(place, metadata(objects=3, frames=30, blank=8))
    result = preprocess(place, "preprocess.contact_sensors=14")
    record = json.loads((place / "preprocess.json").read_text())
    asked, counts = record["params"]["values"], record["counts"]
    assert (asked["preprocess.baseline"], counts["resolved.preprocess.baseline"]) == ("auto", "empty_hand")
    assert (asked["preprocess.filter"], counts["resolved.preprocess.filter"]) == ("auto", "flags")
    assert "resolved.preprocess.contact_sensors" not in counts
    assert "  preprocess.baseline empty_hand: recorded in every session" in result.stdout
    assert any(note.startswith("preprocess.scale ") for note in record["notes"])


def test_objects_that_frames_without_contact_give_away_are_warned_of(place):
    tree = metadata(objects=4, frames=30, blank=14)
    sensors = tree["pressure"].min(axis=0) < tree["pressure"].max(axis=0)
    offsets = np.random.default_rng(0).choice([-3, 3], (4, 32, 32)) * sensors
    offsets[0] = 0
    ingest(place, tree | {"pressure": tree["pressure"] + offsets[tree["objectId"].ravel()].astype(np.int16)})
    for baseline, warned in (("empty_hand", True), ("grasp", False)):
        result = preprocess(place, "split.by=recording", f"preprocess.baseline={baseline}")
        record = json.loads((place / "preprocess.json").read_text())
        counts, notes = record["counts"], "".join(f"  {note}\n" for note in record["notes"])
        assert result.stdout.endswith(notes) and counts["recordings.train"] + counts["recordings.test"] == 12
        assert ("warning: better than by chance" in result.stdout) == warned, result.stderr
        assert (counts["leak.high"] < counts["leak.chance"]) == warned and counts["leak.groups"] == 9
        assert f"error of {100 * counts['leak.error']:.1f} %" in result.stdout


def test_fewer_than_two_classes_is_refused(place):
    ingest(place, metadata(objects=2, frames=10))
    line = refused(preprocess(place, "preprocess.empty_hand_class=false"))
    assert "fewer than two classes left (object1)" in line and left(place) == set()


def test_an_empty_side_is_refused(place):
    tree = metadata(objects=3, frames=10)
    ingest(place, tree | {"splitId": np.ones_like(tree["splitId"])})
    line = refused(preprocess(place))
    assert "the train side of split.by source" in line and left(place) == set()
    assert "the test side of split.by session" in refused(preprocess(place, "split.by=session", "split.fold=1"))


def test_a_split_that_the_data_does_not_have_is_refused(place):
    ingest(place, as_weights(metadata(objects=3, frames=10)))
    assert "no published split; split.by source needs it" in refused(preprocess(place))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("views=0", "views is 0; expected an integer in [1, 1000]"),
        ("views=eight", "views is 'eight'; expected an integer in [1, 1000]"),
        ("veiws=8", "unknown key veiws; did you mean views?"),
        ("cluster.methd=none", "unknown key cluster.methd; did you mean cluster.method?"),
    ],
)
def test_a_bad_parameter_is_refused_before_any_work(place, change, says):
    result = run_stage("ingest", "--source", "x", "--out", "y", "--record", "z", "--set", change, cwd=place)
    assert says in refused(result) and left(place) == set()


def test_several_mistakes_are_all_listed(place):
    changes = ("views=0", "finetune.lr=-1", "split.by=hour", "colour=red")
    words = [word for change in changes for word in ("--set", change)]
    line = refused(run_stage("ingest", "--source", "x", "--out", "y", "--record", "z", *words, cwd=place))
    assert all(says in line for says in ("views is 0", "finetune.lr is -1", "split.by is 'hour'", "unknown key colour"))


def test_debug_shows_the_traceback(place):
    result = run_stage("ingest", "--source", "x", "--out", "y", "--record", "z", "--debug", cwd=place)
    assert result.returncode == 1 and "Traceback" in result.stderr


def failing(error):
    """A stage that raises this."""

    @stage("seed")
    @click.option("--out")
    def broken(params, job, out):
        raise error

    return CliRunner().invoke(broken, ["--params", str(ROOT / "params.yaml"), "--record", "record.json"])


@pytest.mark.parametrize(
    ("error", "says"),
    [
        (UserError("views is 0;\n expected more"), "Error: views is 0; expected more\n"),
        (FileNotFoundError("a.h5: no such file"), "Error: a.h5: no such file\n"),
        (MemoryError("Unable to allocate 3 GiB"), "out of memory: Unable to allocate 3 GiB"),
        (torch.OutOfMemoryError("CUDA out of memory. Tried to allocate 2 GiB"), "Tried to allocate 2 GiB"),
        (RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory"), "out of memory: "),
    ],
)
def test_what_a_user_can_mend_ends_in_one_line(monkeypatch, error, says):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    result = failing(error)
    assert result.exit_code == 1 and says in result.output and result.output.count("\n") == 1


@pytest.mark.parametrize(
    "error",
    [
        ValueError("operands could not be broadcast together"),
        RuntimeError("CUDA error: an illegal memory access was encountered"),
        KeyError("memory"),
    ],
)
def test_a_fault_of_ours_keeps_its_traceback(monkeypatch, error):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    assert failing(error).exception is error


def test_a_torch_that_was_never_loaded_is_not_asked(place):
    code = (
        "import sys; from stages.command import _what_to_mend as line\n"
        "assert 'out of memory' in line(MemoryError()) and line(RuntimeError('x')) is None\n"
        "assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_where_no_bar_is_shown_each_epoch_prints_a_line(capsys):
    job = Job("pretrain", Run(), {})
    job.on_epoch(30)(3, {"loss": 1.2344, "validation_error": 0.5})
    assert job.curves == {"loss": [1.2344], "validation_error": [0.5]}
    assert capsys.readouterr().err.startswith("pretrain: epoch 3/30, loss 1.234, validation error 0.500, ")


def test_a_glove_of_another_shape_is_read(place):
    with h5py.File(place / "mug.h5", "w") as file:
        file["pressure"] = np.random.default_rng(0).uniform(0, 1, (20, 5, 7))
        file.attrs.update({"object": "mug", "session": "monday"})
    result = ingest(place, source="mug.h5")
    assert result.returncode == 0 and "20 frames of 5 x 7, 35 sensors, 1 objects" in result.stdout, result.stderr


def test_matlab_structures_instead_of_fields_are_refused(place):
    io.savemat(place / "metadata.mat", {"data": {"pressure": np.zeros((2, 3, 3))}})
    assert "no field pressure, objectId" in refused(ingest(place))
