"""Every study depends on the code that it runs, and error against run time is put together as it should be."""

import json
import re
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import yaml

from studies.error_time.picture import front, picture
from studies.error_time.settings import changed, reuses, schedule, settings
from studies.error_time.table import together
from studies.error_time.trainings import Runs, recipe_of
from tactile_viewgcn.clustering import cluster_table
from tactile_viewgcn.split import TEST, TRAIN, VALIDATION
from tests.imports import closure
from tests.tables import recipe, table

ROOT = Path(__file__).parents[1]
STAGES = {
    f"{path.parent.name}.{name}": stage
    for path in sorted(ROOT.glob("studies/**/dvc.yaml"))
    for name, stage in yaml.safe_load(path.read_text())["stages"].items()
}


@pytest.mark.parametrize("name", sorted(STAGES))
def test_a_study_depends_on_the_modules_that_it_imports(name):
    entry = re.search(r"python -m (\S+)", STAGES[name]["cmd"]).group(1).replace(".", "/") + ".py"
    listed = {path for path in STAGES[name]["deps"] if path.endswith(".py")}
    assert {re.sub(r"\$\{.*?\}", "${model.system}", path) for path in listed} == closure(entry)


@pytest.mark.parametrize("name", sorted(STAGES))
def test_a_study_watches_the_parameters_that_it_reads(name):
    entry = re.search(r"python -m (\S+)", STAGES[name]["cmd"]).group(1)
    reads = set(getattr(import_module(entry), entry.rpartition(".")[2]).reads)
    given = {change.split("=")[0].split(".")[0] for change in re.findall(r"--set (\S+)", STAGES[name]["cmd"])}
    watched = {key if key in reads else key.split(".")[0] for key in STAGES[name].get("params", [])}
    assert reads - given <= watched <= reads


def test_arms_that_name_their_system_watch_everything_else_of_the_model():
    keys = {f"model.{key}" for key in yaml.safe_load((ROOT / "params.yaml").read_text())["model"]} - {"model.system"}
    named = [stage for stage in STAGES.values() if "studies.train" in stage["cmd"] and "model.system=" in stage["cmd"]]
    assert len(named) >= 4
    for stage in named:
        assert {key for key in stage["params"] if key.startswith("model")} == keys


@pytest.mark.parametrize("name", sorted(STAGES))
def test_a_study_depends_on_the_preset_that_it_takes(name):
    taken = {f"tactile_viewgcn/presets/{preset}.yaml" for preset in re.findall(r"--preset (\S+)", STAGES[name]["cmd"])}
    assert {path for path in STAGES[name]["deps"] if path.startswith("tactile_viewgcn/presets/")} == taken


@pytest.mark.parametrize("study", sorted(path.parent.name for path in ROOT.glob("studies/*/dvc.yaml")))
def test_a_study_has_a_paragraph_in_the_readme(study):
    assert f"`dvc repro studies/{study}/dvc.yaml`" in (ROOT / "README.md").read_text()


def test_a_shorter_schedule_keeps_its_shape():
    how = recipe("pretrain.epochs=30", "pretrain.halve_every=10", "finetune.epochs=15")
    assert schedule(how, 0.5) == {"pretrain.epochs": 15, "pretrain.halve_every": 5, "finetune.epochs": 8}
    assert schedule(how, 0.01) == {"pretrain.epochs": 1, "pretrain.halve_every": 1, "finetune.epochs": 1}


def test_settings_change_what_they_say_and_nothing_else():
    how = recipe()
    for setting in settings(how):
        found = changed(how, setting.changes)
        for name, value in vars(how).items():
            keys = [key for key in setting.changes if key.split(".")[0] == name]
            assert (getattr(found, name) == value) or keys, (setting, name)
    assert changed(how, {"finetune.reuse": 4}).finetune.reuse == 4
    assert {setting.axis for setting in settings(how)} == {"time", "views", "width", "reuse"}


def write(path, right, groups=(0, 0, 1, 1), values=("1", "2"), recipe="one"):
    rows = [
        {
            "axis": "reuse",
            "value": value,
            "seed": 0,
            "protocol": "recording",
            "pretrain": 10.0,
            "finetune": 5.0 / (1 + n),
        }
        for n, value in enumerate(values)
    ]
    np.savez_compressed(
        path, rows=json.dumps(rows), right=np.array(right, dtype=float), groups=np.array(groups), recipe=recipe
    )
    return path


def test_seeds_are_averaged_and_settings_compared_in_pairs(tmp_path):
    first = write(tmp_path / "0.npz", [[1, 1, 0, 0], [1, 1, 1, 0]])
    second = write(tmp_path / "1.npz", [[1, 0, 0, 0], [1, 0, 1, 0]])
    paper, shared = together([first, second], np.random.default_rng(0))
    assert (paper["error"], shared["error"]) == pytest.approx((62.5, 37.5))
    assert paper["more"] == 0 and paper["reference"] == "reference" and shared["reference"] == ""
    assert shared["more"] == pytest.approx(-25)
    assert shared["more low"] <= -25 <= shared["more high"]
    assert paper["spread"] == pytest.approx(100 * 0.25 / 2**0.5)
    assert (paper["finetune"], shared["finetune"]) == (5.0, 2.5)
    assert paper["touches"] == ""


