"""Recordings of the virtual glove: what is in the files, what they depend on, and that they are whole or not there."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from tactile_viewgcn.files import md5
from tactile_viewgcn.glove import contact, scene
from tactile_viewgcn.glove import simulation as module
from tactile_viewgcn.glove.contact import Layer
from tactile_viewgcn.glove.hand import Hands, stag_hand
from tactile_viewgcn.glove.integrator import Implicit
from tactile_viewgcn.glove.scene import Habits, schedule
from tactile_viewgcn.glove.simulation import EFFECTS, MECHANICS, READING, VERSION, Simulation, simulate
from tactile_viewgcn.recordings import TEST, TRAIN, Recordings, write_recordings
from tactile_viewgcn.source import open_source
from tactile_viewgcn.stag import read_metadata
from tactile_viewgcn.stag_form import write_metadata
from tests.gloves import LAYER, recipe
from tests.sources import read

HAND = stag_hand()


def counts(given):
    """Counts (B, T, 548) of all recordings, and the simulation."""
    run = Simulation(given)
    return np.concatenate(list(run.blocks()), axis=1)[..., HAND.row, HAND.column], run


def inside_the_palm():
    """A ball that begins where the palm is: it is wanted below it, and starts above where it is wanted."""
    ball = {"name": "ball", "weight": 55, "stiffness": 2e7, "parts": [{"sphere": {"radius": 0.034}}]}
    return ball | {"place": [0.05, 0, -0.1]}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three objects, two sessions, two grasps in 45 frames, all effects."""
    path = tmp_path_factory.mktemp("glove") / "recordings"
    done = simulate(recipe(frames=45, grasps=2, seed=7), path)
    assert (done.recordings, done.frames) == (6, 6 * 45) and done.work.steps > done.frames
    return path


def test_each_object_of_each_session_is_a_file_in_the_projects_own_form(folder):
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


def test_the_files_are_a_source_with_the_last_session_on_the_test_side(folder):
    source = open_source(folder)
    assert source.objects == ["empty_hand", "ball", "coin"] and source.sessions == ["000", "001"]
    assert source.shape == (32, 32) and source.dtype == np.int16
    columns = read(source)
    assert len(columns["pressure"]) == 6 * 45
    np.testing.assert_array_equal(columns["split"], np.where(columns["session"] == 1, TEST, TRAIN))
    np.testing.assert_array_equal(source.weights, [0, 55, 14])


def test_frames_have_ten_bits_and_the_objects_are_felt_while_they_are_held(folder):
    columns = read(open_source(folder))
    pressure = columns["pressure"].astype(int)
    assert pressure.min() >= 0 and pressure.max() <= 1023
    elsewhere = np.ones((32, 32), dtype=bool)
    elsewhere[HAND.row, HAND.column] = False
    assert (pressure[:, elsewhere] == 510).all()
    own = pressure[:, HAND.row, HAND.column]
    for session in (0, 1):
        here = columns["session"] == session
        rest = np.median(own[here & (columns["object"] == 0)], axis=0)
        strongest = np.sort(np.abs(own - rest), axis=1)[:, -5:].mean(axis=1)
        ball = here & (columns["object"] == 1)
        assert np.median(strongest[ball & columns["valid"]]) > 1.5 * np.median(
            strongest[here & (columns["object"] == 0)]
        )


def test_ingest_and_stags_form_keep_every_frame(folder, tmp_path):
    write_metadata(tmp_path / "metadata.mat", open_source(folder))
    first, second = read(open_source(folder)), read(read_metadata(tmp_path / "metadata.mat"))
    assert first.keys() == second.keys() == {
        "pressure", "object", "recording", "session", "frame", "time", "split", "valid", "grasp",
    }  # fmt: skip
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)
    write_recordings(tmp_path / "table", open_source(folder), "0" * 32)
    with Recordings(tmp_path / "table") as table:
        np.testing.assert_array_equal(table.frames(np.arange(len(table))), first["pressure"])
        assert np.count_nonzero(table.live) <= 548
        assert table.recordings == ["000/000-empty_hand", "000/001-ball", "000/002-coin"] + [
            f"001/{name}" for name in ("000-empty_hand", "001-ball", "002-coin")
        ]


