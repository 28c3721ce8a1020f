"""Simulation: invariances of the counts, the effect of each effect, and the files."""

from itertools import chain
from pathlib import Path

import h5py
import numpy as np
import pytest

from tactile_viewgcn.files import md5
from tactile_viewgcn.glove import simulation
from tactile_viewgcn.glove.hand import stag_hands
from tactile_viewgcn.glove.integrator import ImplicitIntegrator
from tactile_viewgcn.glove.mechanics import Mechanics
from tactile_viewgcn.glove.scene import HOLD, OPEN, OPENING, schedule
from tactile_viewgcn.glove.simulation import (
    EFFECTS,
    VERSION,
    Simulation,
    recipe_from_params,
    simulate,
)
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load
from tactile_viewgcn.tables.recordings import recordings_of
from tests.glove.scenes import LAYER, recipe, simulated_counts

HAND, PARAMS = stag_hands(), Path(__file__).parents[2] / "params.yaml"


@pytest.mark.parametrize(("sessions", "sides"), [(2, "RE"), (3, "RRE"), (4, "RREE")])
def test_two_sessions_at_most_are_the_training_side_and_never_all(sessions, sides):
    one = recipe_from_params(load(PARAMS, (f"glove.sessions={sessions}",)).glove)
    assert [one.published_set(session) for session in range(sessions)] == [
        {"R": "train", "E": "test"}[side] for side in sides
    ]


def test_a_recording_is_the_same_whatever_other_objects_and_sessions_are_simulated():
    more, _ = simulated_counts(recipe(["pen", "coin"]))
    fewer, _ = simulated_counts(recipe(["coin"], sessions=1))
    np.testing.assert_array_equal(more[[0, 2]], fewer)


def test_sensor_inputs_are_force_per_area_where_the_skin_faces_it_and_the_joints_flexion():
    run = Simulation(recipe(["ball"], sessions=1))
    mechanics = Mechanics(run.hands, run.solids, run.stiffness, run.drive, LAYER, motion=True)
    states = ImplicitIntegrator(mechanics, 1 / 7.35, 0.05).run(mechanics.initial_state(), 22)
    pressure, flexion = run.sensor_inputs(mechanics, states)
    frame = 1 + int(np.flatnonzero(schedule(22, 1)[0] == HOLD)[0])
    balance = mechanics.evaluate(np.arange(2), np.full(2, frame + 1.0), states[:, frame], palm=True)
    naive = np.zeros((2, 548))
    for entry in range(len(balance.force)):
        row, sensor = balance.contacts.row[entry], balance.contacts.sensor[entry]
        naive[row, sensor] += (
            balance.force[entry] * balance.contacts.facing[entry] / run.hands.area[row, sensor]
        )
    np.testing.assert_allclose(pressure[:, frame], naive)
    assert naive[1].max() > 0
    bend = np.maximum(states[1, frame, :10].reshape(5, 2) - OPEN, 0)
    # the last joint is coupled to the middle one
    joints = np.array([bend[:, 0], bend[:, 1], 2 / 3 * bend[:, 1]])
    for sensor, patch in enumerate(HAND.patch):
        expected = bend[:, 0].mean() if patch >= 15 else joints[patch % 3, patch // 3]
        assert flexion[1, frame, sensor] == pytest.approx(expected)


@pytest.fixture(scope="module")
def all_effects():
    return simulated_counts(recipe(["ball"], sessions=1))[0]


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_changes_the_counts(all_effects, effect):
    without, _ = simulated_counts(recipe(["ball"], sessions=1, without=[effect]))
    assert without.shape == all_effects.shape == (2, 22, 548)
    changed = without != all_effects
    assert np.count_nonzero(changed) >= 5
    # effects on an object: for an empty hand only the solver's steps differ, by rounding errors
    if effect in ("weight", "shift"):
        assert np.abs(without[0] - all_effects[0]).max() <= 1 and changed[0].mean() < 1e-3


def test_the_files_hold_each_object_of_each_session_with_the_last_session_on_the_test_side(
    tmp_path,
):
    folder, names = tmp_path / "recordings", ["000-empty_hand", "001-ball", "002-coin"]
    assert simulate(recipe(frames=45, grasps=2, seed=7), folder)["steps"] > 6 * 45
    files = sorted(
        file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()
    )
    assert files == [f"{session}/{name}.h5" for session in ("000", "001") for name in names]
    phase, _, grasp = schedule(45, 2)
    for path, split, weight in zip(
        files, ["train"] * 3 + ["test"] * 3, [0, 55, 14] * 2, strict=True
    ):
        with h5py.File(folder / path) as file:
            assert dict(file.attrs) == {
                "object": path[8:-3], "session": path[:3], "weight": weight, "split": split,
                "simulated": f"virtual glove, version {VERSION}, seed 7",
                "effects": " ".join(sorted(EFFECTS)), "layer": str(LAYER), "tolerance": 0.02,
            }  # fmt: skip
            assert file["pressure"].shape == (45, 32, 32) and file["pressure"].dtype == np.int16
            np.testing.assert_allclose(file["time"], np.arange(45) / 7.35)
            np.testing.assert_array_equal(file["grasp"], grasp)
            np.testing.assert_array_equal(file["valid"], phase == HOLD)
    with recordings_of(folder) as table:
        assert table.objects == ["empty_hand", "ball", "coin"] and table.sessions == ["000", "001"]


def test_one_seed_gives_the_same_files_whatever_the_number_of_processes_and_another_others(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(simulation, "MIN_RECORDINGS_PER_WORKER", 1)
    for name, seed, workers in (("a", 0, 1), ("b", 0, 2), ("c", 1, 1)):
        simulate(recipe(["coin"], seed=seed), tmp_path / name, workers=workers)
    assert md5(tmp_path / "a") == md5(tmp_path / "b") != md5(tmp_path / "c")


def test_a_grasp_has_a_steady_frame_at_least():
    assert (schedule(OPENING + 10, 1)[0] == HOLD).sum() == 1
    with pytest.raises(UserError, match=r"glove\.grasp_frames: .*10 \(got 9\)"):
        load(PARAMS, ("glove.grasp_frames=9",))


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_each_recording_goes_to_one_process_and_the_thinnest_objects_to_the_first(workers):
    whole = recipe(["ball", "coin", "mug", "tea_box"], sessions=5)
    parts = simulation.deal(whole, workers)
    assert [len(part) for part in parts] == {1: [25], 2: [8, 17], 3: [5, 10, 10]}[workers]
    assert sorted(chain.from_iterable(parts)) == whole.recordings
    # coins are 5 mm thick, the walls of mugs 7 mm
    assert {whole.objects[number].name for _, number in parts[0][:5]} == {"coin"}
    assert whole.objects[parts[-1][-1][1]].name == "empty_hand"
