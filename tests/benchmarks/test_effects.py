"""The cost of effects: the effects that each variant leaves out, and a row counted by hand."""

import numpy as np

from benchmarks.effects.__main__ import rows_of, without_each
from tactile_viewgcn.glove.recipe import EFFECTS, READING, recipe_from_params
from tests.glove_data import recipe


def test_each_variant_lacks_its_effect_the_last_one_all_and_a_row_has_the_median_of_the_rounds_ratios():
    variants = without_each(recipe_from_params(recipe().glove), READING)
    left_out = {name: frozenset(EFFECTS) - variant.effects for name, variant in variants.items()}
    assert left_out == {"nothing": set(), **{name: {name} for name in READING}, "all 7": set(READING)}
    whole, without = rows_of("reading", {"nothing": np.array([1.0, 2, 4]), "noise": np.array([0.5, 1.5, 1])}, 44)
    assert whole == {"part": "reading", "left out": "nothing", "seconds": 2, "against all": 1, "frames a second": 22}
    assert (without["seconds"], without["against all"], without["frames a second"]) == (1, 0.5, 44)
