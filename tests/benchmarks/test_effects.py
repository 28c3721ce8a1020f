"""The cost of effects: what each variant leaves out, and its row counted by hand."""

import numpy as np

from benchmarks.effects.__main__ import rows_of, without_each
from tactile_viewgcn.glove.recipe import EFFECTS, READING, recipe_from_params
from tests.glove_data import recipe


def test_each_variant_lacks_its_effect_and_the_last_one_all():
    variants = without_each(recipe_from_params(recipe().glove), READING)
    effects = {name: frozenset(EFFECTS) - variant.effects for name, variant in variants.items()}
    assert effects["nothing"] == frozenset() and effects["all 7"] == frozenset(READING)
    assert all(effects[name] == {name} for name in READING) and len(effects) == 9


def test_a_row_has_the_median_time_and_the_median_of_the_rounds_ratios():
    seconds = {"nothing": np.array([1.0, 2.0, 4.0]), "noise": np.array([0.5, 1.5, 1.0])}
    whole, without = rows_of("reading", seconds, 44)
    assert whole == {
        "part": "reading", "left out": "nothing", "seconds": 2.0, "against all": 1.0, "frames a second": 22.0
    }  # fmt: skip
    assert (without["seconds"], without["against all"], without["frames a second"]) == (1.0, 0.5, 44.0)
