"""The command of a benchmark: timing in turns, its table and picture where they are asked for."""

import numpy as np
from click.testing import CliRunner
from matplotlib.figure import Figure

from benchmarks.command import benchmark, median_ratio
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


def test_the_ratio_is_the_median_of_the_rounds_ratios():
    assert median_ratio(np.array([2.5, 2.0, 3.0]), np.array([0.5, 1.0, 2.0])) == 2.0  # of the medians it is 2.5
