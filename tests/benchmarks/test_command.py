"""The command of a benchmark: timing in turns, its table and picture where they are asked for."""

import time

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from benchmarks import command
from benchmarks.command import benchmark, interleaved, median_ratio
from tactile_viewgcn.errors import UserError
from tests.small_tables import ROOT


@benchmark
def lengths(params, quick):
    """Measure lengths."""
    if params.seed != 0:
        raise UserError(f"seed is {params.seed}; expected 0")
    return "Lengths.", [{"what": "a foot", "m": 0.1 if quick else 0.3048}], Figure()


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    (tmp_path / "other.yaml").write_text((ROOT / "params.yaml").read_text().replace("\nseed: 0", "\nseed: 7"))
    return lambda *words: CliRunner().invoke(lengths, words)


@pytest.mark.parametrize(("words", "folder"), [((), "benchmarks/lengths"), (("--quick", "--out", "out"), "out")])
def test_text_table_and_picture_are_printed_and_written(run, tmp_path, words, folder):
    result = run(*words)
    assert result.exit_code == 0 and result.output.startswith("Lengths.\n\n| what   | m ")
    written = tmp_path / folder
    assert sorted(path.name for path in written.iterdir()) == ["results.csv", "results.md", "results.png"]
    assert (written / "results.csv").read_text().split() == ["what,m", "a", f"foot,{0.1 if words else 0.3048}"]


def test_a_quick_run_writes_nothing_and_a_mistake_ends_in_one_line(run, tmp_path):
    assert "| a foot | 0.1 |" in run("--quick").output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other.yaml", "params.yaml"]
    result = run("--params", "other.yaml")
    assert result.exit_code == 1 and result.output == "Error: seed is 7; expected 0\n"


def test_variants_take_turns_and_the_slower_one_is_found(monkeypatch):
    monkeypatch.setattr(command, "BLOCK", 1e-4)
    order = []

    def variant(name, seconds):
        def call():
            order.append(name)
            time.sleep(seconds)

        return call

    seconds = interleaved({"fast": variant("fast", 1e-3), "plain": variant("plain", 2e-2)}, rounds=3)
    changes = [name for name, before in zip(order, [None, *order], strict=False) if name != before]
    assert changes == ["fast", "plain"] * 3
    assert (seconds["fast"] >= 1e-3).all() and (seconds["plain"] >= 2e-2).all()  # a sleep is never shorter
    assert seconds["fast"].shape == (3,)


def test_a_ratio_is_the_median_of_the_rounds_ratios():
    seconds, other = np.array([2.5, 2.0, 3.0]), np.array([0.5, 1.0, 2.0])
    assert median_ratio(seconds, other) == pytest.approx(2.0)  # of 5, 2, 1.5; of the medians it is 2.5
