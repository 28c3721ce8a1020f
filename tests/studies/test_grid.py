"""From a study's file to its cells, and what makes two cells the same."""

import os
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml
from click.testing import CliRunner
from studies.dvc_queue import settings

from studies import __main__ as main_module
from studies import cells as cells_module
from studies import grid
from studies.__main__ import list_studies, main
from studies.cells import key_of
from studies.grid import Cell, names, read_study
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import load

LEAST = {"question": "Which?", "variants": {"a": {}}, "reference": None, "seeds": [0], "folds": [0], "columns": []}


def study(tmp_path, monkeypatch, tree=(), **more):
    monkeypatch.setattr(grid, "FOLDER", tmp_path)
    (tmp_path / "made.yaml").write_text(yaml.safe_dump(LEAST | dict(tree) | more, sort_keys=False))
    return read_study("made")


def test_cells_are_every_variant_from_every_seed_on_every_fold(tmp_path, monkeypatch):
    made = study(
        tmp_path,
        monkeypatch,
        set={"split.by": "recording"},
        variants={"a": {"views": 4}, "b": {"views": 2}},
        cross=[{"x": {"augment.shift": 1}, "y": {}}],
        seeds=[3, 5],
        one_seed=["b / x"],
        folds=[0, 1],
        quick=["b / x"],
    )
    counted = [(cell.variant, cell.seed) for cell in made.cells()]
    assert {each: counted.count(each) for each in counted} == {
        ("a / x", 3): 2, ("a / y", 3): 2, ("b / x", 3): 2, ("b / y", 3): 2,
        ("a / x", 5): 2, ("a / y", 5): 2, ("b / y", 5): 2,
    }  # fmt: skip
    changes = ("split.by=recording", "views=4", "augment.shift=1", "seed=3", "split.deal=0", "split.fold=0")
    assert made.cells()[0] == Cell("a / x", 3, 0, 0, changes)
    quick = made.cells(quick=True)
    assert [(cell.variant, cell.seed, cell.fold) for cell in quick] == [("b / x", 3, 0), ("b / x", 3, 1)]
    assert {"pretrain.epochs=1", "views=2", "glove.objects=[mug,tape,scissors]"} <= set(quick[0].changes)


def test_every_variant_is_trained_on_each_fold_of_each_deal_and_the_first_deal_of_all_comes_first(
    tmp_path, monkeypatch
):
    variants = {"a": {}, "b": {"views": 4}}
    made = study(tmp_path, monkeypatch, variants=variants, folds="all", deals=[0, 3], set={"split.folds": 2})
    assert [(cell.deal, cell.variant, cell.fold) for cell in made.cells()] == list(product([0, 3], "ab", [0, 1]))
    assert "split.deal=3" in made.cells()[-1].changes
    once = study(tmp_path, monkeypatch, variants=variants, deals=[0, 3], one_deal=["a"])
    assert [(cell.deal, cell.variant) for cell in once.cells()] == [(0, "a"), (0, "b"), (3, "b")]
    grasps = made.cells(on_top=("split.folds=6", "split.by=grasp"))
    assert len(grasps) == 2 * 2 * 6
    assert grasps[-1].changes[-5:] == ("split.folds=6", "split.by=grasp", "seed=0", "split.deal=3", "split.fold=5")


@pytest.mark.parametrize("key", ["seed", "split.deal", "split.fold"])
def test_what_a_study_sets_in_every_cell_cannot_be_put_on_top(tmp_path, monkeypatch, key):
    with pytest.raises(UserError, match=rf"--set {key}: every cell has its own; set it in .*made\.yaml"):
        study(tmp_path, monkeypatch).cells(on_top=(f"{key}=1",))


def test_a_preset_stands_for_its_changes_and_may_be_changed(tmp_path, monkeypatch):
    (cell,) = study(tmp_path, monkeypatch, variants={"p": {"preset": "network", "augment.shift": 2}}).cells()
    assert "model.system=vote" in cell.changes
    assert cell.changes.index("augment.shift=1") < cell.changes.index("augment.shift=2")