def test_one_seed_gives_the_same_files_and_another_others(tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        simulate(recipe(["ball"], seed=seed, sessions=1), tmp_path / name)
    assert md5(tmp_path / "a") == md5(tmp_path / "b") != md5(tmp_path / "c")
    first, third = (read(open_source(tmp_path / name))["pressure"][:, HAND.row, HAND.column] for name in "ac")
    assert (first != third).mean() > 0.5


def test_repeats_are_recordings_of_their_own(tmp_path):
    simulate(recipe(["ball"], repeats=2, sessions=1), tmp_path / "own")
    source = open_source(tmp_path / "own")
    assert source.recordings == ["000/000-empty_hand", "000/001-empty_hand", "000/002-ball", "000/003-ball"]
    pressure = read(source)["pressure"].reshape(4, 18, 32, 32)
    assert len({recording.tobytes() for recording in pressure}) == 4
    once, _ = counts(recipe(["ball"], sessions=1))
    np.testing.assert_array_equal(pressure[[0, 2]][..., HAND.row, HAND.column], once)


def test_a_recording_is_the_same_whatever_other_objects_are_simulated():
    more, _ = counts(recipe(["pen", "coin"]))
    fewer, _ = counts(recipe(["coin"], sessions=1))  # and whatever other sessions
    np.testing.assert_array_equal(more[[0, 2]], fewer)


@pytest.mark.parametrize(
    "without", [(), ("motion", "weight"), ("bending",), EFFECTS], ids=lambda names: "-".join(names)
)
def test_empty_hands_alone_read_what_they_do_among_others_and_look_for_no_contacts(monkeypatch, without):
    given = recipe(["ball"], without=without, seed=3)
    among, _ = counts(given)

    def looked_for(*args, **kwargs):
        raise AssertionError("looked for contacts where no object is")

    for place in (contact, scene):
        monkeypatch.setattr(place, "touching", looked_for)
    monkeypatch.setattr(Hands, "pose", looked_for)
    run = Simulation(given, [cell for cell in given.cells if cell[1] == 0])
    alone = np.concatenate(list(run.blocks()), axis=1)[..., HAND.row, HAND.column]
    np.testing.assert_array_equal(alone, among[[0, 2]])
    assert (run.work.evaluations > 0) == ("bending" not in without)
    if "noise" not in without:
        assert len(np.unique(alone)) > 5  # not a constant


def test_a_hand_without_an_object_moves_the_same_whether_contacts_are_looked_for_or_not():
    given = recipe(["ball"], sessions=1)
    states = []
    for looks in (False, True):
        run = Simulation(given, [(0, 0, 0)])
        run.solids.some |= looks
        mechanics = run.mechanics(0, 18)
        states.append(Implicit(mechanics, 1 / given.rate).run(mechanics.start(), 18))
    assert np.ptp(states[0][..., :10], axis=1).max() > 0.1  # rad: the fingers close
    np.testing.assert_array_equal(*states)


def test_recordings_are_the_same_whatever_the_number_of_processes(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FEWEST", 1)
    one, three = (simulate(recipe(["coin"]), tmp_path / str(workers), workers=workers) for workers in (1, 3))
    assert one == three and one.recordings == 4 and md5(tmp_path / "1") == md5(tmp_path / "3")


def test_what_a_process_refuses_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FEWEST", 1)
    with pytest.raises(ValueError, match=r"object ball starts .* mm inside the palm; expected it outside"):
        simulate(recipe([inside_the_palm()]), tmp_path / "own", workers=2)
    assert list(tmp_path.iterdir()) == []


def test_in_shorter_blocks_the_steps_differ_and_the_counts_hardly(monkeypatch):
    given = recipe(sessions=1)
    whole, _ = counts(given)
    monkeypatch.setattr(module, "BLOCK", 7)
    run = Simulation(given)
    blocks = list(run.blocks())
    assert [block.shape[:2] for block in blocks] == [(3, 7), (3, 7), (3, 4)]
    parts = np.concatenate(blocks, axis=1)[..., HAND.row, HAND.column]
    assert np.abs(parts - whole).max() <= 2 and (parts != whole).mean() < 0.01


def test_the_frames_are_those_of_the_mechanics_solved_in_one_piece():
    given = recipe(["ball"], sessions=1, without=READING)
    found, run = counts(given)
    again = Simulation(given)
    mechanics = module.Mechanics(
        again.hands, again.solids, again.stiffness, again.plan.drive, LAYER, motion=True
    )  # fmt: skip
    states = Implicit(mechanics, 1 / given.rate, given.tolerance).run(mechanics.start(), 18)
    pressure, flexion = again.felt(mechanics, states)
    assert pressure.shape == (2, 18, 548) and not flexion.any() and pressure[1].max() > 1e3
    assert not pressure[0].any()  # the empty hand
    np.testing.assert_array_equal(found, again.sensors.read(pressure, flexion)[..., HAND.row, HAND.column])
    assert run.work.steps - run.work.rejected >= 2 * 18  # at least one for each frame


def test_felt_is_each_sensors_force_per_area_where_the_skin_faces_it():
    run = Simulation(recipe(["ball"], sessions=1))
    mechanics = module.Mechanics(run.hands, run.solids, run.stiffness, run.plan.drive, LAYER, motion=True)
    states = Implicit(mechanics, 1 / 7.35, 0.05).run(mechanics.start(), 18)
    pressure, flexion = run.felt(mechanics, states)
    frame = 1 + int(np.flatnonzero(run.plan.held)[0])
    at = mechanics.balance(np.arange(2), np.full(2, frame + 1.0), states[:, frame], palm=True)
    naive = np.zeros((2, 548))
    for entry in range(len(at.force)):
        row, sensor = at.contacts.row[entry], at.contacts.sensor[entry]
        naive[row, sensor] += at.force[entry] * at.facing[entry] / run.hands.area[row, sensor]
    np.testing.assert_allclose(pressure[:, frame], naive)
    assert naive[1].max() > 0
    q = states[1, frame, :10].reshape(5, 2) - module.OPEN
    for sensor, patch in enumerate(HAND.patch):
        bend = np.maximum(q, 0)
        joints = np.array([bend[:, 0], bend[:, 1], 2 / 3 * bend[:, 1]])  # the last one is coupled to the middle one
        expected = bend[:, 0].mean() if patch >= 15 else joints[patch % 3, patch // 3]
        assert flexion[1, frame, sensor] == pytest.approx(expected)


@pytest.fixture(scope="module")
def all_effects():
    return counts(recipe(["ball"], sessions=1))[0]


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_can_be_left_out_and_is_then_missed(all_effects, effect):
    found, _ = counts(recipe(["ball"], sessions=1, without=[effect]))
    assert found.shape == all_effects.shape == (2, 18, 548)
    changed = found != all_effects
    assert np.count_nonzero(changed) >= 5
    if effect in ("weight", "shift"):  # of the object: an empty hand does not miss them
        assert not changed[0].any()


def test_without_any_effect_a_sensor_reads_its_rest_or_what_presses_it():
    found, run = counts(recipe(["ball"], without=EFFECTS))
    rest = np.rint(run.sensors.rest)[:, None]
    np.testing.assert_array_equal(found[[0, 2]], np.broadcast_to(rest[[0, 2]], (2, 18, 548)))
    assert (found >= rest).all() and (found[[1, 3]] > rest[[1, 3]]).any()
    held = np.flatnonzero(run.plan.held)
    assert np.ptp(found[:, held[2:]], axis=1).max() <= 1  # nothing wanders while the object is held


def test_a_glove_sits_differently_in_each_session_where_its_fit_varies():
    fits = Simulation(recipe(["ball"])).hands.local
    np.testing.assert_array_equal(fits[0], fits[1])  # the same session
    assert np.abs(fits[0] - fits[2]).max() > 1e-5
    same = Simulation(recipe(["ball"], without=["fit"])).hands.local
    np.testing.assert_array_equal(same, np.broadcast_to(HAND.local, same.shape))


@pytest.mark.parametrize("stiffness", [1e3, 1e5])
def test_readings_beyond_a_soft_layers_thickness_are_counted_and_finite(stiffness):
    found, run = counts(recipe(["ball"], sessions=1, layer=replace(LAYER, stiffness=stiffness)))
    assert run.deep > 25 and found.min() >= 0 and found.max() <= 1023
    _, firm = counts(recipe(["ball"], sessions=1, layer=replace(LAYER, stiffness=1e9)))
    assert firm.deep == 0


def test_a_failure_on_the_way_leaves_nothing_and_the_earlier_recordings_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "BLOCK", 10)
    whole, calls = Simulation.felt, []

    def felt(self, mechanics, states):
        calls.append(len(calls))
        if len(calls) == 2:
            raise RuntimeError("power cut")
        return whole(self, mechanics, states)

    monkeypatch.setattr(Simulation, "felt", felt)
    with pytest.raises(RuntimeError, match="power cut"):
        simulate(recipe(["ball"], sessions=1), tmp_path / "own")
    assert list(tmp_path.iterdir()) == []
    simulate(recipe(["ball"], sessions=1), tmp_path / "own")
    before = md5(tmp_path / "own")
    calls.clear()
    with pytest.raises(RuntimeError, match="power cut"):
        simulate(recipe(["ball"], seed=1, sessions=1), tmp_path / "own")
    assert md5(tmp_path / "own") == before and [path.name for path in tmp_path.iterdir()] == ["own"]


def test_recordings_take_the_place_of_those_of_another_recipe(tmp_path):
    simulate(recipe(["coin", "ball"], frames=17, sessions=1), tmp_path / "own")
    simulate(recipe(["ball"], frames=17, sessions=1), tmp_path / "own")
    assert open_source(tmp_path / "own").objects == ["empty_hand", "ball"]


BAD = {
    "another effect": ({"effects": frozenset(["frcition"])}, "unknown effect frcition; known: motion, weight, shift"),
    "no sessions": ({"sessions": 0}, "sessions is 0; expected at least 1"),
    "no grasps": ({"grasps": 0}, "grasps is 0; expected at least 1"),
    "no repeats": ({"repeats": -1}, "repeats is -1; expected at least 1"),
    "no rate": ({"rate": 0}, "rate is 0 frames a second; expected more than 0, and finite"),
    "endless rate": ({"rate": np.inf}, "rate is inf frames a second; expected more than 0, and finite"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_recipe_that_cannot_be_is_refused(case):
    change, sentence = BAD[case]
    with pytest.raises(ValueError, match=sentence):
        replace(recipe(["ball"]), **change)


def test_grasps_too_short_and_objects_in_the_palm_leave_nothing(tmp_path):
    with pytest.raises(ValueError, match="18 frames for 2 grasps leave 9 each"):
        simulate(recipe(["ball"], grasps=2), tmp_path / "own")
    with pytest.raises(ValueError, match=r"object ball starts .* mm inside the palm; expected it outside"):
        simulate(recipe([inside_the_palm()]), tmp_path / "own")
    assert list(tmp_path.iterdir()) == []


def test_the_effects_are_those_of_mechanics_and_reading_and_habits_are_the_recipes():
    assert EFFECTS == MECHANICS + READING and len(set(EFFECTS)) == len(EFFECTS) == 12
    still_ = Habits(place_recording=0, place_grasp=0, turn_recording=0, turn_grasp=0, roll=0, finger=0)
    run = Simulation(recipe(["ball"], without=["shift"], habits=still_, frames=45, grasps=2))
    held = 1 + np.flatnonzero(run.plan.held)
    assert np.ptp(run.plan.drive.place[:, held], axis=1).max() < 1e-12
    assert isinstance(run.recipe.layer, Layer)
