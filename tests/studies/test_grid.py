"""A study's file has cells, and each cell has a key."""

from collections import Counter
from dataclasses import replace
from itertools import product

import pytest
import yaml
from click.testing import CliRunner

from studies import grid
from studies.__main__ import main
from studies.cells import key_of
from studies.grid import Cell, names, read_study
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import default_params


def cell_of(*changes, variant="a"):
    return Cell(variant=variant, seed=0, deal=0, fold=0, changes=changes)


LEAST = {
    "question": "Which?",
    "variants": {"a": {}},
    "reference": None,
    "seeds": [0],
    "folds": [0],
    "columns": [],
}


@pytest.fixture
def study(tmp_path, monkeypatch):
    """Return a function that makes a study with some keys, and with the fewest other keys."""
    monkeypatch.setattr(grid, "FOLDER", tmp_path)

    def make(**keys):
        (tmp_path / "made.yaml").write_text(yaml.safe_dump(LEAST | keys, sort_keys=False))
        return read_study("made")

    return make


def test_cells_are_every_variant_from_every_seed_on_every_fold(study):
    example = study(
        set={"split.by": "recording"},
        variants={"a": {"views": 4}, "b": {"views": 2}},
        cross=[{"x": {"cluster.restarts": 1}, "y": {}}],
        seeds=[3, 5],
        folds=[0, 1],
        one_seed=["b / x"],
    )
    counts = Counter((cell.variant, cell.seed) for cell in example.cells())
    runs = set(product(("a / x", "a / y", "b / x", "b / y"), (3, 5))) - {("b / x", 5)}
    assert counts == dict.fromkeys(runs, 2)
    changes = (
        "split.by=recording",
        "glove.seed=3",
        "views=4",
        "cluster.restarts=1",
        "seed=3",
        "split.deal=0",
        "split.fold=0",
    )
    first = example.cells()[0]
    expected = Cell(variant="a / x", seed=3, deal=0, fold=0, changes=changes, world="3")
    assert replace(first, changes=first.changes[-7:]) == expected


def test_every_variant_is_trained_on_each_fold_of_each_deal_deal_by_deal(study):
    variants = {"a": {}, "b": {"preset": "network", "pretrain.epochs": 2}}
    example = study(variants=variants, folds="all", deals=[0, 3], set={"split.folds": 2})
    order = [(cell.deal, cell.variant, cell.fold) for cell in example.cells()]
    assert order == list(product([0, 3], "ab", [0, 1]))
    changes = example.cells()[-1].changes  # the changes of the preset, then the later ones
    assert "split.deal=3" in changes and "model.system=vote" in changes
    assert changes.index("pretrain.epochs=8") < changes.index("pretrain.epochs=2")
    grasps = example.cells(("split.folds=6", "split.by=grasp"))
    assert len(grasps) == 2 * 2 * 6
    assert grasps[-1].changes[-5:] == (
        "split.folds=6",
        "split.by=grasp",
        "seed=0",
        "split.deal=3",
        "split.fold=5",
    )
    once = study(variants=variants, deals=[3, 0], one_deal=["a"])
    assert [(cell.deal, cell.variant) for cell in once.cells()] == [(3, "a"), (3, "b"), (0, "b")]


@pytest.mark.parametrize(
    ("tree", "word"),
    [
        ({"refrence": "a"}, "unknown key refrence; did you mean reference"),
        ({"reference": "b"}, "reference is 'b'; expected one of a"),
        ({"one_seed": ["c"]}, "one_seed is 'c'"),
        ({"variants": {"a": {"preset": "worst"}}}, "preset is 'worst'"),
        ({"cross": [{"x": None}]}, "cross: "),
        ({"seeds": [True]}, r"seeds: .*got True"),
        ({"fixed": ["c"]}, "fixed is 'c'"),
        ({"choice": {"x": {}}, "cross": [{"y": {}}]}, "choice and cross"),
    ],
)
def test_a_mistake_in_the_file_is_named(study, tree, word):
    with pytest.raises(UserError, match=word) as error:
        study(**tree).cells()
    assert "\n" not in str(error.value)


def test_a_seed_is_a_world_too_unless_the_study_names_one(study, tmp_path):
    def worlds(example, on_top=()):
        cells = example.cells(on_top)
        values = [default_params(cell.changes).glove.seed for cell in cells]
        seeds = [default_params(cell.changes).seed for cell in cells]
        return seeds, values, [cell.world for cell in cells]

    five = [101, 102, 103, 104, 105]
    least = {key: value for key, value in LEAST.items() if key != "seeds"}
    (tmp_path / "worlds.yaml").write_text(yaml.safe_dump(least, sort_keys=False))
    assert worlds(read_study("worlds")) == (five, five, [str(seed) for seed in five])
    assert worlds(study(seeds=[3, 5])) == ([3, 5], [3, 5], ["3", "5"])
    assert worlds(study(seeds=[3, 5], set={"glove.seed": 16})) == ([3, 5], [16, 16], ["16", "16"])
    assert worlds(study(seeds=[3, 5]), ("glove.seed=7",)) == ([3, 5], [7, 7], ["7", "7"])
    seeds, _, of_files = worlds(study(seeds=[3, 5]), ("data.source=files",))
    assert (seeds, of_files) == ([3, 5], ["", ""])


