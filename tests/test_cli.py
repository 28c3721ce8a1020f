"""The command line `tactile-viewgcn`."""

import json
import os
import re
import subprocess
import sys
import time
from itertools import product
from pathlib import Path

import h5py
import numpy as np
import pytest

from tactile_viewgcn.params import load, preset_changes, presets
from tactile_viewgcn.schema import flatten
from tests.stag_files import metadata, save_matlab5

ROOT = Path(__file__).parents[1]


def call(*words, cwd=ROOT):
    command = [sys.executable, "-m", "tactile_viewgcn", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)


def test_check_counts_the_values_and_looks_for_the_source(tmp_path):
    source = save_matlab5(tmp_path / "metadata.mat", metadata(objects=2, frames=4))
    result = call("check", "--set", f"data.source={source}")
    assert result.returncode == 0 and f"{len(flatten(load(ROOT / 'params.yaml')))} values" in result.stdout
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    assert "`dvc repro` simulates it" in call("check", cwd=tmp_path).stdout
    for words, says in (("data.source=nowhere.mat", "data.source is nowhere.mat"), ("views=0", "views: ")):
        result = call("check", "--set", words)
        assert result.returncode == 1 and len(result.stderr.splitlines()) == 1 and says in result.stderr


def test_inspect_takes_the_folder_that_it_is_called_in(tmp_path):
    for label, number in product(("mug", "pen"), range(2)):
        path = tmp_path / label / f"{number}.npy"
        path.parent.mkdir(exist_ok=True)
        np.save(path, np.random.default_rng(number).integers(0, 99, (20, 4, 4)))
    result = call("inspect", ".", cwd=tmp_path)
    assert result.returncode == 0 and f"data.source={tmp_path}" in result.stdout
    refused = call("inspect", "mug/0.npy", "--html", "mug/0.npy", cwd=tmp_path)
    assert refused.returncode == 1 and "it is read here" in refused.stderr
    assert len(np.load(tmp_path / "mug" / "0.npy")) == 20


def test_inspect_says_what_a_source_holds(tmp_path):
    source = save_matlab5(tmp_path / "metadata.mat", metadata(objects=3, recordings=2, frames=5))
    result = call("inspect", source)
    assert "30 frames of 32 x 32, kept as int16" in result.stdout
    assert "6 recordings of 3 objects in 1 session" in result.stdout
    assert "optional columns: split, valid, balanced" in result.stdout
    assert "548 of 1024 sensors vary" in result.stdout
    assert re.search(r"^  object2 +2 +10 +\d+ +\d+ +\d+$", result.stdout, re.MULTILINE)


def test_inspect_lists_the_mistakes_of_all_files_at_once(tmp_path):
    for name, value in (("a", 1.0), ("b", np.nan), ("c", np.inf)):
        with h5py.File(tmp_path / f"{name}.h5", "w") as file:
            file["pressure"] = np.full((3, 2, 2), value)
            file.attrs.update({"object": "mug", "session": "monday"})
    result = call("inspect", tmp_path)
    assert result.returncode == 1 and len(result.stderr.splitlines()) == 1 and not result.stdout
    assert "recording b is nan" in result.stderr and "recording c is inf" in result.stderr
    assert call("inspect", "nowhere").stderr.startswith("Error: nowhere: no such file")


def test_inspect_hands_the_layout_of_arrays_on_to_the_command(tmp_path):
    for name in ("mug", "pen"):
        (tmp_path / "my glove" / name).mkdir(parents=True)
        np.save(tmp_path / "my glove" / name / "1.npy", np.random.default_rng(0).random((20, 12)))
    for words, shape in (((), "[1,12]"), (("--shape", 3, 4), "[3,4]")):
        result = call("inspect", tmp_path / "my glove", *words)
        assert f"-S 'data.shape={shape}'" in result.stdout, result.stderr
        assert load(ROOT / "params.yaml", (f"data.shape={shape}",)).data.shape == json.loads(shape)
    for wrong in ("[4]", "[4,65]", "4", "[4,4.0]"):
        result = call("check", "--set", f"data.shape={wrong}")
        assert "data.shape: " in result.stderr


def test_preset_prints_its_changes_as_options_of_dvc():
    words = call("preset", "released").stdout.split()
    assert words[::2] == ["-S"] * (len(words) // 2) and words[1::2] == preset_changes("released")


@pytest.mark.parametrize("name", ["bset", ""])
def test_a_preset_that_is_not_there_is_an_option_that_dvc_refuses(name):
    result = call("preset", name)
    assert result.returncode == 1 and result.stdout == f"-S no-such-preset={name}\n"
    assert len(result.stderr.splitlines()) == 1 and "best" in result.stderr
    refused = subprocess.run(
        [sys.executable, "-m", "dvc", "exp", "run", "--dry", *result.stdout.split()], cwd=ROOT, capture_output=True
    )
    assert refused.returncode and b"no-such-preset" in refused.stderr


def test_help_says_in_a_line_what_each_preset_is_for():
    text = " ".join(call("preset", "--help").stdout.split())
    assert len(presets()) == 9 and all(f" {name} {purpose}" in text for name, purpose in presets().items())


@pytest.mark.stability("libraries")
def test_help_takes_no_heavy_imports(row):
    code = "import sys; from tactile_viewgcn.cli import cli; cli(['--help'], standalone_mode=False)\n"
    code += "print('imported', *{'torch', 'mlflow', 'numpy', 'scipy', 'sklearn'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True, text=True)
    imported = done.stdout.split("imported")[-1].split()
    row("torch, NumPy, SciPy, scikit-learn or MLflow in --help", len(imported), 0, " ".join(imported))


def test_a_command_that_needs_what_is_not_installed_says_so_in_one_line():
    program = (
        "import sys; sys.modules |= {'dvc': None, 'mlflow': None}; sys.argv = ['tactile-viewgcn', 'report', 'exp-1']\n"
        "from tactile_viewgcn.cli import main; main()"
    )
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 1 and len(result.stderr.splitlines()) == 1
    assert "pip install 'tactile-viewgcn[pipeline]'" in result.stderr


def test_names_do_nothing_to_a_terminal_or_a_page(tmp_path):
    rng, names = np.random.default_rng(0), ("m\x1b[31mug\n", "p\u202een")
    for name in names:
        (tmp_path / "lab" / name).mkdir(parents=True)
        for number in range(3):
            np.save(tmp_path / "lab" / name / f"{number}.npy", rng.integers(500, 530, (30, 4, 4), dtype=np.int16))
    result = call("inspect", tmp_path / "lab", "--html", tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text()
    assert result.returncode == 0, result.stderr
    for text in (result.stdout, page):
        assert r"m\x1b[31mug\n" in text and r"p\u202een" in text
        assert all(line.isprintable() for line in text.replace("\xa0", "").splitlines())


def test_what_is_ended_leaves_no_temporary_folder(tmp_path):
    (tmp_path / "lab" / "mug").mkdir(parents=True)
    (place := tmp_path / "temporary").mkdir()
    rng = np.random.default_rng(0)
    np.save(tmp_path / "lab" / "mug" / "1.npy", rng.integers(500, 530, (120_000, 16, 16), dtype=np.int16))
    command = [sys.executable, "-m", "tactile_viewgcn", "inspect", tmp_path / "lab"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(place)}
    process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    while not list(place.glob("tactile-viewgcn-*/recordings.h5")):
        assert process.poll() is None
        time.sleep(0.01)
    process.terminate()
    assert process.wait(60) == 143
    assert list(place.iterdir()) == []
