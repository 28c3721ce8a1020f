"""Simulation: invariances of the counts, the effect of each effect, and the files."""

from itertools import chain
from pathlib import Path

import h5py
import numpy as np
import pytest

from tactile_viewgcn.files import md5
from tactile_viewgcn.glove import simulation
from tactile_viewgcn.glove.hand import LINK_PATCHES, stag_hands
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

HAND = stag_hands()
PARAMS = Path(__file__).parents[2] / "params.yaml"
SETS = {"R": "train", "E": "test"}


@pytest.mark.parametrize(("sessions", "letters"), [(2, "RE"), (3, "RRE"), (4, "RREE")])
def test_two_sessions_at_most_are_the_training_set_and_never_all(sessions, letters):
    glove = load(PARAMS, (f"glove.sessions={sessions}",)).glove
    of_sessions = recipe_from_params(glove)
    sets = [of_sessions.published_set(session) for session in range(sessions)]
    assert sets == [SETS[letter] for letter in letters]


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
    contacts = balance.contacts
    for contact, force in enumerate(balance.force):
        row = contacts.row[contact]
        sensor = contacts.sensor[contact]
        naive[row, sensor] += force * contacts.facing[contact] / run.hands.area[row, sensor]
    np.testing.assert_allclose(pressure[:, frame], naive)
    assert naive[1].max() > 0
    bend = np.maximum(states[1, frame, :10].reshape(5, 2) - OPEN, 0)
    # the last joint is coupled to the middle one
    joints = np.array([bend[:, 0], bend[:, 1], 2 / 3 * bend[:, 1]])
    for sensor, patch in enumerate(HAND.patch):
        if patch >= LINK_PATCHES:
            expected = bend[:, 0].mean()
        else:
            expected = joints[patch % 3, patch // 3]
        assert flexion[1, frame, sensor] == pytest.approx(expected)


@pytest.fixture(scope="module")
def all_effects():
    """Return the counts (2, 22, S) of an empty hand and a ball, with all effects."""
    return simulated_counts(recipe(["ball"], sessions=1))[0]


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_changes_the_counts(all_effects, effect):
    without, _ = simulated_counts(recipe(["ball"], sessions=1, without=[effect]))
    assert without.shape == all_effects.shape == (2, 22, 548)
    changed = without != all_effects
    assert np.count_nonzero(changed) >= 5
    # effects on an object: for an empty hand only the solver's steps differ, by rounding errors
    if effect in ("weight", "shift"):
        assert np.abs(without[0] - all_effects[0]).max() <= 1
        assert changed[0].mean() < 1e-3


def test_the_files_hold_each_object_of_each_session_with_the_last_session_in_the_test_set(tmp_path):
    folder = tmp_path / "recordings"
    assert simulate(recipe(frames=45, grasps=2, seed=7), folder)["steps"] > 6 * 45
    expected = [
        ("000/000-empty_hand.h5", "000", "empty_hand", 0, "train"),
        ("000/001-ball.h5", "000", "ball", 55, "train"),
        ("000/002-coin.h5", "000", "coin", 14, "train"),
        ("001/000-empty_hand.h5", "001", "empty_hand", 0, "test"),
        ("001/001-ball.h5", "001", "ball", 55, "test"),
        ("001/002-coin.h5", "001", "coin", 14, "test"),
    ]
    files = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
    assert sorted(files) == [path for path, *_ in expected]
    phase, _, grasp = schedule(45, 2)
    for path, session, name, weight, published_set in expected:
        with h5py.File(folder / path) as file:
            assert dict(file.attrs) == {
                "object": name,
                "session": session,
                "weight": weight,
                "split": published_set,
                "simulated": f"virtual glove, version {VERSION}, seed 7",
                "effects": " ".join(sorted(EFFECTS)),
                "layer": str(LAYER),
                "tolerance": 0.02,
            }
            assert file["pressure"].shape == (45, 32, 32)
            assert file["pressure"].dtype == np.int16
            np.testing.assert_allclose(file["time"], np.arange(45) / 7.35)
            np.testing.assert_array_equal(file["grasp"], grasp)
            np.testing.assert_array_equal(file["valid"], phase == HOLD)
    with recordings_of(folder) as table:
        assert table.objects == ["empty_hand", "ball", "coin"]
        assert table.sessions == ["000", "001"]


def test_one_seed_gives_the_same_files_whatever_the_number_of_processes_and_another_others(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(simulation, "MIN_RECORDINGS_PER_WORKER", 1)
    for name, seed, workers in (("one", 0, 1), ("two", 0, 2), ("other_seed", 1, 1)):
        simulate(recipe(["coin"], seed=seed), tmp_path / name, workers=workers)
    assert md5(tmp_path / "one") == md5(tmp_path / "two")
    assert md5(tmp_path / "two") != md5(tmp_path / "other_seed")


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
    assert {whole.objects[index].name for _, index in parts[0][:5]} == {"coin"}
    _, index_of_last = parts[-1][-1]
    assert whole.objects[index_of_last].name == "empty_hand"
