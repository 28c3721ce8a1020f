"""The stages that studies are made of, run as DVC runs them, on a small table."""

import csv
import json
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from studies import train
from studies.arms import read_arms
from studies.folds.simple import NAMES
from studies.frames import at_random, shortened, validated
from tactile_viewgcn.clustering import cluster_table
from tactile_viewgcn.frames import read_frames, write_frames
from tactile_viewgcn.recordings import write_recordings
from tactile_viewgcn.split import TEST, TRAIN, VALIDATION
from tactile_viewgcn.stag import read_metadata
from tests.stag_files import metadata, save_matlab5
from tests.tables import ROOT, SMALL, pretrained, recipe, table

CHANGES = [word for change in (*SMALL, "precision=float32", "device=cpu") for word in ("--set", change)]


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with the small table's frames and a backbone that was pretrained on it."""
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    write_frames(tmp_path / "frames.h5", table())
    torch.save(pretrained(), tmp_path / "backbone.pt")
    (tmp_path / "pretrain.json").write_text(json.dumps({"seconds": 3.5}))
    return tmp_path


def run(module, *words):
    command = getattr(import_module(module), module.rpartition(".")[2])
    return CliRunner().invoke(command, [*CHANGES, *map(str, words), "--record", "record.json"])


def trained(arm, *words, out=None):
    fixed = ("--study", "s", "--frames", "frames.h5", "--backbone", "backbone.pt", "--pretrained", "pretrain.json")
    result = run("studies.train", *fixed, "--arm", arm, "--out", f"arms/{out or arm}.npz", *words)
    assert result.exit_code == 0, result.output
    return result


def test_arms_are_trained_tabled_and_drawn(place):
    trained("vote", "--set", "model.system=vote", "--timed")
    trained("unclustered", "--set", "cluster.method=none")
    other = run("studies.folds.simple", "--classifier", "lda", "--frames", "frames.h5", "--out", "arms/lda.npz")
    assert other.exit_code == 0, other.output
    arms = {arm.name: arm for arm in read_arms([place / "arms"])}
    assert arms.keys() == {"vote", "unclustered", NAMES["lda"]}
    for arm in arms.values():
        assert arm.right("recording").mean() > 0.6  # chance: 0.25
        np.testing.assert_array_equal(arm.labels, arms["vote"].labels)
    assert arms["vote"].costs["pretrain"] == 3.5 and arms["vote"].costs["finetune"] == 0
    assert arms["vote"].costs["single_ms"] > 0 and "single_ms" not in arms["unclustered"].costs
    assert arms["vote"].costs["weights.head"] == 4 * 128 + 4
    table_of = ("--study", "s", "--asks", "Which?", "--arms", "arms", "--reference", "unclustered", "--out", ".")
    assert run("studies.table", *table_of).exit_code == 0
    with (place / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6 and [row["more"] for row in rows if row["arm"] == "unclustered"] == ["", ""]
    text = (place / "results.md").read_text()
    assert text.startswith("Simulated by the virtual glove. Which?") and "`unclustered`" in text
    drawn = run("studies.picture", "--results", "results.csv", "--title", "t", "--out", "results.png")
    assert drawn.exit_code == 0 and (place / "results.png").stat().st_size > 10_000
    failed = run("studies.failures", "--arms", "arms", "--frames", "frames.h5", "--reference", "vote", "--out", ".")
    assert failed.exit_code == 0, failed.output
    assert {"confusion.png", "pairs.png", "pairs.csv", "pairs.md"} <= {path.name for path in place.iterdir()}


def test_the_training_side_can_be_clustered_from_a_seed_of_its_own(place, monkeypatch):
    found = []

    def watched(*given):
        found.append(cluster_table(*given))
        return found[-1]

    monkeypatch.setattr(train, "cluster_table", watched)
    for number, words in enumerate(([], ["--clustering", 1], ["--clustering", 2], ["--clustering", 1])):
        trained(f"clusters {number}", *words, "--set", "model.system=vote")
    usual, one, two, again = (views.cluster for views in found)
    np.testing.assert_array_equal(one, again)
    assert (one != two).any() and (one != usual).any()


def test_no_arms_and_an_unknown_reference_end_in_one_line(place):
    (place / "arms").mkdir()
    words = ("--study", "s", "--asks", "?", "--arms", "arms", "--out", ".")
    found = run("studies.table", *words)
    assert found.exit_code == 1 and found.output.startswith("Error: no trained arms")
    trained("vote", "--set", "model.system=vote")
    found = run("studies.table", *words, "--reference", "nobody")
    assert found.exit_code == 1 and "Error: no arm is called nobody; there are vote" in found.output


def test_validation_groups_take_the_test_side_s_place_and_the_test_side_goes():
    before = table("split.validation=0.25")
    after = validated(before)
    assert ((after.side == TEST) == (before.side == VALIDATION)).all()
    assert ((after.side == TRAIN) == (before.side == TRAIN)).all()
    assert len(after.on(TEST, TRAIN, VALIDATION)) == (before.side != TEST).sum()


def test_sides_at_random_split_every_recording_and_each_fold_once():
    how = recipe("split.folds=3")
    folds = [at_random(table(), how.preprocess, replace(how.split, fold=fold)) for fold in range(3)]
    tested = np.array([one.side == TEST for one in folds])
    assert (tested.sum(axis=0) == 1).all()
    for one in folds:
        for recording in np.unique(one.recording):
            assert set(one.side[one.recording == recording].tolist()) == {TRAIN, TEST}
        count = np.bincount(one.label[one.anchor & (one.side == TRAIN)])
        assert count.min() == count.max()


def test_a_shortened_side_has_the_first_frames_of_each_training_group():
    before, after = table(), shortened(table(), 0.25)
    assert ((after.side == TEST) == (before.side == TEST)).all()
    for group in np.unique(before.group[before.side == TRAIN]):
        own = np.flatnonzero(before.group == group)
        kept = np.flatnonzero((after.group == group) & (after.side == TRAIN))
        np.testing.assert_array_equal(kept, own[: len(kept)])
        assert len(kept) == 3
    assert not after.anchor[~np.isin(after.side, (TRAIN, TEST))].any()
    assert (shortened(before, 1.0).side == before.side).all()


def test_the_frames_of_a_study_come_from_the_recordings(place):
    tree = metadata(objects=4, recordings=6, frames=12)
    write_recordings(place / "recordings.h5", read_metadata(save_matlab5(place / "metadata.mat", tree)), "")
    words = ("--recordings", "recordings.h5", "--out", "study.h5")
    assert run("studies.frames", *words, "--side", "validation", "--share", "0.5").exit_code == 0
    found = read_frames(place / "study.h5")
    assert len(found.on(TRAIN)) and len(found.on(TEST)) and not len(found.on(VALIDATION))
    refused = run("studies.frames", *words, "--hold-out", "session")
    assert refused.exit_code == 1 and "Error: " in refused.output and "session" in refused.output
