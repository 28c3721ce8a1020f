"""Recipes: which recordings they ask for, what they take from params.yaml, and what they refuse."""

from pathlib import Path

import pytest

from tactile_viewgcn.glove.recipe import recipe_from_params
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load

PARAMS = Path(__file__).parents[2] / "params.yaml"


@pytest.mark.parametrize(("sessions", "sides"), [(2, "RE"), (3, "RRE"), (4, "RREE")])
def test_two_sessions_at_most_are_the_training_side_and_never_all(sessions, sides):
    one = recipe_from_params(load(PARAMS, (f"glove.sessions={sessions}",)).glove)
    assert [one.side(session) for session in range(sessions)] == [{"R": "train", "E": "test"}[side] for side in sides]


@pytest.mark.parametrize(
    ("changes", "size"),
    [
        (("sessions=1214",), "32,778 recordings of 108 frames"),
        (("grasps=1000", "grasp_frames=124"), "81 recordings of 124,008 frames"),
    ],
)
def test_more_recordings_or_frames_than_a_table_holds_are_refused(changes, size):
    with pytest.raises(UserError, match=size):
        recipe_from_params(load(PARAMS, tuple(f"glove.{change}" for change in changes)).glove)
    assert recipe_from_params(load(PARAMS, ("glove.sessions=1213",)).glove).sessions == 1213