def test_one_seed_has_no_spread(tmp_path):
    paper, _ = together([write(tmp_path / "0.npz", [[1, 1, 0, 0], [1, 1, 1, 0]])], np.random.default_rng(0))
    assert paper["spread"] == ""


@pytest.mark.parametrize("other", [{"groups": (0, 1, 1, 1)}, {"values": ("1", "4")}])
def test_seeds_of_other_anchors_or_settings_are_refused(tmp_path, other):
    right = [[1, 1, 0, 0], [1, 1, 1, 0]]
    paths = [write(tmp_path / "0.npz", right), write(tmp_path / "1.npz", right, **other)]
    with pytest.raises(ValueError, match=r"1\.npz: other settings or anchors than the first"):
        together(paths, np.random.default_rng(0))


def test_seeds_of_another_recipe_and_none_at_all_are_refused(tmp_path):
    right = [[1, 1, 0, 0], [1, 1, 1, 0]]
    paths = [write(tmp_path / f"{recipe}.npz", right, recipe=recipe) for recipe in ("one", "two")]
    with pytest.raises(ValueError, match="2 seeds of 2 different recipes"):
        together(paths, np.random.default_rng(0))
    with pytest.raises(ValueError, match="0 seeds of 0 different recipes"):
        together([], np.random.default_rng(0))


def test_seeds_have_one_recipe_and_other_parameters_another():
    assert recipe_of(recipe("seed=1")) != recipe_of(recipe("views=3"))
    assert recipe_of(recipe("seed=1")) == recipe_of(recipe("seed=2"))


def test_the_pareto_front_has_what_nothing_beats():
    costs, errors = np.array([1.0, 2, 2, 3, 4]), np.array([50.0, 40, 45, 42, 10])
    assert front(costs, errors).tolist() == [0, 1, 4]
    assert front(np.array([1.0, 1]), np.array([5.0, 5])).tolist() == [0]


def test_the_picture_has_a_panel_for_each_cost_there_is(tmp_path):
    rows = together([write(tmp_path / "0.npz", [[1, 1, 0, 0], [1, 1, 1, 0]])], np.random.default_rng(0))
    panels = picture(rows, "made up").axes
    assert [panel.get_xlabel() for panel in panels] == ["seconds of both trainings", "seconds of fine-tuning"]


@pytest.fixture
def runs(monkeypatch):
    """The runs of a seed on the small table, its validation side a quarter of the training side."""
    sides = {0.0: table(), 0.5: table("split.validation=0.25")}
    monkeypatch.setattr(
        "studies.error_time.trainings.prepare", lambda _, __, split, ___: (sides[split.validation], None)
    )
    monkeypatch.setattr("studies.error_time.trainings.Recordings", nullcontext)
    monkeypatch.setattr("tactile_viewgcn.evaluation.latency", lambda *_: {"single": {"median": 1.0}})
    return Runs(recipe("device=cpu", "precision=float32", "evaluate.trials=2"), None)


def test_what_agrees_is_trained_once_and_every_row_has_its_costs(runs):
    for setting in reuses():
        runs.train_and_test(setting, runs.table)
    runs.precisions()
    assert [(row["axis"], row["value"]) for row in runs.rows[::2]] == [
        *(("reuse", str(count)) for count in (1, 2, 4, 8)),
        *(("precision", name) for name in ("float64", "float32", "bfloat16")),
    ]
    assert len({row["pretrain"] for row in runs.rows}) == 1
    assert len({row["finetune"] for row in runs.rows}) == 4
    assert all(row["single_ms"] == 1.0 for row in runs.rows)
    wrong = 1 - np.array(runs.right).mean(axis=1)
    assert (wrong < 0.5).all()  # chance: 0.75
    np.testing.assert_allclose(wrong[8], wrong[10], atol=0.01)  # float64 and float32


def test_touches_are_measured_on_the_test_side_by_a_classifier_that_did_not_see_the_validation_side(runs):
    runs.touches()
    assert [row["value"] for row in runs.rows[:5]] == ["fixed 1", "fixed 2", "fixed 3", "fixed 4", "stop at 0.3"]
    means = [row["touches"] for row in runs.rows[4:]]
    assert means == sorted(means) and 1 <= means[0] <= means[-1] <= 4
    frames = table()
    assert len(runs.groups) == len(runs.right[0]) == (frames.anchor & (frames.side == TEST)).sum()


def test_the_held_out_table_is_tested_on_validation_groups_and_the_test_side_is_gone(runs):
    validated = table("split.validation=0.25")
    assert ((runs.held_out.side == TEST) == (validated.side == VALIDATION)).all()
    assert ((runs.held_out.side == TRAIN) == (validated.side == TRAIN)).all()
    places = np.zeros((4, 3))
    views = cluster_table(runs.held_out, places, recipe().cluster, np.random.default_rng(0))
    assert ((views.cluster >= 0) == (validated.side == TRAIN)).all()
