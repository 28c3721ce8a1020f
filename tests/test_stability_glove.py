"""The stability cases of the virtual glove: right as the project is, WRONG where it is made wrong."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from studies.stability import glove
from studies.stability.case import REFUSED, RIGHT, WRONG, run
from studies.stability.glove_scenes import FRAME, forces, off, plate
from tactile_viewgcn.glove import integrator
from tactile_viewgcn.glove.comparison import explicit_euler
from tactile_viewgcn.glove.contact import Layer
from tactile_viewgcn.glove.integrator import Implicit

CHEAP = {  # and how often they refuse
    glove.stiffness_of_a_plate: 0,
    glove.steps_of_a_whole_frame: 0,
    glove.contact_within_a_step: 0,
    glove.fingers_stopped_by_a_rod: 0,
    glove.wedged_between_two_fingers: 0,
    glove.damping: 2,
    glove.deep_at_first: 1,
    glove.energy_never_grows: 0,
    glove.steps_and_tolerances: 5,
}


def verdicts(*cases):
    return [row["verdict"] for row in run(cases, SimpleNamespace(folder="nowhere"))]


def test_every_case_is_listed_once():
    assert len(set(glove.CASES)) == len(glove.CASES) and set(CHEAP) < set(glove.CASES)
    assert all(case.__doc__ and case.__module__ == glove.__name__ for case in glove.CASES)


@pytest.mark.parametrize("case", CHEAP, ids=lambda case: case.__name__)
def test_cases_are_right_or_refused(case):
    found = verdicts(case)
    assert set(found) <= {RIGHT, REFUSED} and found.count(REFUSED) == CHEAP[case]
    assert found.count(RIGHT) > 0


@settings(max_examples=15, deadline=None)
@given(decades=st.floats(-2, 8))
def test_a_plates_forces_have_their_closed_form_however_stiff_it_is(decades):
    mechanics, y, exact = plate(10**decades, frames=3)
    assert exact.sum(axis=-1).min() > 1  # N
    assert off(forces(mechanics, Implicit(mechanics, FRAME).run(y, 3)), exact) < 0.02


def test_an_explicit_method_is_wrong(monkeypatch):
    def euler(self, y, frames):
        return explicit_euler(self.mechanics, y, frames, self.frame, 8)

    monkeypatch.setattr(Implicit, "run", euler)
    found = verdicts(glove.stiffness_of_a_plate)
    assert found.count(WRONG) >= 1 and found[:2] == [RIGHT, RIGHT]  # the softest ones it can
    for case in (glove.wedged_between_two_fingers, glove.damping, glove.energy_never_grows):
        assert WRONG in verdicts(case)


def test_a_newton_iteration_that_ends_too_early_is_wrong(monkeypatch):
    whole = integrator._Stages.iterate

    def once(self, rows, mechanics, at):
        whole(self, rows, mechanics, at)
        self.best[rows] = self.tried[rows]
        return np.ones(len(rows), dtype=bool), np.ones(len(rows), dtype=bool)

    monkeypatch.setattr(integrator._Stages, "iterate", once)
    for case in (glove.steps_of_a_whole_frame, glove.energy_never_grows):
        assert WRONG in verdicts(case)


def test_stepping_over_a_contact_is_wrong(monkeypatch):
    monkeypatch.setattr(integrator, "passed", lambda mechanics, rows, *way: (np.zeros(len(rows), dtype=bool), 0))
    assert WRONG in verdicts(glove.contact_within_a_step)


def test_a_layer_without_the_objects_stiffness_is_wrong_where_the_plate_does_not_rest_on_it(monkeypatch):
    monkeypatch.setattr(Layer, "series", lambda self, stiffness: np.full(len(stiffness), self.stiffness))
    found = verdicts(glove.stiffness_of_a_plate)
    assert set(found[:5]) == {WRONG} and set(found[-3:]) == {RIGHT}  # there the sensors carry the load, however stiff
