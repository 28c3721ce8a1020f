"""Tunnelling: which paths count as tunnelling, and that the integrator rejects such steps."""

import numpy as np

from tactile_viewgcn.glove import integrator
from tactile_viewgcn.glove.integrator import SAMPLE_DISTANCE, ImplicitIntegrator, tunnels
from tactile_viewgcn.glove.shapes import sphere
from tests.glove.scenes import bed, rod, scene

FRAME = 0.1  # s
RADIUS = 0.05  # m
MM = 1e-3  # m
BALL = [sphere(RADIUS)]
NOTHING = []


def over_a_bed(paths, parts=(BALL,)):
    """Return which paths (B, 2, 3) m tunnel through a bed at z = 0.

    Balls, or objects of these parts, move along the paths. Also return the number of evaluations.
    """
    paths = np.asarray(paths, dtype=float)
    count = len(paths)
    mechanics = scene(list(parts), paths[:, 0], hands=bed(20, 0.04, hands=count), stiffness=1e9)
    before, after = np.concatenate([np.zeros((2, count, 10)), paths.swapaxes(0, 1)], axis=2)
    tunnelling, evaluations = tunnels(
        mechanics, np.arange(count), np.zeros(count), before, np.ones(count), after
    )
    return tunnelling.tolist(), evaluations


def test_what_is_deeper_between_its_ends_than_at_them_tunnels():
    # m; a finger's bone is 8 mm below its skin
    deep = RADIUS - 10 * MM
    shallow = RADIUS - 6 * MM
    side = 0.2
    tunnelling, evaluations = over_a_bed([
        [[0, 0, 0.2], [0, 0, -0.2]],  # through the bed
        [[-side, 0, deep], [side, 0, deep]],
        [[-side, 0, shallow], [side, 0, shallow]],
        [[-side, 0, 0.06], [side, 0, 0.06]],  # over it
        [[0, 0, 0.2], [0, 0, deep]],  # into it: the end of the step shows the contact
        [[0, 0, deep], [0, 0, 0.2]],  # out of it
        [[0, 0, 0.2], [0, 0, 0.2 - 0.9 * SAMPLE_DISTANCE]],  # nowhere
    ])  # fmt: skip
    assert tunnelling == [True, True, False, False, False, False, False]
    lengths = np.array([0.4, 0.4, 0.4, 0.4, 0.2 - deep, 0.2 - deep])
    assert evaluations == np.sum(np.ceil(lengths / SAMPLE_DISTANCE) + 1)


def test_an_empty_hand_never_tunnels_and_is_not_evaluated():
    through = [[[0, 0, 0.2], [0, 0, -0.2]]] * 2
    assert over_a_bed(through, [BALL, NOTHING]) == ([True, False], 26)
    assert over_a_bed(through, [NOTHING]) == ([False, False], 0)


def test_steps_that_would_tunnel_are_rejected(monkeypatch):
    """The fingers are hardly damped, and a rod stops three of them on their way."""
    mechanics = rod(1e-4)
    y = mechanics.initial_state()
    exact = ImplicitIntegrator(mechanics, FRAME, step=FRAME / 128).run(y, 2)[0, 1]
    solver = ImplicitIntegrator(mechanics, FRAME)
    assert np.abs(solver.run(y, 2)[0, 1] - exact).max() < 0.02  # rad
    assert solver.statistics["rejected"] > 0

    def never_tunnels(mechanics, rows, *_):
        return np.zeros(len(rows), dtype=bool), 0

    monkeypatch.setattr(integrator, "tunnels", never_tunnels)
    without_search = ImplicitIntegrator(mechanics, FRAME).run(y, 2)[0, 1]
    assert np.abs(without_search - exact).max() > 0.2
