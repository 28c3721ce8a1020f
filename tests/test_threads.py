"""The number of threads: by the load of other programs, fixed by the user, remembered by a continued training."""

import os
import sys

import joblib
import psutil
import pytest
import threadpoolctl
import torch

from tactile_viewgcn import threads
from tactile_viewgcn.training.checkpoint import Progress, checkpoint_path, restore, save
from tests.glove_data import CPU


@pytest.fixture(autouse=True)
def no_threads_before():
    threads.used.clear()


@pytest.mark.parametrize(
    ("cores", "others", "most", "expected"),
    [
        (2, 0.04, 2, 2),  # a quiet machine
        (2, 0.97, 2, 1),  # one busy program
        (2, 2.0, 2, 1),
        (2, -0.01, 2, 2),  # two clocks disagree
        (64, 30.2, 64, 34),
        (64, 30.2, 2, 2),  # in a container that may use two
    ],
)
def test_there_is_a_thread_for_each_core_that_other_programs_leave(cores, others, most, expected):
    assert threads.free_cores(cores, others, most) == expected


def test_the_number_follows_what_others_use_of_this_process_cores(monkeypatch):
    now, shares, of_process, hooks, limits = [100.0], [0.0, 0.0, 100.0, 0.0], [0.0], [], []
    monkeypatch.delenv(threads.FIXED)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1, 3}, raising=False)  # 2 is not for this process
    monkeypatch.setattr(joblib, "cpu_count", lambda: 3)
    monkeypatch.setattr(psutil, "cpu_percent", lambda **_: shares)
    monkeypatch.setattr(psutil.Process, "cpu_percent", lambda _: of_process[0])
    monkeypatch.setattr(threads.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(sys.modules["torch.optim.optimizer"], "register_optimizer_step_post_hook", hooks.append)
    monkeypatch.setattr(threadpoolctl, "threadpool_limits", limits.append)
    before = torch.get_num_threads()
    torch.set_num_threads(4)
    try:
        threads.follow_load()
        assert torch.get_num_threads() == 3
        shares[:], of_process[:] = [100.0, 100.0, 100.0, 100.0], [100.0]  # two busy programs
        now[0] += 0.9
        hooks[0](None, (), {})
        assert torch.get_num_threads() == 3  # the last measurement is too recent
        now[0] += 0.1
        hooks[0](None, (), {})
        assert torch.get_num_threads() == 1
    finally:
        torch.set_num_threads(before)
    assert limits == [3, 1] and threads.used == {1, 3}


def test_a_fixed_number_stays_and_is_recorded(monkeypatch):
    monkeypatch.setenv(threads.FIXED, "1")
    monkeypatch.setattr(psutil, "cpu_percent", None)  # nothing is measured
    threads.follow_load()
    assert threads.used == {torch.get_num_threads()}


def test_a_continued_training_has_the_same_fixed_number_and_remembers_earlier_ones(tmp_path, monkeypatch):
    threads.used.update({1, 2})
    save(tmp_path / "training.pt", {}, Progress(epoch=1))
    threads.used.clear()  # another process
    threads.used.add(4)
    restore(tmp_path / "training.pt", {})
    assert threads.used == {1, 2, 4}
    path = checkpoint_path("pretrain", "key", CPU)
    monkeypatch.setenv(threads.FIXED, "7")
    assert checkpoint_path("pretrain", "key", CPU) != path
