"""Commands and programs in README.md and docs/: each is run here, checked, or listed with the reason why not."""

import importlib.util
import os
import re
import shlex
import shutil
import subprocess
import sys
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from tactile_viewgcn.nn.system import Sizes, ViewSystem
from tactile_viewgcn.params import load
from tactile_viewgcn.recognition.model_file import save_classifier
from tests import glove_data
from tests.glove_data import recipe, table, trained

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"^```(\w+)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)

#: How commands that are not run here begin, and why not.
ELSEWHERE = {
    "python3 -m venv": "installs",
    "pip install": "installs; .ci/run does it",
    "dvc repro": "minutes; tests/stages/test_pipeline.py runs it on tiny data",
    "dvc exp show": "needs experiments; tests/stages/test_pipeline.py makes some",
    "python -m dask": "processes that do not end; tests/studies/test_run.py starts them",
    "dvc plots show": "needs results",
    "dvc queue start": "starts processes that outlive a test; tests/stages/test_pipeline.py runs the queue",
    "tactile-viewgcn report": "needs results; tests/stages/test_report_page.py runs it",
    **dict.fromkeys(("mutmut run", "mutmut results"), "hours"),
    "mlflow": "a server that does not end; tests/recognition/test_mlflow_model.py starts one",
    "curl": "needs that server",
    "export": "sets a variable",
    **dict.fromkeys(("ruff check", "mypy", "pytest", "mkdocs build", ".ci/run"), ".ci/run does it"),
}


def fences(language: str) -> list[tuple[str, str]]:
    """(page, content) of every fenced block in that language."""
    return [
        (page.relative_to(ROOT).as_posix(), content)
        for page in PAGES
        for kind, content in FENCE.findall(page.read_text())
        if kind == language
    ]


def commands() -> list[str]:
    """Every command of the bash fences, once, without comments, continued lines joined."""
    lines = [line for _, block in fences("bash") for line in block.replace("\\\n", " ").splitlines()]
    stripped = [re.sub(r"\s+", " ", re.sub(r"\s+# .*$", "", line)).strip() for line in lines]
    return list(dict.fromkeys(line for line in stripped if line))


def checked_by(command: str) -> str | None:
    """How a command is checked here, by its first words; None where nobody does."""
    if any(command == start or command.startswith(f"{start} ") for start in ELSEWHERE):
        return "elsewhere"
    kinds = {"dvc exp run ": "changes", "python -m ": "module", "tactile-viewgcn ": "run"}
    return next((kind for start, kind in kinds.items() if command.startswith(start)), None)


def those(kind: str) -> list[str]:
    return [command for command in commands() if checked_by(command) == kind]


def call(*words: str, cwd: Path) -> str:
    """What `python -m` with these words prints."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    result = subprocess.run(
        [sys.executable, "-m", *words], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_every_command_is_checked_or_listed_with_a_reason():
    assert [command for command in commands() if checked_by(command) is None] == []
    assert [start for start in ELSEWHERE if not any(one.startswith(start) for one in commands())] == [], "in no page"


@pytest.mark.parametrize("command", those("changes"))
def test_the_changes_of_an_experiment_are_allowed(command):
    """Each `-S key=value`, and each value of a sweep, is a change that params.yaml takes."""
    words = shlex.split(re.sub(r"\$\(tactile-viewgcn preset (\w+)\)", lambda name: preset_options(name[1]), command))
    sweeps = []
    for flag, change in pairwise(words):
        if flag == "-S":
            key, _, value = change.partition("=")
            values = value.split(",") if "--queue" in words and not value.startswith("[") else [value]
            sweeps.append([f"{key}={one}" for one in values])
    assert sweeps
    for changes in product(*sweeps):
        load(ROOT / "params.yaml", changes)


def preset_options(name: str) -> str:
    return call("tactile_viewgcn", "preset", name, cwd=ROOT).strip()


@pytest.mark.parametrize("command", those("module"))
def test_a_program_exists_and_takes_the_options_that_are_written(command):
    module, *words = shlex.split(command)[2:]
    assert importlib.util.find_spec(module), f"no module {module}"
    usage = call(module, "--help", cwd=ROOT)
    assert [word for word in words if word.startswith("--") and word not in usage] == []


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A folder with what the pages take for given: recordings, params.yaml, trained classifiers, counts."""
    folder = tmp_path_factory.mktemp("docs")
    shutil.copy(ROOT / "params.yaml", folder)
    (folder / "models").mkdir()
    save_classifier(folder / "models" / "classifier.pt", trained(), recipe().model, table())
    rng = np.random.default_rng(0)
    np.save(folder / "counts.npy", (514 + rng.poisson(3, (2, 4, 12, 12))).astype(np.int16))
    recording = (514 + rng.poisson(1, (30, 12, 12))).astype(np.int16)
    np.save(folder / "recording.npy", recording)
    glove_data.write(folder / "data" / "new" / "1.h5", recording)
    np.save(folder / "empty_hand.npy", (514 + rng.poisson(1, (20, 12, 12))).astype(np.int16))
    run_program("mug_1.h5", folder)
    for name in ("mug", "pen"):
        (folder / "data" / "my_csv" / name).mkdir(parents=True)
        np.savetxt(folder / "data" / "my_csv" / name / "1.csv", rng.random((20, 16 * 24)), delimiter=",")
        (folder / "data" / "lab" / name).mkdir(parents=True)
        (logged,) = (text for page, text in fences("text") if page == "docs/logger.md")
        for number in range(4):
            (folder / "data" / "lab" / name / f"{number}.csv").write_text(logged)
    (folder / "data" / "my_glove").mkdir(parents=True)
    shutil.copy(folder / "mug_1.h5", folder / "data" / "my_glove")
    return folder


def run_program(word: str, folder: Path) -> None:
    """Run the one program of the pages that has this word, in this folder."""
    (program,) = (block for _, block in fences("python") if word in block)
    subprocess.run([sys.executable, "-c", program], cwd=folder, check=True)


@pytest.mark.parametrize("command", those("run"))
def test_a_command_of_the_package_runs(command, place):
    assert call("tactile_viewgcn", *shlex.split(command)[1:], cwd=place).strip()


@pytest.mark.parametrize("page, program", fences("python"))
def test_a_program_runs(page, program, place, monkeypatch, capsys):
    if "import mlflow" in program:
        pytest.skip("needs a model in an MLflow store; tests/recognition/test_mlflow_model.py loads one the same way")
    monkeypatch.chdir(place)
    names: dict = {}
    exec(compile(program, page, "exec"), names)
    for made in names.values():
        if isinstance(made, type) and issubclass(made, ViewSystem) and made is not ViewSystem:
            logits, aux = made(Sizes(torch.rand(4, 3), (6,), 3), recipe().model)(torch.rand(2, 4, 6))
            assert logits.shape == (2, 3) and aux == []
    if "probabilities" in names:
        np.testing.assert_allclose(np.sum(names["probabilities"], axis=-1), 1, rtol=1e-5)


@pytest.mark.parametrize("page, text", fences("yaml"))
def test_yaml_is_well_formed_and_a_study_s_changes_are_allowed(page, text):
    tree = yaml.safe_load(text)
    assert tree
    for changes in tree.get("variants", {}).values():
        load(ROOT / "params.yaml", [f"{key}={value}" for key, value in (tree.get("set", {}) | changes).items()])


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_files_lead_somewhere(page):
    targets = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text())
    assert [target for target in targets if not (page.parent / target).exists()] == []
