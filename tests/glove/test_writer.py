"""Recordings of the virtual glove: what is in the files, how they are read, and that they are written whole or not."""

import h5py
import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.files import md5
from tactile_viewgcn.glove import simulation, writer
from tactile_viewgcn.glove.hand import stag_hand
from tactile_viewgcn.glove.recipe import EFFECTS, VERSION
from tactile_viewgcn.glove.scene import schedule
from tactile_viewgcn.glove.simulation import Simulation
from tactile_viewgcn.glove.writer import simulate
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.readers.source import TEST, TRAIN
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tests.gloves import LAYER, recipe
from tests.sources import read

HAND = stag_hand()


def ball_inside_the_palm():
    ball = {"name": "ball", "weight": 55, "stiffness": 2e7, "parts": [{"sphere": {"radius": 0.034}}]}
    return ball | {"position": [0.05, 0, -0.03]}  # below the palm, as where it starts, AWAY above


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three objects, two sessions, two grasps in 45 frames, all effects."""
    path = tmp_path_factory.mktemp("glove") / "recordings"
    assert simulate(recipe(frames=45, grasps=2, seed=7), path)["steps"] > 6 * 45
    return path


def test_each_object_of_each_session_is_a_file(folder):
    names = ["000-empty_hand", "001-ball", "002-coin"]
    files = sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file())
    assert files == [f"{session}/{name}.h5" for session in ("000", "001") for name in names]
    _, _, grasp = schedule(45, 2)
    for name, weight in (("000-empty_hand", 0), ("001-ball", 55), ("002-coin", 14)):
        for session, split in (("000", "train"), ("001", "test")):
            with h5py.File(folder / session / f"{name}.h5") as file:
                assert dict(file.attrs) == {
                    "object": name[4:], "session": session, "weight": weight, "split": split,
                    "simulated": f"virtual glove, version {VERSION}, seed 7",
                    "effects": " ".join(sorted(EFFECTS)), "layer": str(LAYER), "tolerance": 0.02,
                }  # fmt: skip
                assert set(file) == {"pressure", "time", "valid", "grasp"}
                assert file["pressure"].shape == (45, 32, 32) and file["pressure"].dtype == np.int16
                np.testing.assert_allclose(file["time"], np.arange(45) / 7.35)
                np.testing.assert_array_equal(file["grasp"], grasp)
                assert file["valid"].dtype == bool and set(file["grasp"][:][file["valid"][:]]) == {0, 1}


def test_the_files_are_a_source_with_the_last_session_on_the_test_side(folder, tmp_path):
    source = open_source(folder)
    assert source.objects == ["empty_hand", "ball", "coin"] and source.sessions == ["000", "001"]
    assert source.shape == (32, 32) and source.dtype == np.int16
    columns = read(source)
    assert columns["pressure"].shape == (6 * 45, 32, 32)
    write_recordings(tmp_path / "table", open_source(folder), "0" * 32)
    table = Recordings(tmp_path / "table")
    np.testing.assert_array_equal(table.frames(np.arange(len(table))), columns["pressure"])
    assert np.count_nonzero(table.live) <= 548
    np.testing.assert_array_equal(columns["split"], np.where(columns["session"] == 1, TEST, TRAIN))


def test_one_seed_gives_the_same_files_and_another_others(tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        simulate(recipe(["ball"], seed=seed, sessions=1), tmp_path / name)
    assert md5(tmp_path / "a") == md5(tmp_path / "b") != md5(tmp_path / "c")
    first, third = (read(open_source(tmp_path / name))["pressure"][:, HAND.row, HAND.column] for name in "ac")
    assert (first != third).mean() > 0.5


def test_recordings_are_the_same_whatever_the_number_of_processes(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "MIN_RECORDINGS_PER_WORKER", 1)
    one, two = (simulate(recipe(["coin"]), tmp_path / str(workers), workers=workers) for workers in (1, 2))
    assert one == two and md5(tmp_path / "1") == md5(tmp_path / "2")


def test_what_a_process_refuses_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(writer, "MIN_RECORDINGS_PER_WORKER", 1)
    with pytest.raises(UserError, match=r"object ball starts .* mm inside the palm; expected it outside"):
        simulate(recipe([ball_inside_the_palm()]), tmp_path / "recordings", workers=2)
    assert list(tmp_path.iterdir()) == []


def test_a_failure_on_the_way_leaves_nothing_and_the_earlier_recordings_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(simulation, "BLOCK", 10)
    sensor_inputs, calls = Simulation.sensor_inputs, []

    def fail_at_second_call(self, mechanics, states):
        calls.append(len(calls))
        if len(calls) == 2:
            raise RuntimeError("power cut")
        return sensor_inputs(self, mechanics, states)

    monkeypatch.setattr(Simulation, "sensor_inputs", fail_at_second_call)
    with pytest.raises(RuntimeError, match="power cut"):
        simulate(recipe(["ball"], sessions=1), tmp_path / "recordings")
    assert list(tmp_path.iterdir()) == []
