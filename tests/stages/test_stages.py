"""dvc.yaml says what the stages read, the stages read no more, and what a user can mend ends in one line."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml
from scipy import io

from tests.imports import closure, imported
from tests.stag_files import as_weights, metadata, save_matlab5

ROOT = Path(__file__).parents[1]
FILES = ("dvc.yaml", "data/virtual/dvc.yaml")
STAGES = {name: stage for file in FILES for name, stage in yaml.safe_load((ROOT / file).read_text())["stages"].items()}


def run_stage(name, *words, cwd):
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled", "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", f"stages.{name}", *map(str, words)]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


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


@pytest.mark.parametrize("name", sorted(STAGES))
def test_a_stage_depends_on_the_modules_that_it_imports(name):
    listed = {path for path in STAGES[name]["deps"] if path.endswith(".py")}
    assert listed == closure(f"stages/{name}.py")


@pytest.mark.parametrize("name", sorted(STAGES))
def test_a_stage_is_given_the_parameters_that_dvc_watches(name):
    import importlib

    module = importlib.import_module(f"stages.{name}")
    assert list(getattr(module, name).reads) == STAGES[name]["params"]


def test_every_parameter_is_watched_by_a_stage():
    tree = yaml.safe_load((ROOT / "params.yaml").read_text())
    watched = {key for stage in STAGES.values() for key in stage["params"]}
    whole = {key for key in watched if "." not in key}
    assert whole == set(tree)
    for section, name in (part.split(".") for part in watched - whole):
        assert name in tree[section]


def test_a_stage_that_reads_a_part_of_a_section_is_given_and_logs_that_part_alone():
    from stages.command import _declared, _given
    from tactile_viewgcn.params import load

    params, reads = load(ROOT / "params.yaml"), ("seed", "model.backbone", "augment")
    given = _given(params, reads)
    assert vars(given).keys() == {"seed", "model", "augment"}
    assert vars(given.model) == {"backbone": params.model.backbone}
    assert (given.seed, given.augment) == (params.seed, params.augment)
    logged = {f"model.backbone.{name}" for name in vars(params.model.backbone)}
    assert _declared(params, reads).keys() == logged | {"seed", "augment.gain", "augment.drop", "augment.shift"}


@pytest.mark.parametrize("package", ["stages", "tactile_viewgcn", "tactile_viewgcn/nn", "tactile_viewgcn/glove"])
def test_package_files_hold_nothing_that_a_stage_could_depend_on(package):
    import ast

    (docstring,) = ast.parse((ROOT / package / "__init__.py").read_text()).body
    assert isinstance(docstring, ast.Expr)


def test_only_tracking_imports_mlflow_and_networks_import_nothing_of_the_rest():
    for path in (*ROOT.glob("tactile_viewgcn/*.py"), *ROOT.glob("stages/*.py")):
        names = imported(str(path.relative_to(ROOT)))
        assert path.name == "tracking.py" or not any(name.split(".")[0] == "mlflow" for name in names), path
    for path in ROOT.glob("tactile_viewgcn/nn/*.py"):
        own = {name for name in imported(str(path.relative_to(ROOT))) if name.startswith("tactile_viewgcn")}
        assert all(name.startswith("tactile_viewgcn.nn") for name in own), path


def test_nothing_but_the_simulate_stage_imports_the_virtual_glove_and_it_imports_little_of_the_rest():
    glove = "tactile_viewgcn.glove"
    for path in (*ROOT.glob("tactile_viewgcn/**/*.py"), *ROOT.glob("stages/*.py")):
        names = {name for name in imported(str(path.relative_to(ROOT))) if name.startswith("tactile_viewgcn.")}
        if path.parent.name == "glove":
            allowed = (glove, "tactile_viewgcn.files", "tactile_viewgcn.randomness")
            assert all(name.startswith(allowed) for name in names), path
        elif path != ROOT / "stages" / "simulate.py":
            assert not any(name.startswith(glove) for name in names), path


def test_the_virtual_glove_takes_no_torch():
    code = "import sys, stages.simulate; assert not {'torch', 'mlflow', 'sklearn', 'matplotlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_dvc_runs_the_virtual_glove_in_the_root_and_its_output_is_the_sources_default():
    stage = STAGES["simulate"]
    place = (ROOT / "data" / "virtual" / stage["wdir"]).resolve()
    source = yaml.safe_load((ROOT / "params.yaml").read_text())["data"]["source"]
    assert place == ROOT and source in stage["outs"] and f"--out {source} " in stage["cmd"]


def test_importing_the_package_takes_no_torch():
    code = (
        "import sys, tactile_viewgcn, tactile_viewgcn.cli; assert not {'torch', 'mlflow', 'numpy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


def test_an_unclustered_run_takes_no_scikit_learn(place):
    ingest(place, metadata(objects=3, frames=10))
    preprocess(place, "split.by=recording")
    code = (
        "import sys; from stages.cluster import cluster\n"
        "cluster(['--frames','frames.h5','--out','views.h5','--record','c.json','--set','cluster.method=none'],"
        "standalone_mode=False)\nassert 'sklearn' not in sys.modules"
    )
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled", "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=place, env=environment)


@pytest.mark.parametrize("name", ["it's mine.mat", 'a "b" `c`.mat', "$HOME & ${seed};#*.mat"])
def test_dvc_hands_on_a_source_whatever_letters_its_path_has(place, name):
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
    "short column": (lambda tree: tree | {"ts": tree["ts"][:-1]}, "ts has 89 values; expected one per frame, 90"),
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
    line = refused(preprocess(place))
    assert "session '001' has 0 frames of 'empty_hand'" in line and "quiet" in line
    assert preprocess(place, "preprocess.baseline=quiet").returncode == 0


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


def test_a_glove_of_another_shape_is_read(place):
    with h5py.File(place / "mug.h5", "w") as file:
        file["pressure"] = np.random.default_rng(0).uniform(0, 1, (20, 5, 7))
        file.attrs.update({"object": "mug", "session": "monday"})
    result = ingest(place, source="mug.h5")
    assert result.returncode == 0 and "20 frames of 5 x 7, 35 sensors, 1 objects" in result.stdout, result.stderr


def test_matlab_structures_instead_of_fields_are_refused(place):
    io.savemat(place / "metadata.mat", {"data": {"pressure": np.zeros((2, 3, 3))}})
    assert "no field pressure, objectId" in refused(ingest(place))
