"""The commands and programs in README.md and docs/ work.

Changes of parameters are allowed, options exist, and what takes seconds is run.
"""

import os
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import load, preset_changes
from tactile_viewgcn.recognition.model_file import save_classifier
from tests import glove_data
from tests.glove_data import recipe, table, trained

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(\w+)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)

SOURCES = ("my_csv", "lab")
LABELS = ("mug", "pen")


def fences(language: str) -> list[tuple[str, str]]:
    """Return page and content of every fenced block in a language."""
    return [
        (page.relative_to(ROOT).as_posix(), content)
        for page in PAGES
        for kind, content in FENCE.findall(page.read_text())
        if kind == language
    ]


def commands(start: str, without: str = "#") -> list[str]:
    """Return the commands of the pages, each once, without comments and on one line.

    Args:
        start: what they begin with.
        without: beginning of commands that are left out.
    """
    lines = [
        line for _, block in fences("bash") for line in block.replace("\\\n", " ").splitlines()
    ]
    stripped = dict.fromkeys(
        re.sub(r"\s+", " ", re.sub(r"\s+# .*$", "", line)).strip() for line in lines
    )
    return [line for line in stripped if line.startswith(start) and not line.startswith(without)]


def call(*words: str, cwd: Path, stdin: str = "") -> str:
    """Return what `python -m` with these words prints."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        [sys.executable, "-m", *words],
        cwd=cwd,
        env=environment,
        input=stdin,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.mark.parametrize("command", commands("dvc exp run "))
def test_the_changes_of_an_experiment_are_allowed(command):
    """Params.yaml takes each `-S key=value`, each value of a sweep and each preset."""
    sweeps = [
        [change]
        for name in re.findall(r"tactile-viewgcn preset (\w+)", command)
        for change in preset_changes(name)
    ]
    words = shlex.split(command)
    for change in (change for flag, change in pairwise(words) if flag == "-S"):
        key, _, value = change.partition("=")
        values = value.split(",") if "--queue" in words and not value.startswith("[") else [value]
        sweeps.append([f"{key}={one}" for one in values])
    assert sweeps
    for changes in product(*sweeps):
        load(ROOT / "params.yaml", changes)


@pytest.mark.parametrize("command", commands("python -m ", without="python -m dask"))
def test_a_program_exists_and_takes_the_options_that_are_written(command):
    module, *words = shlex.split(command)[2:]
    usage = call(module, "--help", cwd=ROOT)
    assert [word for word in words if word.startswith("--") and word not in usage] == []


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """Return a folder with what the pages take for given: recordings, params.yaml, a classifier."""
    folder = tmp_path_factory.mktemp("docs")
    shutil.copy(ROOT / "params.yaml", folder)
    for name in (
        "models",
        "data/new",
        *(f"data/my_glove/{label}" for label in ("ball", "mug", "pen")),
        *(f"data/{source}/{label}" for source in SOURCES for label in LABELS),
    ):
        (folder / name).mkdir(parents=True)
    save_classifier(folder / "models" / "classifier.pt", trained(), recipe().model, table())
    rng = np.random.default_rng(0)
    recording = (514 + rng.poisson(1, (30, 12, 12))).astype(np.int16)
    np.save(folder / "recording.npy", recording)
    for row, label in enumerate(("ball", "mug", "pen")):
        for number in range(1, 4):
            grasped = recording + rng.poisson(1, recording.shape)
            grasped[10:, 4 * row : 4 * row + 3] += 40  # each object presses other rows
            file = folder / "data" / "my_glove" / label / f"{number}.npy"
            np.save(file, grasped.astype(np.int16))
    grasped = recording.copy()
    grasped[10:, 4:7] += 40
    # a mug that is in no folder of the training set
    np.save(folder / "data" / "new" / "1.npy", grasped)
    for name in ("001-allen_key_set", "002-ball"):
        file = folder / "data" / "virtual" / "recordings" / "002" / f"{name}.h5"
        glove_data.write(file, recording)
    (logged,) = (text for _, text in fences("text") if text.startswith("timestamp,"))
    for label in LABELS:
        np.savetxt(
            folder / "data" / "my_csv" / label / "1.csv", rng.random((20, 16 * 24)), delimiter=","
        )
        for number in range(4):
            (folder / "data" / "lab" / label / f"{number}.csv").write_text(logged)
    return folder


@pytest.mark.parametrize("command", commands("tactile-viewgcn ", without="tactile-viewgcn report"))
def test_a_command_of_the_package_runs(command, place, request):
    if "weights_lite/" in command:
        place = request.getfixturevalue("stag_data")
    # no test needs one that ran before it
    if "--catalogue catalogue.csv" in command:
        (place / "catalogue.csv").unlink(missing_ok=True)
    elif "inspect catalogue.csv" in command and not (place / "catalogue.csv").exists():
        words = ("inspect", "data/my_glove", "--catalogue", "catalogue.csv")
        call("tactile_viewgcn", *words, cwd=place)
    printed = ""
    for part in command.split(" | "):  # one after another, as a pipe has them at once
        printed = call("tactile_viewgcn", *shlex.split(part)[1:], cwd=place, stdin=printed)
    assert printed.strip()


@pytest.mark.parametrize("page, program", fences("python"))
def test_a_program_runs(page, program, place, monkeypatch, tmp_path, capsys):
    if "import mlflow" in program:
        pytest.skip(
            "needs a model in an MLflow store; "
            "tests/recognition/test_mlflow_model.py loads one the same way"
        )
    if page == "docs/live.md" and "signal.signal(" in program:
        pytest.skip("runs for ever; tests/live/test_loggers.py runs it")
    monkeypatch.chdir(place)
    (tmp_path / "program.py").write_text(program)
    names = runpy.run_path(str(tmp_path / "program.py"))
    if page == "README.md":
        (printed,) = (text for _, text in fences("text") if text.startswith("['"))
        assert capsys.readouterr().out == printed
    for made in names.values():
        if isinstance(made, type) and issubclass(made, ViewSystem) and made is not ViewSystem:
            logits, aux = made(torch.rand(4, 3), (6,), 3, recipe().model)(torch.rand(2, 4, 6))
            assert logits.shape == (2, 3) and aux == []
    if "probabilities" in names:
        np.testing.assert_allclose(np.sum(names["probabilities"], axis=-1), 1, rtol=1e-5)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_files_lead_somewhere(page):
    targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text())
    assert [target for target in targets if not (page.parent / target).exists()] == []
