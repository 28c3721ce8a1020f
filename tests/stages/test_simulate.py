"""The simulate stage: a glove that cannot be ends in one line, and DVC runs it where data.source is what it writes."""

import json
import shutil

import pytest
import yaml

from tactile_viewgcn.readers.formats import open_source
from tests.glove_data import ROOT
from tests.stages.running import copy_pipeline, ran, refused, run_stage, sh

TINY = {"objects": ["ball"], "sessions": 2, "grasps": 1, "grasp_frames": 17}


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


def test_recordings_are_written_with_what_they_cost(place):
    result = simulate(place)
    assert result.returncode == 0, result.stderr
    assert "100 simulated frames of 4 recordings, virtual glove version" in result.stdout
    source = open_source(place / "recordings")
    assert source.objects == ["empty_hand", "ball"] and source.sessions == ["000", "001"]
    record = json.loads((place / "simulate.json").read_text())
    assert record["stage"] == "simulate" and record["seconds"] > 0


def test_a_glove_that_cannot_be_is_refused_in_one_line_and_nothing_is_left(place):
    cup = {"name": "cup", "weight": 90, "stiffness": 1e9, "parts": [{"sphere": {"radius": 0}}]}
    line = refused(simulate(place, f"glove.objects={json.dumps([cup])}"))
    assert "object 'cup': parts: thinner than 1e-05 m" in line
    assert [path.name for path in place.iterdir()] == ["params.yaml"]


def test_what_later_stages_cannot_do_ends_before_anything_is_simulated(place):
    for change, says in (("views=abc", "(got 'abc')"), ("model.neighbours=[3,3]", "model.neighbours")):
        assert says in refused(simulate(place, change))
        assert [path.name for path in place.iterdir()] == ["params.yaml"]


def repro(place):
    """The stages that `dvc repro ingest` runs."""
    return ran(sh("dvc", "repro", "ingest", cwd=place, MLFLOW_TRACKING_URI="disabled", DVC_NO_ANALYTICS="1"))


@pytest.mark.slow
def test_dvc_simulates_where_the_source_is_what_the_glove_writes_and_nowhere_else(place):
    copy_pipeline(place)
    sh("git", "init", "-q", cwd=place)
    sh("dvc", "init", "-q", cwd=place)
    assert repro(place) == ["simulate", "ingest"]
    assert open_source(place / "data" / "virtual" / "recordings").objects == ["empty_hand", "ball"]
    assert (place / "runs" / "simulate.json").is_file()
    assert repro(place) == []
    status = sh("git", "status", "--porcelain", "-uall", cwd=place)
    kept = {line[3:] for line in status.splitlines()}
    assert not any(name.startswith("data/virtual/recordings") or name.endswith(".h5") for name in kept)
    assert "data/virtual/dvc.lock" in kept  # what belongs into git is not ignored
    shutil.copytree(place / "data" / "virtual" / "recordings", place / "own")
    change(place, "data", source="own")
    change(place, "glove", seed=1)
    assert repro(place) == ["ingest"]
    change(place, "data", source="data/virtual/recordings")
    assert repro(place) == ["simulate", "ingest"]
