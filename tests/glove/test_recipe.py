"""Recipes: which recordings they ask for, what they take from params.yaml, and what they refuse."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.glove.recipe import EFFECTS, STAG_SIZE, recipe_from_params
from tactile_viewgcn.params import load
from tests.gloves import recipe

PARAMS = Path(__file__).parents[2] / "params.yaml"


def test_every_object_of_every_session_is_recorded():
    assert recipe(["ball", "pen"], sessions=2).cells == [(0, 0), (0, 1), (0, 2), (1, 0), (1, 1), (1, 2)]


def test_parameters_become_a_recipe():
    changes = ("glove.objects=[mug]", "glove.grasps=2", "glove.grasp_frames=20", "glove.skin_stiffness=3e7")
    one = recipe_from_params(load(PARAMS, (*changes, "glove.leave_out=[noise]", "glove.seed=5")).glove)
    assert [grasp_object.name for grasp_object in one.objects] == ["empty_hand", "mug"]
    assert (one.sessions, one.grasps, one.frames, one.seed, one.rate) == (3, 2, 40, 5, 7.35)
    assert one.layer.stiffness == 3e7 and one.layer.thickness == 4e-3
    assert one.effects == set(EFFECTS) - {"noise"}
    large = recipe_from_params(load(PARAMS, ("glove.scale=stag",)).glove)
    assert {name: getattr(large, name) for name in STAG_SIZE} == {"sessions": 3, "frames": 1667, "grasps": 49}
    assert len(large.cells) * large.frames == 135_027  # as many frames as STAG


BAD = {
    "another effect": ({"effects": frozenset(["frcition"])}, "unknown effect frcition; known: motion, weight, shift"),
    "no objects": ({"objects": ()}, "no objects; expected the empty hand"),
    "no sessions": ({"sessions": 0}, "sessions is 0; expected at least 1"),
    "no grasps": ({"grasps": 0}, "grasps is 0; expected at least 1"),
    "no rate": ({"rate": 0}, "rate is 0 frames a second; expected more than 0"),
    "endless rate": ({"rate": np.inf}, "rate is inf frames a second; expected more than 0"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_recipe_that_cannot_be_is_refused(case):
    change, sentence = BAD[case]
    with pytest.raises(UserError, match=sentence):
        replace(recipe(["ball"]), **change)
