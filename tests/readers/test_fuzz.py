"""Inputs with random damage: each is read, or refused in one line, in little time and memory; none crashes."""

import json
import subprocess
import sys

import pytest

from tests.imports import ROOT
from tests.readers.fuzz import NAMES

#: Inputs of each kind
INPUTS = {"hdf5": 500, "matlab5": 300, "matlab73": 400, "params": 200, "npy": 150, "npz": 150, "csv": 150}
INPUTS |= {"server": 150, "mat": 150}


@pytest.mark.slow
@pytest.mark.parametrize("kind", INPUTS)
def test_a_damaged_input_is_read_or_refused_in_one_line(kind, tmp_path):
    words = [sys.executable, "-m", "tests.readers.fuzz", kind, "0", str(INPUTS[kind]), str(tmp_path / "place")]
    ended = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=500)
    results = [json.loads(line) for line in ended.stdout.splitlines()]
    assert ended.returncode == 0, (results[-1:], ended.stderr[-2000:])  # the number of the input, see `fuzz.main`
    results = [result for result in results if "outcome" in result]
    assert [result["number"] for result in results] == list(range(INPUTS[kind]))
    assert {result["outcome"] for result in results} == {"read", "refused"}
    refused = [result["line"] for result in results if result["outcome"] == "refused"]
    assert [line for line in refused if "\n" in line] == []
    if kind != "server":
        assert [line for line in refused if NAMES.get(kind, "a.h5") not in line and "/in" not in line] == []
    assert max(result["seconds"] for result in results) < 10
    assert [line for line in refused if "MemoryError" in line] == []  # declared sizes are checked first
    assert [result["left"] for result in results if result["left"]] == []