def test_cells_that_begin_together_are_of_different_worlds(study):
    cells = study(variants={"a": {}, "b": {"views": 4}}, seeds=[3, 5]).cells()
    assert [(cell.variant, cell.seed) for cell in cells] == list(product("ab", [3, 5]))


CHOICE = {
    "variants": {"vote": {}, "mean": {"views": 4}},
    "set": {"split.validation": 0.5},
    "fixed": ["vote"],
    "choice": {"slow": {"finetune.lr": 0.1}, "fast": {"finetune.lr": 0.2}},
}


def test_choices_are_made_on_validation_groups_and_what_is_chosen_is_tested(study):
    example = study(**CHOICE)

    def settings_of(cells):
        settings = {}
        for cell in cells:
            params = default_params(cell.changes)
            settings[cell.variant] = (params.evaluate.side, params.finetune.lr, params.views)
        return settings

    assert settings_of(example.candidates().cells()) == {
        "mean, slow": ("validation", 0.1, 4),
        "mean, fast": ("validation", 0.2, 4),
    }
    unchanged = default_params().finetune.lr
    assert settings_of(example.chosen({"mean": "fast"}).cells()) == {
        "vote": ("test", unchanged, 8),
        "mean": ("test", 0.2, 4),
    }
    assert list(settings_of(example.chosen({}).cells())) == ["vote"]


@pytest.mark.parametrize("name", names())
def test_every_study_has_parameters_that_pass_all_checks_and_no_training_twice(name):
    cells = read_study(name).cells()
    assert len(cells) >= 2
    assert len({key_of(cell, "code") for cell in cells}) == len(cells)


def test_a_cell_is_known_by_its_parameters_and_code():
    default = cell_of("views=8")
    same = cell_of(variant="b")
    assert key_of(default, "code") == key_of(same, "code")  # params.yaml says 8
    assert key_of(default, "code") != key_of(default, "other code")
    assert key_of(default, "code") != key_of(cell_of("views=4"), "code")
    with pytest.raises(UserError, match=r"variant b: .*model\.sytem"):
        key_of(cell_of("model.sytem=vote", variant="b"), "code")


def test_a_cell_is_known_by_what_its_source_holds_wherever_it_lies(tmp_path):
    keys = []
    for folder in (tmp_path / "here", tmp_path / "there"):
        (folder / "mug").mkdir(parents=True)
        (folder / "mug/1.h5").write_bytes(b"1")
        keys.append(key_of(cell_of(f"data.source={folder}"), "code"))
    assert keys[0] == keys[1]
    with pytest.raises(UserError, match=r"data\.source is no_such_place"):
        key_of(cell_of("data.source=no_such_place"), "code")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["nosuch"], "expected one of claims, claims_48"),
        (["compare", "--set", "views=4"], "--set without --out"),
        (["compare", "--set", "vews=4", "--out", "elsewhere"], "did you mean views?"),
        (
            ["compare", "--set", "seed=4", "--out", "elsewhere"],
            "--set seed: every cell has its own",
        ),
        (["error_time", "--set", "views=8", "--out", "elsewhere"], "the same training run twice"),
        (
            ["compare", "--out", "pyproject.toml/results"],
            "Not a directory; with --out name a folder",
        ),
        (["compare", "--out", "/proc"], "with --out name a folder that you can write into"),
    ],
)
def test_a_mistake_on_the_command_line_ends_in_one_line_before_any_cell(
    monkeypatch, words, expected
):
    monkeypatch.setattr("studies.__main__.run_cells", None)
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 1
    assert expected in result.output
    assert result.output.count("\n") == 1


def test_the_list_has_each_question_once_in_80_columns_and_what_to_type_next():
    result = CliRunner().invoke(main, [])
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert max(map(len, lines)) <= 80
    assert [line.split()[0] for line in lines] == ["study", *names(), "next:"]
    questions = [read_study(name).question for name in names()]
    assert len(set(questions)) == len(questions)
    for line, question in zip(lines[1:], questions, strict=False):
        assert line.endswith(f"  {question}")
    assert "python -m studies NAME" in lines[-1]


@pytest.mark.parametrize("folds", ["all", [0]])
@pytest.mark.parametrize(
    ("committed", "word"), [({}, "^no params"), ({"views": 0}, "params.yaml in git's HEAD: v")]
)
def test_no_cell_without_committed_parameters_or_with_wrong_ones(
    study, monkeypatch, committed, word, folds
):
    monkeypatch.setattr(grid, "committed_params", lambda path: committed)
    with pytest.raises(UserError, match=word):
        study(folds=folds).cells()
    assert CliRunner().invoke(main, []).output.count("\n") == 1  # no list begins


def test_cells_have_the_committed_values_below_all_changes(study, monkeypatch):
    committed = {"views": 5, "seed": 0, "pretrain.epochs": 7}
    monkeypatch.setattr(grid, "committed_params", lambda path: committed)
    cells = study(variants={"a": {}, "b": {"views": 4}}).cells(("preprocess.transform=log",))
    # params.yaml in the working folder does not matter
    a, b = (default_params(cell.changes) for cell in cells)
    assert (a.views, a.preprocess.transform, a.pretrain.epochs) == (5, "log", 7)
    assert (b.views, b.preprocess.transform, b.pretrain.epochs) == (4, "log", 7)
