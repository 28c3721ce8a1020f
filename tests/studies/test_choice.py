"""A study chooses between settings on validation groups."""

import pytest

from studies.choice import choices_of, names_of
from studies.grid import Study
from tests.studies.test_comparison import answers

STUDY = Study(
    name="made",
    question="Which?",
    variants={"vote": {}, "mean": {}, "graph": {}},
    reference=None,
    seeds=[0, 1],
    folds=[0],
    columns=[],
    fixed=["vote"],
    choice={"slow": {}, "fast": {}},
)


def test_the_choice_is_the_lowest_mean_error_over_all_seeds():
    cells = [
        answers("mean, slow", 1, seed=0),
        answers("mean, slow", 5, seed=1),
        answers("mean, fast", 2, seed=0),
        answers("mean, fast", 3, seed=1),
        # the view-graph lacks one training run
        answers("graph, slow", 1, seed=0),
        answers("graph, slow", 1, seed=1),
        answers("graph, fast", 0, seed=0),
    ]
    choices = choices_of(STUDY, cells)
    assert choices["choice"].tolist() == ["slow", "fast"]
    assert choices["error"].tolist() == pytest.approx([30, 25])
    assert names_of(choices) == {"mean": "fast"}


def test_nothing_is_chosen_before_all_have_finished():
    assert names_of(choices_of(STUDY, [answers("mean, slow", 1)])) == {}
    assert names_of(choices_of(STUDY, [])) == {}
