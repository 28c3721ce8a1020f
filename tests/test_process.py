"""Processes: their start, their end and their cost."""

import os
import subprocess
import sys

from tactile_viewgcn.process import first_to_tell, is_running, peak_mb, rank, start_ticks


def test_a_process_is_running_until_it_is_gone():
    process = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    ticks = start_ticks(process.pid)
    assert is_running(process.pid, ticks)
    process.communicate(b"\n")
    assert not is_running(process.pid, ticks)


def test_another_process_with_the_same_number_is_not_the_one_that_was():
    ticks = start_ticks(os.getpid())
    assert is_running(os.getpid(), ticks)
    assert not ticks or not is_running(os.getpid(), str(int(ticks) - 1))


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
