"""The stage ingest at its command line: what it reads, records and refuses."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import yaml

from tactile_viewgcn.files import md5
from tests.stag_files import metadata, save_matlab5
from tests.stages.running import ingest, left, refused

ROOT = Path(__file__).parents[2]


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
    (place / ".dvc").mkdir()
    (place / ".dvc" / "config").write_text("[core]\n    no_scm = true\n")
    command = [sys.executable, "-m", "dvc", "repro", "ingest"]
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


def test_bad_and_missing_files_are_refused_in_one_line_and_nothing_is_written(place):
    assert "metadata.mat: no such file or folder" in refused(ingest(place))
    tree = metadata(objects=3, frames=10)
    pressure = np.where(tree["frame"][:, :, None] == 3, np.nan, tree["pressure"])
    assert "pressure of frame 3 of recording " in refused(ingest(place, tree | {"pressure": pressure}))
    assert left(place) == set() and not (place / "recordings.h5").exists()


def test_a_glove_of_another_shape_is_read(place):
    with h5py.File(place / "mug.h5", "w") as file:
        file["pressure"] = np.random.default_rng(0).uniform(0, 1, (20, 5, 7))
        file.attrs.update({"object": "mug", "session": "monday"})
    result = ingest(place, source="mug.h5")
    assert result.returncode == 0 and "20 frames of 5 x 7, 35 sensors, 1 objects" in result.stdout, result.stderr
