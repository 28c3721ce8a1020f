"""The README's first commands work as printed, and it prints what the committed run has."""

import json
import os
import re
import subprocess

import pytest

from tests.glove_data import ROOT

README = (ROOT / "README.md").read_text()
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SUMMARY = ROOT / "results" / "summary.json"
NAMES = {
    "object protocol": "object",
    "recording protocol": "recording",
    "whole recordings": "whole",
}
MOST_APART = 0.1  # difference of an error, a share: another CPU changes some of 81 answers


def first_fence(language: str) -> str:
    """Return the content of the first fenced block in a language."""
    return next(content for kind, content in FENCE.findall(README) if kind == language)


def printed_errors(text: str) -> dict[str, float]:
    """Return the errors in % that `evaluate` printed, by name."""
    lines = re.findall(r"^  ([a-z ]+): error ([\d.]+)", text, re.MULTILINE)
    return {NAMES[name]: float(error) for name, error in lines if name in NAMES}


def test_the_printed_errors_are_those_of_the_committed_run():
    summary = json.loads(SUMMARY.read_text())
    expected = {name: round(100 * summary[f"error.{name}"], 1) for name in NAMES.values()}
    assert printed_errors(README) == expected


@pytest.mark.slow
@pytest.mark.timeout(2400)
def test_the_set_up_commands_work_in_a_fresh_clone(tmp_path):
    """Install into a fresh virtual environment, and run the whole default pipeline."""
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "VIRTUAL_ENV", "MLFLOW_TRACKING_URI", "DVC_ROOT")
    }
    commands = first_fence("bash")
    assert [line.split()[0] for line in commands.splitlines()] == ["python3", "dvc"]
    result = subprocess.run(
        ["bash", "-e", "-c", commands],
        cwd=clone,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    errors = printed_errors(result.stdout)
    committed = json.loads(SUMMARY.read_text())
    assert sorted(errors) == sorted(NAMES.values())
    for name, error in errors.items():
        assert error / 100 == pytest.approx(committed[f"error.{name}"], abs=MOST_APART)