@pytest.mark.parametrize(
    ("tree", "word"),
    [
        ({"refrence": "a"}, "refrence"),
        ({"reference": "b"}, "'b'"),
        ({"picture": "pie"}, "pie"),
        ({"picture": "curves"}, "no names; expected one mapping in `cross`, whose names begin with a number"),
        ({"picture": "curves", "cross": [{"many": {"views": 8}}]}, "'many'; expected one mapping"),
        ({"picture": "curves", "cross": [{"8 views": {}}, {"1 fold": {}}]}, "'8 views', '1 fold'; expected one"),
        ({"one_seed": ["c"]}, "'c'"),
        ({"one_deal": ["c"]}, "'c'"),
        ({"quick": ["d"]}, "'d'"),
        ({"columns": ["peak GB"]}, "'peak GB'"),
        ({"variants": {"a": {"preset": "worst"}}}, "'worst'"),
        ({"variants": {}}, "variants is {}"),
        ({"variants": ["a"]}, r"variants is \['a'\]; expected a mapping"),
        ({"variants": {1: {}}}, "variants is {1: {}}; expected names with changes"),
        ({"cross": [{"x": None}]}, "variants is {'x': None}"),
        ({"cross": {"x": {}}}, "cross is {'x': {}}; expected a list of a mapping"),
        ({"seeds": 3}, r"seeds is 3; expected a list of an integer in \[0, 4294967295\]"),
        ({"seeds": []}, r"seeds is \[\]; expected a list"),
        ({"seeds": [0.5]}, r"seeds is \[0.5\]"),
        ({"deals": 5}, "deals is 5"),
        ({"deals": [-1]}, r"deals is \[-1\]"),
        ({"folds": 3}, r"folds is 3; expected all or a list of an integer in \[0, inf\)"),
        ({"folds": "any"}, "folds is 'any'"),
        ({"columns": "peak MB"}, "columns is 'peak MB'; expected a list of a text"),
        ({"columns": None}, "columns is None"),
        ({"set": None}, "set is None; expected a mapping"),
        ({"reference": 3}, "reference is 3; expected a text or a list of a text or null"),
        ({"reference": ["a", "b"]}, "'b'"),
        ({"question": True}, "question is True; expected a text"),
        ({"confusion": "yes"}, "confusion is 'yes'"),
        ({"quick": "a"}, "quick is 'a'"),
        ({7: "a"}, "unknown key 7"),
    ],
)
def test_a_mistake_in_the_file_is_named(tmp_path, monkeypatch, tree, word):
    with pytest.raises(UserError, match=word) as error:
        study(tmp_path, monkeypatch, tree)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("content", "word"), [("", "found nothing"), ("- a", "found list"), ("views: [8", "not YAML")])
def test_a_file_without_keys_and_values_is_refused(tmp_path, monkeypatch, content, word):
    monkeypatch.setattr(grid, "FOLDER", tmp_path)
    (tmp_path / "made.yaml").write_text(content)
    with pytest.raises(UserError, match=rf"made\.yaml: .*{word}"):
        read_study("made")


def test_a_list_is_the_value_of_one_training(tmp_path, monkeypatch):
    (cell,) = study(tmp_path, monkeypatch, variants={"a": {"model.neighbours": [4, 3, 2]}}).cells()
    assert "model.neighbours=[4,3,2]" in cell.changes


def test_a_key_that_is_missing_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(grid, "FOLDER", tmp_path)
    (tmp_path / "made.yaml").write_text("question: Which?\nvariants: {a: {}}\nreference: a\n")
    with pytest.raises(UserError, match="key seeds is missing"):
        read_study("made")


@pytest.mark.parametrize("name", names())
def test_every_study_and_its_rehearsal_have_parameters_that_pass_all_checks(name):
    made = read_study(name)
    keys = [{key_of(cell, "code") for cell in cells} for cells in (made.cells(), made.cells(quick=True))]
    assert len(keys[0]) == len(made.cells())  # no two are the same training
    assert 2 <= len(keys[1]) <= len(keys[0])
    assert not keys[0] & keys[1]


def test_a_wrong_parameter_is_told_with_its_variant():
    with pytest.raises(UserError, match=r"variant b: .*model\.sytem"):
        key_of(Cell("b", 0, 0, 0, ("model.sytem=vote",)), "code")


def test_what_an_experiment_left_in_params_yaml_is_told_with_the_remedy(monkeypatch):
    monkeypatch.setattr("studies.cells.committed_params", lambda path: {"views": 4})
    with pytest.raises(UserError, match=r"views in params\.yaml is not as in git: `git checkout params\.yaml`"):
        key_of(Cell("b", 0, 0, 0, ("model.system=nosuch",)), "code")


def test_a_cell_is_known_by_its_parameters_code_and_source(tmp_path):
    default, same = Cell("a", 0, 0, 0, ("views=8",)), Cell("b", 1, 0, 0, ())
    assert key_of(default, "code") == key_of(same, "code")  # params.yaml says 8
    assert key_of(default, "code") != key_of(default, "other code")
    assert key_of(default, "code") != key_of(replace(default, changes=("views=4",)), "code")
    source = tmp_path / "recordings.h5"
    source.write_bytes(b"1")
    cell = Cell("a", 0, 0, 0, (f"data.source={source}",))
    before = key_of(cell, "code")
    source.write_bytes(b"12")
    assert key_of(cell, "code") != before


