"""The cost of a process."""

import subprocess
import sys

import pytest

from tactile_viewgcn import process
from tactile_viewgcn.process import peak_mb


def test_a_process_that_has_just_begun_is_a_few_tenths_of_a_second_old():
    code = "import time; at = time.time(); from tactile_viewgcn import process; " + (
        "print(at - time.time() + process.seconds_since_start())"
    )
    age = float(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
    assert 0 <= age < 0.4


@pytest.mark.parametrize(
    ("uptimes", "expected"),
    [
        (["9.0 100.0", "9.5 101.0"], 2.0),  # nobody else computes on two cores
        (["9.0 0.00", "9.5 0.00"], float("inf")),  # a sandbox that does not count
        ([], float("inf")),  # no such file
    ],
)
def test_idle_cores_are_those_whose_idle_time_grows_meanwhile(monkeypatch, uptimes, expected):
    def read(_):
        if not uptimes:
            raise FileNotFoundError
        return uptimes.pop(0)

    monkeypatch.setattr(process.Path, "read_text", read)
    assert process.idle_cores(0.5) == pytest.approx(expected)


def test_the_peak_of_memory_counts_what_was_freed():
    block = b"\1" * int(1e6 * (peak_mb() + 100))  # more than the peak so far
    size = len(block) / 1e6
    del block
    assert peak_mb() > size
