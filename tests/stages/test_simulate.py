"""The simulate stage: a glove that cannot be ends in one line, and DVC runs it where data.source is what it writes."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tactile_viewgcn.readers.formats import open_source
from tests.small_tables import ROOT
from tests.stages.running import refused, run_stage

TINY = {"objects": ["ball"], "sessions": 2, "grasps": 1, "grasp_frames": 17}
CUP = {"name": "cup", "weight": 90, "stiffness": 1e9, "parts": [{"sphere": {"radius": 0.03}}]}


def change(place, section, **values):
    """Put values into a section of params.yaml."""
    tree = yaml.safe_load((place / "params.yaml").read_text())
    tree[section] |= values
    (place / "params.yaml").write_text(yaml.safe_dump(tree, sort_keys=False))


@pytest.fixture
def place(tmp_path):
    """A folder with params.yaml, set to the smallest of gloves."""
    shutil.copy(ROOT / "params.yaml", tmp_path)
    change(tmp_path, "glove", **TINY)
    return tmp_path


def simulate(place, *changes):
    words = [word for change in changes for word in ("--set", change)]
    return run_stage("simulate", "--out", "recordings", "--record", "simulate.json", *words, cwd=place)


def described(**changes):
    return "glove.objects=" + json.dumps([CUP | changes])


def test_recordings_are_written_with_what_they_cost(place):
    result = simulate(place)
    assert result.returncode == 0, result.stderr
    assert "68 simulated frames of 4 recordings, virtual glove version" in result.stdout
    source = open_source(place / "recordings")
    assert source.objects == ["empty_hand", "ball"] and source.sessions == ["000", "001"]
    record = json.loads((place / "simulate.json").read_text())
    assert record["stage"] == "simulate" and record["seconds"] > 0


BAD = {
    "a negative stiffness of the skin": ("glove.skin_stiffness=-1", "glove.skin_stiffness is -1; expected a number"),
    "a shape of no size": (
        described(parts=[{"sphere": {"radius": 0}}]),
        "object cup: shape with half sizes (0, 0) and rounding 0 m has no extent; give it some",
    ),
    "a position that is no number": (
        described(position=[0, 0, ".nan"]).replace('".nan"', ".nan"),
        "object cup: position is (0, 0, nan); expected 3 numbers",
    ),
    "another effect": ("glove.leave_out=[frcition]", "glove.leave_out is ['frcition']; expected a list of motion |"),
    "another object": ("glove.objects=[mugg]", "unknown object 'mugg'; did you mean mug?"),
    "grasps too short": ("glove.grasp_frames=5", "5 frames for 1 grasps leave 5 each; expected more than"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_glove_that_cannot_be_is_refused_in_one_line_and_nothing_is_left(place, case):
    setting, says = BAD[case]
    assert says in refused(simulate(place, setting))
    assert [path.name for path in place.iterdir()] == ["params.yaml"]


@pytest.fixture
def repository(place):
    """What DVC needs of this repository, with the tiny glove's parameters."""
    shutil.copy(ROOT / "dvc.yaml", place)
    (place / "data" / "virtual").mkdir(parents=True)
    shutil.copy(ROOT / "data" / "virtual" / "dvc.yaml", place / "data" / "virtual")
    for name in (".gitignore", ".dvcignore"):
        shutil.copy(ROOT / name, place)
    for package in ("stages", "tactile_viewgcn"):
        shutil.copytree(ROOT / package, place / package, ignore=shutil.ignore_patterns("__pycache__"))
    call(place, "git", "init", "-q")
    call(place, sys.executable, "-m", "dvc", "init", "-q")
    return place


def call(place, *words):
    environment = {key: value for key, value in os.environ.items() if not key.startswith("DVC_")}
    environment |= {"MLFLOW_TRACKING_URI": "disabled", "DVC_NO_ANALYTICS": "1"}
    environment["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    result = subprocess.run(words, cwd=place, env=environment, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def repro(place, *words):
    """The stages that `dvc repro` runs."""
    output = call(place, sys.executable, "-m", "dvc", "repro", *words)
    return re.findall(r"^Running stage '(?:.*:)?(\w+)'", output, re.MULTILINE)


@pytest.mark.slow
def test_dvc_simulates_where_the_source_is_what_the_glove_writes_and_nowhere_else(repository):
    assert repro(repository, "ingest") == ["simulate", "ingest"]
    assert open_source(repository / "data" / "virtual" / "recordings").objects == ["empty_hand", "ball"]
    assert (repository / "runs" / "simulate.json").is_file()
    assert repro(repository, "ingest") == []
    status = call(repository, "git", "status", "--porcelain", "-uall")
    kept = {line[3:] for line in status.splitlines()}
    assert not any(name.startswith("data/virtual/recordings") or name.endswith(".h5") for name in kept)
    assert "data/virtual/dvc.lock" in kept  # what belongs into git is not ignored
    shutil.copytree(repository / "data" / "virtual" / "recordings", repository / "own")
    change(repository, "data", source="own")
    change(repository, "glove", seed=1)
    assert repro(repository, "ingest") == ["ingest"]
    change(repository, "data", source="data/virtual/recordings")
    assert repro(repository, "ingest") == ["simulate", "ingest"]
