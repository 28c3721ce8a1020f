"""The command line `tactile-viewgcn`."""

import os
import re
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from tactile_viewgcn.params import load, preset_changes
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.tables.recordings import write_recordings
from tests.stag_files import metadata, save_matlab5

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
    assert "30 frames of 32 x 32, kept as int16" in result.stdout
    assert "6 recordings of 3 objects in 1 session" in result.stdout
    assert "optional columns: split, valid, balanced, transition, grip" in result.stdout
    assert "548 of 1024 sensors vary" in result.stdout
    assert re.search(r"^  object2 +2 +10 +\d+ +\d+ +\d+$", result.stdout, re.MULTILINE)


def inspected(path):
    """The lines of `inspect` before the command, which names the path."""
    return call("inspect", path).stdout.split("\n\n")[0].splitlines()


def test_inspect_of_the_pipelines_table_says_the_same_as_of_its_source(tmp_path):
    tree = metadata(objects=3, recordings=2, frames=5)
    source = save_matlab5(tmp_path / "metadata.mat", tree)
    write_recordings(tmp_path / "recordings.h5", open_source(source), "0" * 32)
    first, *rest = inspected(source)
    table, *same = inspected(tmp_path / "recordings.h5")
    assert (first, table) == (str(source), f"{tmp_path / 'recordings.h5'}, written by ingest")
    assert rest == same and "To use" in rest


def test_inspect_lists_the_mistakes_of_all_files_at_once(tmp_path):
    for name, value in (("a", 1.0), ("b", np.nan), ("c", np.inf), ("d", 1.0)):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file["pressure"] = np.full((3, 2, 2), value)
            file.attrs.update({"object": "mug", "session": "monday"} if name != "d" else {"object": "mug"})
    result = call("inspect", tmp_path)
    assert result.returncode == 1 and len(result.stderr.splitlines()) == 1 and not result.stdout
    for mistake in ("d.h5: no attribute 'session'", "recording b is nan", "recording c is inf"):
        assert mistake in result.stderr


def test_inspect_of_nothing_is_one_line():
    result = call("inspect", "nowhere")
    assert result.returncode == 1 and result.stderr.startswith("Error: nowhere: no such file") and not result.stdout


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


def test_a_command_that_needs_what_is_not_installed_says_so_in_one_line():
    program = (
        "import sys; sys.modules |= {'dvc': None, 'mlflow': None}; sys.argv = ['tactile-viewgcn', 'report', 'exp-1']\n"
        "from tactile_viewgcn.cli import main; main()"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 1 and len(result.stderr.splitlines()) == 1
    assert "pip install 'tactile-viewgcn[pipeline]'" in result.stderr
