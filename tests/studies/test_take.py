"""Results of cells that ran elsewhere are taken, or refused with what differs."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from studies import cells as cells_module
from studies.__main__ import run
from studies.cells import answers_of, read_results
from studies.grid import Cell, Study
from studies.run import git
from studies.take import take_cells
from tactile_viewgcn.evaluation.trials import TITLES, Predictions, Trials, write_predictions
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load
from tactile_viewgcn.schema import flatten
from tests.glove_data import ROOT
from tests.records import RECORD
from tests.stages.running import commit

CELLS = {
    views: Cell(variant=views, seed=0, deal=0, fold=0, changes=(f"views={views}",))
    for views in ("2", "4")
}
ORIGIN = {"git.dirty": "false", "device": "NVIDIA H100", "processor": "Intel"}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Make a repository of one stage's code with two commits, in which the test runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    (tmp_path / "tactile_viewgcn/nn").mkdir(parents=True)
    (tmp_path / "tactile_viewgcn/nn/graph.py").write_text("code")
    for text in ("before", "now"):
        (tmp_path / "dvc.yaml").write_text(text)
        commit(tmp_path)
    monkeypatch.setattr(cells_module, "STORE", tmp_path / "store")
    return tmp_path / "cells"


def write_cell(folder, views, *, md5="ab", changes=(), only=None, **origin):
    """Write the files that the stages write for a cell with this number of views.

    With `only`, just this record has the changed origin.
    """
    unchanged = ORIGIN | {"mlflow.source.git.commit": git("rev-parse", "HEAD").strip()}
    values = flatten(load("params.yaml", (f"views={views}", *changes)))
    inputs, curves = {"frames": {"path": "f", "md5": md5}}, {"loss": [2.0, 1.5]}
    for name in ("results/evaluate", "runs/pretrain", "runs/finetune"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        of_record = unchanged | (origin if only in (None, name) else {})
        record = replace(
            RECORD, origin=of_record, params={"values": values}, inputs=inputs, curves=curves
        )
        (folder / f"{name}.json").write_text(replace(record, counts={"loss.first": 3.0}).text)
    latency = {kind: {"median": views} for kind in ("single", "batch", "whole")}
    timing = {"seconds": {"pretrain": 1, "finetune": 2}, "peak_mb": 3, "latency_ms": latency}
    (folder / "results/timing.json").write_text(json.dumps(timing))
    labels = np.array([0, 1, 0, 1])
    trials = Trials(np.zeros((1, 4, 3), np.int16), labels, labels, labels.astype(str), 8)
    predictions = Predictions(dict.fromkeys(TITLES, trials), np.array(["a", "b"]))
    write_predictions(folder / "results/predictions.npz", predictions)


def test_cells_are_known_by_their_parameters_and_those_of_before_stay(place):
    write_cell(place / "first", 4)
    assert take_cells(place, CELLS) == 1
    write_cell(place / "first", 4, device="cpu")
    write_cell(place / "second", 2)
    assert take_cells(place, CELLS) == 1
    for views, cell in CELLS.items():
        answers = answers_of(cell, read_results(views))
        assert answers.costs["ms alone"] == int(views) and answers.machine == "NVIDIA H100"
        assert (answers.losses.end, answers.losses.trained) == (1.5, False)
        assert answers.predictions.trials["object"].errors.tolist() == [0.5]


@pytest.mark.parametrize(
    ("differs", "words"),
    [
        ({"changes": ["finetune.epochs=3"]}, "the most similar one differs in finetune.epochs=3"),
        ({"md5": "cd"}, "its frames have the md5 cd; expected ab"),
        ({"git.dirty": "true", "only": "runs/finetune"}, "files that were not committed"),
        ({"mlflow.source.git.commit": "0" * 40}, "ran at commit 000000.*lacks"),
        ({"mlflow.source.git.commit": "--output=victim"}, "expected 40 hexadecimal digits"),
        (
            {"mlflow.source.git.commit": "HEAD~1", "only": "runs/pretrain"},
            "with different code: dvc.yaml",
        ),
    ],
)
def test_a_cell_of_another_recipe_code_or_data_is_refused_and_none_is_taken(place, differs, words):
    if differs.get("mlflow.source.git.commit") == "HEAD~1":
        differs = differs | {"mlflow.source.git.commit": git("rev-parse", "HEAD~1").strip()}
    write_cell(place / "first", 4)
    write_cell(place / "second", 2, **differs)
    with pytest.raises(UserError, match=words):
        take_cells(place, CELLS)
    assert not (place.parent / "store").exists() and not (place.parent / "victim").exists()


def test_code_that_is_not_committed_is_different_code(place):
    write_cell(place / "first", 4)
    (place.parent / "tactile_viewgcn/nn/graph.py").write_text("changed")
    with pytest.raises(UserError, match=r"different code: tactile_viewgcn/nn/graph\.py"):
        take_cells(place, CELLS)


def test_frames_are_compared_with_those_of_cells_before(place):
    write_cell(place / "first", 4)
    take_cells(place, CELLS)
    write_cell(place.parent / "later/second", 2, md5="cd")
    with pytest.raises(UserError, match="expected ab"):
        take_cells(place.parent / "later", CELLS)


@pytest.mark.parametrize(
    "name", ["results/predictions.npz", "results/timing.json", "runs/pretrain.json"]
)
@pytest.mark.parametrize("content", [None, "{}"])
def test_a_missing_or_damaged_file_is_one_line(place, name, content):
    write_cell(place / "first", 4)
    (place / "first" / name).unlink() if content is None else (place / "first" / name).write_text(
        content
    )
    with pytest.raises(UserError, match="first: not the results of a cell"):
        take_cells(place, CELLS)


def test_a_folder_twice_or_none_is_refused(place):
    place.mkdir()
    with pytest.raises(UserError, match="no folder of a cell"):
        take_cells(place, CELLS)
    for name in ("first", "second"):
        write_cell(place / name, 4)
    with pytest.raises(UserError, match="second: the second folder of the cell 4"):
        take_cells(place, CELLS)


@pytest.mark.parametrize(("changes", "out"), [((), None), (("cluster.restarts=3",), Path("other"))])
def test_a_study_that_takes_cells_runs_none_and_reports_those_that_are_there(
    place, capsys, monkeypatch, changes, out
):
    monkeypatch.setattr("studies.__main__.run_cells", None)
    write_cell(place / "first", 4, changes=changes)
    (place.parent / "params.yaml").write_text("")  # DVC is about to write it
    settings = {"reference": None, "seeds": [0], "folds": [0], "columns": []}
    study = Study(
        name="made", question="", variants={"a": {"views": 4}, "b": {"views": 2}}, **settings
    )
    with pytest.raises(UserError, match="first/results: not the results of a cell"):
        run(study, take=place / "first", changes=changes, out=out)
    assert not Path("studies").exists() and not Path("other").exists()
    run(study, take=place, changes=changes, out=out)
    printed = capsys.readouterr().out
    assert "1 cell taken from" in printed and "Missing training runs: b 1 of 1." in printed
    assert ((out or Path("studies/made")) / "results.md").read_text() in printed
