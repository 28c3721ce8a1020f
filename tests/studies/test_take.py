"""Results of cells that ran elsewhere: taken, or refused with what differs."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from studies import cells as cells_module
from studies import grid
from studies.__main__ import main
from studies.cells import read_answers
from studies.grid import Cell
from studies.run import git
from studies.take import take_cells
from tactile_viewgcn.evaluation.trials import ASKED, Predictions, Trials, write_predictions
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import load
from tactile_viewgcn.schema import flatten
from tests.records import RECORD

CELLS = {name: Cell(variant=name, seed=0, deal=0, fold=0, changes=(f"views={name}",)) for name in ("2", "4")}
ORIGIN = {"git.dirty": "false", "device": "NVIDIA H100", "processor": "Intel"}
TIMING = '{"seconds": {"pretrain": 1, "finetune": 2}, "peak_mb": 3, "latency_ms": {%s}}'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to write cells into, and a store of its own."""
    for module, name, place in ((cells_module, "STORE", "store"), (grid, "FOLDER", "studies")):
        monkeypatch.setattr(module, name, tmp_path / place)
    monkeypatch.setattr("studies.take.STORE", tmp_path / "store")
    return tmp_path / "cells"


def write_cell(folder, views, *, md5="ab", changes=(), **origin):
    """What the stages write for a cell of that number of views."""
    origin = {"mlflow.source.git.commit": git("rev-parse", "HEAD").strip()} | ORIGIN | origin
    values = flatten(load("params.yaml", (f"views={views}", *changes)))
    record = replace(
        RECORD, origin=origin, params={"values": values}, inputs={"frames": {"path": "f", "md5": md5}},
        counts={"loss.first": 3.0}, curves={"loss": [2.0, 1.5]},
    )  # fmt: skip
    for name in ("results", "runs"):
        (folder / name).mkdir(parents=True)
    for name in ("results/evaluate", "runs/pretrain", "runs/finetune"):
        (folder / f"{name}.json").write_text(record.text)
    latency = ", ".join(f'"{kind}": {{"median": {views}}}' for kind in ("single", "batch", "whole"))
    (folder / "results/timing.json").write_text(TIMING % latency)
    labels = np.array([0, 1, 0, 1])
    trials = Trials(np.zeros((1, 4, 3), np.int16), labels, labels, labels.astype(str), 8)
    write_predictions(
        folder / "results/predictions.npz", Predictions(dict.fromkeys(ASKED, trials), np.array(["a", "b"]))
    )


def test_cells_are_known_by_their_parameters_and_keep_losses_and_machine(folder):
    write_cell(folder / "first", 4)
    write_cell(folder / "second", 2)
    assert take_cells(folder, CELLS) == 2
    for views, cell in CELLS.items():
        answers = read_answers(cell, views)
        assert answers.costs["ms alone"] == int(views) and answers.machine == "NVIDIA H100"
        assert (answers.losses.end, answers.losses.trained) == (1.5, False)
        assert answers.predictions.trials["object"].errors.tolist() == [0.5]


@pytest.mark.parametrize(
    ("differs", "words"),
    [
        ({"changes": ["finetune.epochs=3"]}, "the most similar one differs in finetune.epochs=3"),
        ({"md5": "cd"}, "its frames have the md5 cd; expected ab"),
        ({"git.dirty": "true"}, "files that were not committed"),
        ({"mlflow.source.git.commit": "0" * 40}, "trained at commit 000000.*does not have"),
        ({"mlflow.source.git.commit": git("rev-list", "--max-parents=0", "HEAD").split()[0]}, "a different code"),
    ],
)
def test_a_cell_of_another_recipe_code_or_data_is_refused_and_none_is_taken(folder, differs, words):
    write_cell(folder / "first", 4)
    write_cell(folder / "second", 2, **differs)
    with pytest.raises(UserError, match=words):
        take_cells(folder, CELLS)
    assert not (folder.parent / "store").exists()


def test_frames_are_compared_with_those_of_cells_before(folder):
    write_cell(folder / "first", 4)
    take_cells(folder, CELLS)
    write_cell(folder.parent / "later/second", 2, md5="cd")
    with pytest.raises(UserError, match=r"store/4/finetune\.json"):
        take_cells(folder.parent / "later", CELLS)


def test_a_folder_without_results_is_one_line(folder):
    (folder / "first").mkdir(parents=True)
    with pytest.raises(UserError, match="no finished cell"):
        take_cells(folder, CELLS)
    result = CliRunner().invoke(main, ["claims", "--take", str(folder)])
    assert result.exit_code and result.output.count("\n") == 1
