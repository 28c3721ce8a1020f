"""Time per view set, on a clock that is known."""

from itertools import count
from types import SimpleNamespace

import pytest
import torch

from tactile_viewgcn.evaluation import latency as module
from tactile_viewgcn.evaluation.latency import latency
from tests.small_tables import CPU, trained


@pytest.fixture
def sizes(monkeypatch):
    """The number of view sets of each pass, on a clock that goes on by a second each time it is looked at."""
    ticks, sizes = count(), []
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: float(next(ticks))))
    logits = module.view_set_logits
    monkeypatch.setattr(
        module, "view_set_logits", lambda head, features, sets: sizes.append(len(sets)) or logits(head, features, sets)
    )
    return sizes


def test_latency_is_in_milliseconds_per_view_set(sizes, monkeypatch):
    monkeypatch.setattr(module, "MAX_BATCH", 4)
    measured = latency(trained(), torch.rand(3, 1, 12, 12), CPU, seconds=20)
    assert measured["single"] == {"median": 1000.0, "p95": 1000.0}
    assert measured["batch"] == {"median": 250.0, "p95": 250.0, "sets": 4}
    assert set(sizes) == {1, 2, 4}


def test_latency_is_bounded_by_time_and_slow_hardware_gets_smaller_batches(sizes):
    measured = latency(trained(), torch.rand(3, 1, 12, 12), CPU, seconds=1)
    assert measured["batch"]["sets"] == 1 and sizes == [1] * 4
