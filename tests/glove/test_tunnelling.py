"""Contacts that begin and end within a step: what counts as one, and that the integrator does not step over them."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.glove import integrator
from tactile_viewgcn.glove.contact import Mechanics
from tactile_viewgcn.glove.hand import Hands, stag_hand
from tactile_viewgcn.glove.integrator import Implicit
from tactile_viewgcn.glove.objects import THINGS, Thing
from tactile_viewgcn.glove.passing import LOOK, passed
from tactile_viewgcn.glove.shapes import capsule, sphere
from tests.gloves import LAYER, bed, solids, still

FRAME, RADIUS, MM = 0.1, 0.05, 1e-3  # s, m, m


def over_a_bed(ways):
    """Whether balls on ways (B, 2, 3) through or over a bed of sensors at z = 0 pass it by, and the looks."""
    ways = np.asarray(ways, dtype=float)
    ball = Thing("ball", 1, 1e9, (sphere(RADIUS),))
    hands, rows = Hands([bed(20, 0.04)] * len(ways)), np.arange(len(ways))
    drive = still(ways[:, 0])
    mechanics = Mechanics(hands, solids(*[ball] * len(ways)), np.full(len(ways), 1e9), drive, LAYER, motion=True)
    before, after = (np.concatenate([np.zeros((len(ways), 10)), place], axis=1) for place in ways.swapaxes(0, 1))
    zeros = np.zeros(len(ways))
    return passed(mechanics, rows, zeros, before, zeros + 1, after)


def test_what_goes_deeper_on_its_way_than_at_its_ends_has_passed():
    deep, shallow, side = RADIUS - 10 * MM, RADIUS - 6 * MM, 0.2  # a finger's bone is 8 mm below its skin
    found, looks = over_a_bed([
        [[0, 0, 0.2], [0, 0, -0.2]],  # through the bed
        [[-side, 0, deep], [side, 0, deep]],
        [[-side, 0, shallow], [side, 0, shallow]],
        [[-side, 0, 0.06], [side, 0, 0.06]],  # over it
        [[0, 0, 0.2], [0, 0, deep]],  # into it: the step's end knows
        [[0, 0, deep], [0, 0, 0.2]],  # out of it
        [[0, 0, 0.2], [0, 0, 0.2 - 0.9 * LOOK]],  # nowhere
    ])  # fmt: skip
    assert found.tolist() == [True, True, False, False, False, False, False]
    assert looks == sum(int(np.ceil(way / LOOK)) + 1 for way in (0.4, 0.4, 0.4, 0.4, 0.2 - deep, 0.2 - deep))


def test_an_empty_hand_passes_nothing_and_is_not_looked_at():
    ball = Thing("ball", 1, 1e9, (sphere(RADIUS),))
    drive = still([[0, 0, 0.2]] * 2)
    for things, expected in (((ball, THINGS[0]), [True, False]), ((THINGS[0], THINGS[0]), [False, False])):
        hands = Hands([bed(20, 0.04)] * 2)
        mechanics = Mechanics(hands, solids(*things), np.full(2, 1e9), drive, LAYER, motion=True)
        before, after = np.zeros((2, 2, 13))
        before[:, 12], after[:, 12] = 0.2, -0.2
        found, looks = passed(mechanics, np.arange(2), np.zeros(2), before, np.ones(2), after)
        assert found.tolist() == expected and looks == 26 * sum(expected)


def flown_past():
    """A ball whose prescribed place goes from one side of the fingers to the other in the second frame."""
    drive = still([0.13, -0.12, 0.03], posture=np.full((5, 2), 0.6), knots=4)
    drive.place[0, 2:, 1] = 0.07
    ball = Thing("ball", 1, 2e7, (sphere(0.03),))
    return Mechanics(Hands([stag_hand()]), solids(ball), np.array([2e7]), drive, LAYER, motion=False)


def closed_on_a_rod():
    """Hardly damped fingers, three of which a rod stops on their way."""
    drive = still([0.105, 0, 0.05], posture=np.full((5, 2), 0.1), knots=3)
    drive.posture[0, 2:] = 1.5
    rod = Thing("rod", 1, 2e7, (capsule(0.012, 0.2, turn=(np.pi / 2, 0, 0)),))
    layer = replace(LAYER, joint_damping=1e-4)
    return Mechanics(Hands([stag_hand()]), solids(rod), np.array([2e7]), drive, layer, motion=False)


@pytest.mark.parametrize(("scene", "frames"), [(flown_past, 3), (closed_on_a_rod, 2)])
def test_steps_are_rejected_that_would_pass_a_contact_by(monkeypatch, scene, frames):
    mechanics = scene()
    y = mechanics.start()
    exact = Implicit(mechanics, FRAME, step=FRAME / 128).run(y, frames)[0, 1]
    solver = Implicit(mechanics, FRAME)
    assert np.abs(solver.run(y, frames)[0, 1] - exact).max() < 0.02  # rad
    assert solver.work.rejected > 0
    monkeypatch.setattr(integrator, "passed", lambda mechanics, rows, *way: (np.zeros(len(rows), dtype=bool), 0))
    assert np.abs(Implicit(mechanics, FRAME).run(y, frames)[0, 1] - exact).max() > 0.2
