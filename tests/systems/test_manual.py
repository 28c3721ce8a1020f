"""The manual's example of a system, added to a copy of the repository as the manual says."""

import os
import re
import subprocess
import sys

import pytest

from tests.glove_data import ROOT
from tests.stages.running import copy_repository

NAME = "median"


def section() -> str:
    """Return the manual's section "Add a system"."""
    return (ROOT / "docs" / "systems.md").read_text().partition("## Add a system")[2]


def example() -> str:
    """Return the program of that section."""
    return re.search(r"^```python\n(.*?)^```$", section(), re.MULTILINE | re.DOTALL)[1]


def described_by() -> list[str]:
    """Return the names of the tests' sets into which the section puts the example."""
    sentence = re.search(rf"`{NAME}` belongs\s+to the sets ([^.:]*)", section())
    return re.findall(r"`([A-Z_]+)`", sentence[1]) if sentence else []


def put(path, place, text):
    """Put a text behind the only match of a pattern in a file."""
    changed, times = re.subn(place, lambda match: match[0] + text, path.read_text())
    assert times == 1, path
    path.write_text(changed)


def python(*words, cwd) -> str:
    """Return the output of a program of the copy, which has to end without error."""
    command = [sys.executable, *words]
    environment = os.environ | {"PYTHONPATH": str(cwd)}
    done = subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_manual_s_system_does_what_the_manual_says_and_passes_the_tests_that_it_names(tmp_path):
    copy_repository(tmp_path)
    package = tmp_path / "tactile_viewgcn"
    (package / "systems" / f"{NAME}.py").write_text(f'"""Median."""\n\n{example()}')
    put(package / "params.py", r"(?s)\nSystem = Literal\[.*?\n", f'    "{NAME}",\n')
    put(tmp_path / "params.yaml", r"\n  system: view_gcn .*", f" | {NAME}")
    for name in described_by():
        put(tmp_path / "tests" / "systems" / "test_systems.py", rf"\n{name} = {{", f'"{NAME}", ')
    output = python(
        "-m", "pytest", "tests/systems", "-k", NAME, "-rp", "-p", "no:cacheprovider", cwd=tmp_path
    )
    passed = re.findall(rf"^PASSED .*::(\w+)\[.*{NAME}.*\]$", output, re.MULTILINE)
    assert "test_fewer_and_more_views_are_taken_where_a_system_says_so" in passed
    assert len(passed) > 4
    python("-m", "pytest", "tests/test_params.py", "-p", "no:cacheprovider", cwd=tmp_path)
    python("-m", "ruff", "check", "--no-cache", ".", cwd=tmp_path)
    python("-m", "ruff", "format", "--no-cache", "--check", ".", cwd=tmp_path)