def test_a_cell_is_the_same_on_a_machine_whose_source_lies_elsewhere_and_is_younger(tmp_path):
    keys = []
    for place, content in (("here", b"1"), ("there", b"1"), ("elsewhere", b"2")):
        (tmp_path / place / "mug").mkdir(parents=True)
        (tmp_path / place / "mug" / "1.h5").write_bytes(content)
        os.utime(tmp_path / place / "mug" / "1.h5", (len(keys), len(keys)))
        keys.append(key_of(Cell("a", 0, 0, 0, (f"data.source={tmp_path / place}",)), "code"))
    assert keys[0] == keys[1] != keys[2]


def test_an_experiment_is_given_the_last_change_of_a_key_and_a_source_that_it_can_read():
    assert settings(Cell("a", 0, 0, 0, ("views=4", "seed=1", "views=2"))) == ["views=2", "seed=1"]
    assert settings(Cell("a", 0, 0, 0, ("data.source=tests",))) == [f"data.source={Path('tests').resolve()}"]
    with pytest.raises(UserError, match="no_such_place"):
        settings(Cell("a", 0, 0, 0, ("data.source=/no_such_place",)))


def test_the_list_has_a_line_of_eighty_columns_for_each_study_and_an_estimate_from_finished_cells(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(cells_module, "STORE", tmp_path)
    monkeypatch.setattr(cells_module, "LAST", tmp_path / "timing.json")
    list_studies()
    lines = capsys.readouterr().out.splitlines()[1:]
    assert [line.split()[0] for line in lines] == names()
    assert max(map(len, lines)) <= 80
    assert all("not yet known" in line for line in lines)
    (tmp_path / "timing.json").write_text('{"seconds": {"total": 60}}')
    study = read_study("reuse")
    for cell, seconds in zip(study.cells(), (10, 20, 90), strict=False):
        folder = tmp_path / key_of(cell, cells_module.code_of_stages())
        folder.mkdir()
        (folder / "timing.json").write_text(f'{{"seconds": {{"total": {seconds}}}}}')
    list_studies()
    estimates = {line.split()[0]: line.split()[2] for line in capsys.readouterr().out.splitlines()}
    assert (estimates["reuse"], estimates["compare"]) == ("04:00", "22:00")  # 12 cells of 20 s, 22 of 60 s


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["nosuch"], "protocol, reuse"),
        (["compare", "--jobs", "0"], "--jobs is 0"),
        (["compare", "--set", "views=4"], "--set without --out"),
        (["compare", "--set", "views", "--out", "/tmp/x"], "expected key=value"),
        (["compare", "--set", "vews=4", "--out", "/tmp/x"], "did you mean views?"),
        (["compare", "--set", "seed=4", "--out", "/tmp/x"], "--set seed: every cell has its own"),
        (["viewpoints", "--set", "views=8", "--set", "viewpoints=auto", "--out", "/tmp/x"], "the same training twice"),
    ],
)
def test_a_mistake_on_the_command_line_ends_in_one_line(words, expected):
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 1
    assert expected in result.output
    assert result.output.count("\n") == 1


def test_changes_on_top_are_run_and_reported_and_leave_the_study_s_own_results(tmp_path, monkeypatch):
    made, told = study(tmp_path, monkeypatch, variants={"a": {}, "b": {"views": 4}}), {}

    def run_cells(name, cells, queue, *, jobs):
        told["views"] = [load("params.yaml", cell.changes).views for cell in cells.values()]
        told["transforms"] = {load("params.yaml", cell.changes).preprocess.transform for cell in cells.values()}
        return {}

    def write_report(study, answers, folder, *, rehearsal, on_top):
        told["report"] = folder, on_top
        return "table"

    monkeypatch.setattr(main_module, "run_cells", run_cells)
    monkeypatch.setattr(main_module, "DvcQueue", lambda: SimpleNamespace(finished=dict))
    monkeypatch.setattr(main_module, "read_answers", lambda cell, key: None)
    monkeypatch.setattr("studies.report.write_report", write_report)
    change = "preprocess.transform=log"
    main_module.run(made, jobs=1, quick=False, changes=(change,), out=tmp_path / "other")
    assert told == {"views": [8, 4], "transforms": {"log"}, "report": (tmp_path / "other", (change,))}
    main_module.run(made, jobs=1, quick=False)
    assert told["report"] == (main_module.FOLDER / "made", ())


def test_the_code_that_counts_is_the_stages():
    code = cells_module.code_of_stages()
    assert code == cells_module.code_of_stages()
    assert len(code) == 64
