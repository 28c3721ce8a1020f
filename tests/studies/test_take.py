"""Results of cells that ran elsewhere are taken, or refused with the difference."""

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
def folder(tmp_path, monkeypatch):
    """Make a repository of one stage's code with two commits, and return a folder for cells.

    The test runs in the repository.
    """
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
    """Write the files that the stages write for a cell.

    Args:
        folder: where the files are written.
        views: the number of views.
        md5: digest of its frames.
        changes: other changes of its parameters.
        only: the record that has the changed origin; by default all records.
        origin: changes of the origin.
    """
    unchanged = ORIGIN | {"mlflow.source.git.commit": git("rev-parse", "HEAD").strip()}
    values = flatten(load("params.yaml", (f"views={views}", *changes)))
    inputs = {"frames": {"path": "f", "md5": md5}}
    curves = {"loss": [2.0, 1.5]}
    for name in ("results/evaluate", "runs/pretrain", "runs/finetune"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        record = replace(
            RECORD,
            origin=dict(unchanged),
            params={"values": values},
            inputs=inputs,
            curves=curves,
            counts={"loss.first": 3.0},
        )
        if only in (None, name):
            record.origin.update(origin)
        (folder / f"{name}.json").write_text(record.text)
    latency = {kind: {"median": views} for kind in ("single", "batch", "whole")}
    timing = {"seconds": {"pretrain": 1, "finetune": 2}, "peak_mb": 3, "latency_ms": latency}
    (folder / "results/timing.json").write_text(json.dumps(timing))
    labels = np.array([0, 1, 0, 1])
    trials = Trials(np.zeros((1, 4, 3), np.int16), labels, labels, labels.astype(str), 8)
    predictions = Predictions(dict.fromkeys(TITLES, trials), np.array(["a", "b"]))
    write_predictions(folder / "results/predictions.npz", predictions)


def test_cells_are_known_by_their_parameters_and_those_of_before_stay(folder):
    write_cell(folder / "first", 4)
    assert take_cells(folder, CELLS) == 1
    write_cell(folder / "first", 4, device="cpu")
    write_cell(folder / "second", 2)
    assert take_cells(folder, CELLS) == 1
    for views, cell in CELLS.items():
        answers = answers_of(cell, read_results(views))
        assert answers.costs["ms alone"] == int(views)
        assert answers.machine == "NVIDIA H100"
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
def test_a_cell_of_another_recipe_code_or_data_is_refused_and_none_is_taken(folder, differs, words):
    if differs.get("mlflow.source.git.commit") == "HEAD~1":
        differs = differs | {"mlflow.source.git.commit": git("rev-parse", "HEAD~1").strip()}
    write_cell(folder / "first", 4)
    write_cell(folder / "second", 2, **differs)
    with pytest.raises(UserError, match=words):
        take_cells(folder, CELLS)
    assert not (folder.parent / "store").exists()
    assert not (folder.parent / "victim").exists()


def test_code_that_is_not_committed_is_different_code(folder):
    write_cell(folder / "first", 4)
    (folder.parent / "tactile_viewgcn/nn/graph.py").write_text("changed")
    with pytest.raises(UserError, match=r"different code: tactile_viewgcn/nn/graph\.py"):
        take_cells(folder, CELLS)


def test_frames_are_compared_with_those_of_cells_before(folder):
    write_cell(folder / "first", 4)
    take_cells(folder, CELLS)
    write_cell(folder.parent / "later/second", 2, md5="cd")
    with pytest.raises(UserError, match="expected ab"):
        take_cells(folder.parent / "later", CELLS)


@pytest.mark.parametrize(
    "name", ["results/predictions.npz", "results/timing.json", "runs/pretrain.json"]
)
@pytest.mark.parametrize("content", [None, "{}"])
def test_a_missing_or_damaged_file_is_one_line(folder, name, content):
    write_cell(folder / "first", 4)
    path = folder / "first" / name
    if content is None:
        path.unlink()
    else:
        path.write_text(content)
    with pytest.raises(UserError, match="first: not the results of a cell"):
        take_cells(folder, CELLS)


def test_a_folder_twice_or_none_is_refused(folder):
    folder.mkdir()
    with pytest.raises(UserError, match="no folder of a cell"):
        take_cells(folder, CELLS)
    for name in ("first", "second"):
        write_cell(folder / name, 4)
    with pytest.raises(UserError, match="second: the second folder of the cell 4"):
        take_cells(folder, CELLS)


@pytest.mark.parametrize(("changes", "out"), [((), None), (("cluster.restarts=3",), Path("other"))])
def test_a_study_that_takes_cells_runs_none_and_reports_those_that_are_there(
    folder, capsys, monkeypatch, changes, out
):
    monkeypatch.setattr("studies.__main__.run_cells", None)
    write_cell(folder / "first", 4, changes=changes)
    (folder.parent / "params.yaml").write_text("")  # DVC is about to write it
    variants = {"a": {"views": 4}, "b": {"views": 2}}
    settings = {"reference": None, "seeds": [0], "folds": [0], "columns": []}
    study = Study(name="made", question="", variants=variants, **settings)
    with pytest.raises(UserError, match="first/results: not the results of a cell"):
        run(study, take=folder / "first", changes=changes, out=out)
    assert not Path("studies").exists() and not Path("other").exists()
    run(study, take=folder, changes=changes, out=out)
    printed = capsys.readouterr().out
    assert "1 cell taken from" in printed
    assert "Missing training runs: b 1 of 1." in printed
    assert ((out or Path("studies/made")) / "results.md").read_text() in printed
