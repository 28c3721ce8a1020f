"""The benchmark of recordings, with two tiny sets and a stand-in for the slow classifier."""

from typing import ClassVar

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.recordings import __main__ as recordings
from benchmarks.recordings.__main__ import COLUMNS, MINIROCKET, SIMPLE, main


def write_set(folder, shape, level, sessions):
    """Write 16 recordings of two objects, which differ by `level`; 0 sessions: no groups."""
    rng, groups = np.random.default_rng(0), {}
    for number in range(16):
        file = folder / "ab"[number % 2] / f"{number}.npy"
        file.parent.mkdir(parents=True, exist_ok=True)
        np.save(
            file, rng.normal(level * (number % 2), 1, (4 + number % 3, *shape)).astype(np.float32)
        )
        groups[f"{'ab'[number % 2]}/{number}.npy"] = number // 2 % max(sessions, 1)
    if sessions:
        pd.Series(groups, name="group").to_csv(folder / "groups.csv", index_label="file")
    return str(folder)


class OnlyA:
    """Answers "a", and takes only three axes; `asked` has the groups and shape of each fold."""

    asked: ClassVar[list] = []

    def fit(self, learnt, labels, groups):
        self.asked.append((len(set(groups)), learnt[0].shape[1:]))
        return self

    def predict(self, asked):
        return np.array(["a"] * len(asked))


def test_sets_have_errors_on_held_out_groups_and_a_later_run_keeps_what_an_earlier_one_measured(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(recordings, "TactileClassifier", OnlyA)
    monkeypatch.setitem(
        SIMPLE, "trees", lambda: recordings.ExtraTreesClassifier(10, random_state=0)
    )
    sets = [
        write_set(tmp_path / "apart", (3,), 9.0, sessions=2),
        write_set(tmp_path / "far", (2, 2), 99.0, sessions=0),
    ]
    out, run = tmp_path / "results.csv", CliRunner()
    first = run.invoke(main, [*sets, "--out", str(out), "--only", "trees,svc,logistic"])
    assert first.exit_code == 0 and "Regret" not in first.output
    second = run.invoke(main, [*sets[::-1], "--out", str(out), "--only", "ours"])
    assert second.output.endswith("\nRegret: mean 50.0 points, largest 50.0 points (far).\n")
    # folds: four, or as many as there are groups
    assert OnlyA.asked == [(12, (2, 2))] * 4 + [(1, (1, 3))] * 2
    table = pd.read_csv(out, index_col="set")
    assert ["set", *table] == COLUMNS and table["channels"].to_dict() == {"apart": 3, "far": 4}
    assert table["groups"].to_dict() == {"apart": 2, "far": 16}
    assert table["ours, error, %"].tolist() == [50, 50] and table["svc, error, %"].tolist() == [
        0,
        0,
    ]
    assert (table["trees, s"] > 0).all()
    unknown = run.invoke(main, [*sets, "--only", "our"])
    assert unknown.exit_code == 1 and unknown.output.startswith(
        "Error: --only has our; expected some of ours, trees"
    )


class KnowsFolds(OnlyA):
    """Remembers the groups of the recordings that it learns from."""

    def fit(self, learnt, labels, groups):
        self.asked.append(set(groups))
        return self


def test_persons_of_a_source_s_folders_are_held_out_together(tmp_path, monkeypatch):
    """Write two objects of three persons, two recordings each, and the same without groups."""
    monkeypatch.setattr(recordings, "TactileClassifier", KnowsFolds)
    monkeypatch.setattr(KnowsFolds, "asked", [])
    rng = np.random.default_rng(0)
    for person in ("ann", "bob", "cem"):
        for name in "ab":
            folder = tmp_path / "set" / person / name
            folder.mkdir(parents=True)
            for number in range(2):
                np.save(folder / f"{number}.npy", rng.normal(size=(6, 3)).astype(np.float32))
    words = [
        str(tmp_path / "set"),
        "--groups",
        "sessions",
        "--layout",
        "SESSION/OBJECT/FILE",
        "--only",
        "ours",
    ]
    result = CliRunner().invoke(main, [*words, "--out", str(tmp_path / "out.csv")])
    assert result.exit_code == 0, result.output
    row = pd.read_csv(tmp_path / "out.csv").iloc[0]
    assert (row["groups"], row["recordings"], row["classes"]) == (3, 12, 2)
    assert sorted(map(sorted, KnowsFolds.asked)) == [[0, 1], [0, 2], [1, 2]]
    assert row["ours, error, %"] == 50
    one = CliRunner().invoke(main, [*words[:3], "--layout", "OBJECT/FILE", "--only", "ours"])
    assert one.exit_code == 1 and one.output.startswith("Error: ")
    alone = [
        write_set(tmp_path / "apart", (3,), 9.0, sessions=2),
        "--groups",
        "none",
        "--only",
        "svc",
    ]
    assert CliRunner().invoke(main, [*alone, "--out", str(tmp_path / "none.csv")]).exit_code == 0
    assert pd.read_csv(tmp_path / "none.csv")["groups"].tolist() == [16]


@pytest.mark.skipif(MINIROCKET not in recordings.WITH_AEON, reason="aeon is not installed")
def test_minirocket_tells_recordings_of_unequal_lengths_apart(tmp_path):
    folder = write_set(tmp_path / "apart", (3,), 9.0, sessions=0)
    result = CliRunner().invoke(
        main, [folder, "--only", MINIROCKET, "--out", str(tmp_path / "out.csv")]
    )
    assert result.exit_code == 0, result.output
    assert pd.read_csv(tmp_path / "out.csv")["minirocket, error, %"].tolist() == [0]


@pytest.mark.skipif(MINIROCKET in recordings.WITH_AEON, reason="aeon is installed")
def test_minirocket_without_aeon_says_what_to_install(tmp_path):
    folder = write_set(tmp_path / "apart", (3,), 9.0, sessions=0)
    result = CliRunner().invoke(main, [folder, "--only", MINIROCKET])
    assert result.exit_code == 1 and "pip install aeon" in result.output
