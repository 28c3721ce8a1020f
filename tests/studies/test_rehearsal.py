"""A study of two cells through DVC's own queue, in a repository of its own; then again."""

import csv
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]


def sh(*words, cwd):
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("DVC_", "MLFLOW_", "GIT_"))}
    result = subprocess.run(
        list(map(str, words)), cwd=cwd, env=environment, capture_output=True, text=True, timeout=1200, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_a_rehearsal_runs_every_cell_once_and_leaves_table_and_picture(tmp_path):
    place = tmp_path / "repository"
    for name in sh("git", "ls-files", "-co", "--exclude-standard", cwd=ROOT).splitlines():
        if (ROOT / name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, place / name)
    sh("git", "init", "-q", cwd=place)
    sh("git", "add", "-A", cwd=place)
    sh("git", "-c", "user.name=test", "-c", "user.email=test@example.org", "commit", "-qm", "Test", cwd=place)
    before = (place / "studies/claims/results.csv").read_bytes()
    first = sh(sys.executable, "-m", "studies", "claims", "--quick", cwd=place)
    assert "2 cells, 0 of them finished before" in first
    with (place / "studies/.quick/claims/results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["variant"], row["protocol"]) for row in rows} == {
        (variant, "recording") for variant in ("paper", "maximum")
    }
    assert all(0 <= float(row["error"]) <= 100 for row in rows)
    assert (place / "studies/.quick/claims/results.png").stat().st_size > 1000
    assert (place / "studies/claims/results.csv").read_bytes() == before
    again = sh(sys.executable, "-m", "studies", "claims", "--quick", cwd=place)
    assert "2 cells, 2 of them finished before" in again
    assert "smallest difference" in again
