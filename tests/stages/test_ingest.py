"""The stage ingest at its command line: what it reads, records and refuses."""

import json
import shutil

import numpy as np
import yaml

from tactile_viewgcn.files import md5
from tests.glove_data import ROOT
from tests.stag_files import metadata, save_matlab5
from tests.stages.running import copy_pipeline, ingest, left, refused, sh


def test_dvc_hands_on_a_source_whatever_letters_its_path_has(place):
    name = 'it\'s a "b" `c` $HOME & ${seed};#*.mat'
    copy_pipeline(place)
    save_matlab5(place / name, metadata(objects=3, frames=10))
    tree = yaml.safe_load((place / "params.yaml").read_text())
    tree["data"]["source"] = name
    (place / "params.yaml").write_text(yaml.safe_dump(tree))
    (place / ".dvc").mkdir()
    (place / ".dvc" / "config").write_text("[core]\n    no_scm = true\n")
    output = sh("dvc", "repro", "ingest", cwd=place, MLFLOW_TRACKING_URI="disabled", DVC_NO_ANALYTICS="1")
    assert "90 frames of 32 x 32" in output
    locked = yaml.safe_load((place / "dvc.lock").read_text())["stages"]["ingest"]["deps"]
    assert name in {dep["path"] for dep in locked}


def test_dvc_hands_on_the_layout_of_arrays(place):
    copy_pipeline(place)
    (place / "glove" / "mug").mkdir(parents=True)
    np.save(place / "glove" / "mug" / "1.npy", np.arange(24).reshape(4, 6))
    tree = yaml.safe_load((place / "params.yaml").read_text())
    tree["data"] = {"source": "glove", "shape": [2, 3]}
    (place / "params.yaml").write_text(yaml.safe_dump(tree))
    (place / ".dvc").mkdir()
    shutil.copy(ROOT / ".dvc" / "config", place / ".dvc")
    (place / ".dvc" / "config.local").write_text("[core]\n    no_scm = true\n")
    assert "4 frames of 2 x 3" in sh("dvc", "repro", "ingest", cwd=place, MLFLOW_TRACKING_URI="disabled")


def test_a_run_leaves_its_record(place):
    result = ingest(place, metadata(objects=3, frames=10))
    assert result.returncode == 0, result.stderr
    record = json.loads((place / "ingest.json").read_text())
    assert record["stage"] == "ingest" and record["seconds"] > 0 and record["peak_mb"] > 10
    assert record["inputs"] == {"source": {"path": "metadata.mat", "md5": md5(place / "metadata.mat")}}
    assert record["counts"]["frames"] == 90
    assert record["params"]["values"] == {"data.source": "metadata.mat", "data.shape": "auto"}
    assert record["origin"]["python"].startswith("3.") and int(record["origin"]["cores"]) >= 1
    assert "90 frames of 32 x 32, 548 sensors, 3 objects, 9 recordings, 1 session\n" in result.stdout


def test_bad_and_missing_files_are_refused_in_one_line_and_nothing_is_written(place):
    assert "metadata.mat: no such file or folder" in refused(ingest(place))
    tree = metadata(objects=3, frames=10)
    pressure = np.where(tree["frame"][:, :, None] == 3, np.nan, tree["pressure"])
    assert "pressure of frame 3 of recording " in refused(ingest(place, tree | {"pressure": pressure}))
    assert left(place) == set() and not (place / "recordings.h5").exists()
