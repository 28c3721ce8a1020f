"""The cost of a process."""

import pytest

from tactile_viewgcn import process
from tactile_viewgcn.process import peak_mb


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
