"""The command line `tactile-viewgcn`."""

import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from tactile_viewgcn.params import load, preset_changes
from tactile_viewgcn.recordings.formats import open_source
from tactile_viewgcn.recordings.table import write_recordings
from tactile_viewgcn.schema import flatten
from tests.stag_files import metadata, save_hdf5, save_matlab5

ROOT = Path(__file__).parents[1]


def call(*words, cwd=ROOT):
    command = [sys.executable, "-m", "tactile_viewgcn", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def test_check_counts_the_values_and_looks_for_the_source(tmp_path):
    source = save_matlab5(tmp_path / "metadata.mat", metadata(objects=2, frames=4))
    result = call("check", "--set", f"data.source={source}")
    count = len(flatten(load(ROOT / "params.yaml")))
    assert result.returncode == 0 and f"{count} values" in result.stdout
    result = call("check", "--set", "data.source=nowhere.mat")
    assert result.returncode == 1 and "data.source is nowhere.mat" in result.stderr


def test_check_lists_every_mistake_in_one_line():
    result = call("check", "--set", "views=0", "--set", "colour=red")
    assert result.returncode == 1 and len(result.stderr.splitlines()) == 1
    assert "unknown key colour" in result.stderr and "views is 0; expected an integer in [1, 1000]" in result.stderr


def test_inspect_says_what_a_source_holds(tmp_path):
    source = save_matlab5(tmp_path / "metadata.mat", metadata(objects=3, recordings=2, frames=5))
    result = call("inspect", source)
    assert "30 frames of 32 x 32, 6 recordings, 1 sessions" in result.stdout
    assert "empty_hand 10, object1 10, object2 10" in result.stdout and "split" in result.stdout


def test_inspect_of_the_pipelines_table_says_the_same_as_of_its_source(tmp_path):
    tree = metadata(objects=3, recordings=2, frames=5)
    source = save_matlab5(tmp_path / "metadata.mat", tree)
    write_recordings(tmp_path / "recordings.h5", open_source(source), "0" * 32)
    first, *rest = call("inspect", source).stdout.replace(str(source), "IT").splitlines()
    result = call("inspect", tmp_path / "recordings.h5")
    assert first == "IT: 30 frames of 32 x 32, 6 recordings, 1 sessions, 548 sensors that vary"
    assert result.stdout.replace(str(tmp_path / "recordings.h5"), "IT").splitlines() == [
        first.replace("IT:", "IT, written by ingest:"),
        *rest,
    ]


def test_inspect_of_nothing_is_one_line():
    result = call("inspect", "nowhere")
    assert result.returncode == 1 and result.stderr.startswith("Error: nowhere: no such file") and not result.stdout


@pytest.mark.parametrize("form", ["lab", "table"])
def test_convert_writes_what_stag_readers_read(tmp_path, form):
    source = save_hdf5(tmp_path / "lab", metadata(objects=3, recordings=2, frames=5))
    if form == "table":
        write_recordings(tmp_path / "recordings.h5", open_source(source), "0" * 32)
        source = tmp_path / "recordings.h5"
    out = tmp_path / "new" / "metadata.mat"
    result = call("convert", source, out)
    assert result.stdout.startswith(f"{out}: 30 frames; fields: batchId, batches, frame, hasValidLabel, objectId,")
    assert call("inspect", out).stdout.replace(str(out), "IT") == call("inspect", source).stdout.replace(
        str(source), "IT"
    ).replace(", written by ingest", "")


def test_convert_of_real_numbers_is_one_line_and_writes_nothing(tmp_path):
    with h5py.File(tmp_path / "mug.h5", "w") as file:
        file["pressure"] = np.full((3, 2, 2), 0.5)
        file.attrs.update({"object": "mug", "session": "monday"})
    result = call("convert", tmp_path / "mug.h5", tmp_path / "metadata.mat")
    assert result.returncode == 1 and len(result.stderr.splitlines()) == 1
    assert "mug.h5: pressure in real numbers; expected integer counts" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mug.h5"]


def test_convert_never_writes_over_a_file(tmp_path):
    source = save_matlab5(tmp_path / "metadata.mat", metadata(objects=2, frames=4))
    content = source.read_bytes()
    result = call("convert", source, source)
    assert result.returncode == 1 and "metadata.mat: exists" in result.stderr
    assert source.read_bytes() == content


def test_preset_prints_its_changes_as_options_of_dvc():
    words = call("preset", "released").stdout.split()
    assert words[::2] == ["-S"] * (len(words) // 2) and words[1::2] == preset_changes("released")


@pytest.mark.stability("libraries")
def test_help_takes_no_heavy_imports(row):
    code = "import sys; from tactile_viewgcn.cli import cli; cli(['--help'], standalone_mode=False)\n"
    code += "print('imported', *{'torch', 'mlflow', 'numpy', 'scipy', 'sklearn'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True)
    imported = done.stdout.split("imported")[-1].split()
    row("torch, NumPy, SciPy, scikit-learn or MLflow in --help", len(imported), 0, " ".join(imported))


def test_a_wrong_word_is_a_usage_error():
    assert call("preset", "relesed").returncode == 2


def test_check_knows_that_the_default_source_is_simulated(tmp_path):
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    result = call("check", cwd=tmp_path)
    assert result.returncode == 0 and "`dvc repro` simulates it" in result.stdout
