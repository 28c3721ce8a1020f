"""The benchmark of recordings works on tiny sets, with a replacement of the slow classifier."""

from typing import ClassVar

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.recordings import __main__ as recordings
from benchmarks.recordings.__main__ import COLUMNS, MINIROCKET, SIMPLE, main


def write_set(folder, shape, level, sessions):
    """Write 16 recordings of two objects, and return their folder.

    Args:
        folder: where the recordings are written.
        shape: sensors of a frame.
        level: the difference of the objects' mean readings.
        sessions: number of groups, or 0 for a set without groups.
    """
    rng = np.random.default_rng(0)
    groups = {}
    for index in range(16):
        label = index % 2
        name = f"{'ab'[label]}/{index}.npy"
        readings = rng.normal(level * label, 1, (4 + index % 3, *shape))
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        np.save(folder / name, readings.astype(np.float32))
        groups[name] = index // 2 % max(sessions, 1)
    if sessions:
        pd.Series(groups, name="group").to_csv(folder / "groups.csv", index_label="file")
    return str(folder)


class OnlyA:
    """A classifier that always answers "a".

    Attributes:
        folds: the number of groups and the shape of a frame, of each training set.
    """

    folds: ClassVar[list] = []

    def fit(self, X, labels, groups):
        self.folds.append((len(set(groups)), X[0].shape[1:]))
        return self

    def predict(self, X):
        return np.array(["a"] * len(X))


def test_sets_have_errors_on_held_out_groups_and_a_later_run_keeps_what_an_earlier_one_measured(
    tmp_path, monkeypatch
):

    def few_trees():
        return recordings.ExtraTreesClassifier(10, random_state=0)

    monkeypatch.setattr(recordings, "TactileClassifier", OnlyA)
    monkeypatch.setitem(SIMPLE, "trees", few_trees)
    sets = [
        write_set(tmp_path / "apart", (3,), 9.0, sessions=2),
        write_set(tmp_path / "far", (2, 2), 99.0, sessions=0),
    ]
    results = tmp_path / "results.csv"
    runner = CliRunner()
    first = runner.invoke(main, [*sets, "--out", str(results), "--only", "trees,svc,logistic"])
    assert first.exit_code == 0
    assert "Regret" not in first.output
    second = runner.invoke(main, [*sets[::-1], "--out", str(results), "--only", "ours"])
    assert second.output.endswith("\nRegret: mean 50.0 points, largest 50.0 points (far).\n")
    # there are four folds, or as many as groups
    assert OnlyA.folds == [(12, (2, 2))] * 4 + [(1, (1, 3))] * 2
    table = pd.read_csv(results, index_col="set")
    assert ["set", *table] == COLUMNS
    assert table["channels"].to_dict() == {"apart": 3, "far": 4}
    assert table["groups"].to_dict() == {"apart": 2, "far": 16}
    assert table["ours, error, %"].tolist() == [50, 50]
    assert table["svc, error, %"].tolist() == [0, 0]
    assert (table["trees, s"] > 0).all()
    unknown = runner.invoke(main, [*sets, "--only", "our"])
    assert unknown.exit_code == 1
    assert unknown.output.startswith("Error: --only has our; expected some of ours, trees")


class KnowsFolds(OnlyA):
    """A classifier that always answers "a".

    Attributes:
        folds: the groups of each training set.
    """

    def fit(self, X, labels, groups):
        self.folds.append(set(groups))
        return self


def test_persons_of_a_source_s_folders_are_held_out_together(tmp_path, monkeypatch):
    """Three persons have two recordings of each of two objects."""
    monkeypatch.setattr(recordings, "TactileClassifier", KnowsFolds)
    monkeypatch.setattr(KnowsFolds, "folds", [])
    rng = np.random.default_rng(0)
    for person in ("ann", "bob", "cem"):
        for name in "ab":
            folder = tmp_path / "set" / person / name
            folder.mkdir(parents=True)
            for index in range(2):
                np.save(folder / f"{index}.npy", rng.normal(size=(6, 3)).astype(np.float32))
    source = str(tmp_path / "set")
    options = "--groups sessions --only ours --layout SESSION/OBJECT/FILE"
    words = [source, *options.split(), "--out", str(tmp_path / "out.csv")]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    row = pd.read_csv(tmp_path / "out.csv").iloc[0]
    assert (row["groups"], row["recordings"], row["classes"]) == (3, 12, 2)
    assert sorted(map(sorted, KnowsFolds.folds)) == [[0, 1], [0, 2], [1, 2]]
    assert row["ours, error, %"] == 50
    options = "--groups sessions --only ours --layout OBJECT/FILE"
    result = CliRunner().invoke(main, [source, *options.split()])
    assert result.exit_code == 1
    assert result.output.startswith("Error: ")


def test_groups_are_left_out_by_an_option(tmp_path):
    source = write_set(tmp_path / "apart", (3,), 9.0, sessions=2)
    results = tmp_path / "none.csv"
    words = [source, "--groups", "none", "--only", "svc", "--out", str(results)]
    assert CliRunner().invoke(main, words).exit_code == 0
    assert pd.read_csv(results)["groups"].tolist() == [16]


@pytest.mark.skipif(MINIROCKET not in recordings.WITH_AEON, reason="aeon is not installed")
def test_minirocket_tells_recordings_of_unequal_lengths_apart(tmp_path):
    folder = write_set(tmp_path / "apart", (3,), 9.0, sessions=0)
    words = [folder, "--only", MINIROCKET, "--out", str(tmp_path / "out.csv")]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    assert pd.read_csv(tmp_path / "out.csv")["minirocket, error, %"].tolist() == [0]


@pytest.mark.skipif(MINIROCKET in recordings.WITH_AEON, reason="aeon is installed")
def test_minirocket_without_aeon_says_what_to_install(tmp_path):
    folder = write_set(tmp_path / "apart", (3,), 9.0, sessions=0)
    result = CliRunner().invoke(main, [folder, "--only", MINIROCKET])
    assert result.exit_code == 1 and "pip install aeon" in result.output
