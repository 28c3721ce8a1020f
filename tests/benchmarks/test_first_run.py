"""The benchmark of a first run works on few recordings, without the installation."""

import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.first_run import page
from benchmarks.first_run.__main__ import first_run

ROWS = [
    {"step": "installation", "seconds": 100.4},
    {"step": "dvc repro", "threads": 2, "seconds": 149.6, "whole": 55.55},
    {"step": "dvc repro", "threads": 1, "seconds": 200.2, "whole": 54.32},
]


@pytest.mark.slow
def test_each_number_of_threads_runs_in_a_clone_of_its_own(tmp_path):
    words = ["--quick", "--out", str(tmp_path)]
    result = CliRunner().invoke(first_run, words, catch_exceptions=False)
    assert result.exit_code == 0
    rows = pd.read_csv(tmp_path / "results.csv")
    assert rows["step"].tolist() == ["dvc repro", "dvc repro"]
    assert rows["threads"].tolist() == [1, 2]
    assert rows[["whole", "recording", "object"]].stack().between(0, 100).all()


def test_the_pages_have_the_rows_by_their_threads(tmp_path, monkeypatch):
    common = {"recording": 50.0, "object": 40.0, "machine": "2 cores of a CPU"}
    rows = [common | row for row in ROWS]
    pd.DataFrame(rows).to_csv(tmp_path / "results.csv", index=False)
    monkeypatch.setattr(page, "FOLDER", tmp_path)
    assert page.seconds_sentence().replace("\n", " ") == (
        "On 2 cores of a CPU the installation took 100 seconds. The first run took 150 seconds "
        "with two threads, and 200 with one."
    )
    head, _, *rows = page.threads_table().splitlines()
    assert cells_of(head) == ["threads", "`whole`", "`recording`", "`object`"]
    assert [cells_of(row) for row in rows] == [
        ["1", "54.3", "50.0", "40.0"],
        ["2", "55.5", "50.0", "40.0"],
    ]


def cells_of(line):
    """Return the cells of a line of a Markdown table."""
    return [cell.strip() for cell in line.split("|")[1:-1]]
