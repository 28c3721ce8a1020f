"""Processes: their cost, and several that train together."""

import time

from tactile_viewgcn.process import first_to_tell, peak_mb, rank, seconds_since_start


def test_seconds_count_from_the_start_of_the_process_and_grow():
    first = seconds_since_start()
    time.sleep(0.05)
    assert first > 0.1 and 0.03 < seconds_since_start() - first < 5


def test_the_peak_of_memory_counts_what_was_freed():
    block = b"\1" * int(1e6 * (peak_mb() + 100))  # more than the process has held
    size = len(block) / 1e6
    del block
    assert peak_mb() > size


def test_of_several_processes_one_tells_why_they_end(tmp_path, monkeypatch):
    assert rank() == 0 and first_to_tell() and first_to_tell()
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "test")
    monkeypatch.setenv("TORCHELASTIC_ERROR_FILE", str(tmp_path / "1" / "error.json"))
    monkeypatch.setenv("RANK", "1")
    assert rank() == 1 and first_to_tell() and not first_to_tell()
