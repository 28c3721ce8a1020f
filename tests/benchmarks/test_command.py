"""The command of a benchmark: timing in turns, its table and picture where they are asked for."""

import time

import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from benchmarks import command
from benchmarks.command import benchmark, interleaved, median_ratio
from tactile_viewgcn.messages import UserError
from tests.glove_data import ROOT


@benchmark
def lengths(params, quick):
    """Measure lengths."""
    if not quick and params.views == 4:
        raise UserError("views is 4; expected 8")
    return "Lengths.", [{"what": "a foot", "m": 0.1 if quick else 0.3048}], Figure()


def test_text_table_and_picture_are_written_where_an_option_says_and_a_mistake_is_one_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    quick = CliRunner().invoke(lengths, ["--quick"])
    assert quick.output.startswith("Lengths.\n\n| what   | m ") and "| a foot | 0.1 |" in quick.output
    assert [path.name for path in tmp_path.iterdir()] == ["params.yaml"]
    for words, folder, metres in (([], "benchmarks/lengths", 0.3048), (["--quick", "--out", "out"], "out", 0.1)):
        assert CliRunner().invoke(lengths, words).exit_code == 0
        names = sorted(path.name for path in (tmp_path / folder).iterdir())
        assert names == ["results.csv", "results.md", "results.png"]
        assert (tmp_path / folder / "results.csv").read_text() == f"what,m\na foot,{metres}\n"
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text().replace("\nviews: 8", "\nviews: 4"))
    mistake = CliRunner().invoke(lengths, [])
    assert mistake.exit_code == 1 and mistake.output == "Error: views is 4; expected 8\n"


def test_variants_take_turns_and_the_ratio_is_the_median_of_the_rounds_ratios(monkeypatch):
    monkeypatch.setattr(command, "BLOCK", 1e-4)
    order = []

    def variant(name, seconds):
        order.append(name)
        time.sleep(seconds)

    pair = {"fast": lambda: variant("fast", 1e-3), "plain": lambda: variant("plain", 2e-2)}
    seconds = interleaved(pair, rounds=3)
    changes = [name for name, before in zip(order, [None, *order], strict=False) if name != before]
    assert changes == ["fast", "plain"] * 3 and seconds["fast"].shape == (3,)
    assert (seconds["fast"] >= 1e-3).all() and (seconds["plain"] >= 2e-2).all()  # a sleep is never shorter
    seconds, other = np.array([2.5, 2.0, 3.0]), np.array([0.5, 1.0, 2.0])
    assert median_ratio(seconds, other) == pytest.approx(2.0)  # of 5, 2, 1.5; of the medians it is 2.5
