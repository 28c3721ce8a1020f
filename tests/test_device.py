"""Device and precision of the computation, and the moves of frames to a device."""

import joblib
import psutil
import pytest
import threadpoolctl
import torch

from tactile_viewgcn.device import Compute, select_device, set_threads
from tactile_viewgcn.messages import UserError

CPU = torch.device("cpu")
CUDA = torch.device("cuda")


@pytest.fixture
def machine(monkeypatch):
    """Return a function that makes torch believe in abilities of the machine.

    Its argument `free` is the number of bytes that are free on the GPU.
    """

    def pretend(*, cuda=False, cuda_bfloat16=False, avx512_bf16=False, amx=False, free=0):
        def supported(including_emulation=True):
            return cuda_bfloat16 or including_emulation

        monkeypatch.setattr(torch.cuda, "is_available", lambda: cuda)
        monkeypatch.setattr(torch.cuda, "is_bf16_supported", supported)
        monkeypatch.setattr(torch.cuda, "mem_get_info", lambda _: (free, 10 * free))
        monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: avx512_bf16)
        monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: amx)

    return pretend


@pytest.mark.parametrize(
    ("abilities", "wanted", "chosen"),
    [
        ({}, (), Compute(CPU, "float32")),
        ({"amx": True}, (), Compute(CPU, "bfloat16")),
        ({"avx512_bf16": True}, (), Compute(CPU, "bfloat16")),
        ({"cuda": True, "avx512_bf16": True}, (), Compute(CUDA, "float32")),
        ({"cuda": True, "cuda_bfloat16": True}, (), Compute(CUDA, "bfloat16")),
        ({"cuda": True, "cuda_bfloat16": True}, ("cuda", "float32"), Compute(CUDA, "float32")),
        ({}, ("cpu", "bfloat16"), Compute(CPU, "bfloat16")),
        ({}, ("cuda",), None),
    ],
)
def test_the_user_s_choice_is_taken_else_what_the_machine_has_and_a_missing_gpu_is_refused(
    machine, monkeypatch, abilities, wanted, chosen
):
    machine(**abilities)
    monkeypatch.setattr(torch.backends.cudnn, "allow_tf32", True)
    if chosen:
        assert select_device(*wanted) == chosen
        assert torch.backends.cudnn.allow_tf32 == (chosen.device == CPU)
    else:
        with pytest.raises(UserError, match="device is cuda"):
            select_device(*wanted)


@pytest.mark.parametrize(
    ("cores", "busy", "in_container", "torchs", "expected"),
    [
        (2, 2.0, 2, 2, 2),  # a quiet machine
        (2, 48.5, 2, 2, 1),  # one busy program
        (2, 100.0, 2, 2, 1),
        (64, 47.0, 2, 64, 2),
        (8, 0.0, 8, 4, 4),  # also said by a system that does not count
    ],
)
def test_there_is_a_thread_for_each_idle_core(
    monkeypatch, cores, busy, in_container, torchs, expected
):
    limits = []
    now = []
    monkeypatch.delenv("OMP_NUM_THREADS")
    monkeypatch.setattr(psutil, "cpu_count", lambda: cores)
    monkeypatch.setattr(psutil, "cpu_percent", lambda seconds: busy)
    monkeypatch.setattr(joblib, "cpu_count", lambda: in_container)
    monkeypatch.setattr(torch, "get_num_threads", lambda: torchs)
    monkeypatch.setattr(torch, "set_num_threads", now.append)
    monkeypatch.setattr(threadpoolctl, "threadpool_limits", limits.append)
    set_threads()
    assert now == limits == [expected]


def test_the_user_s_number_of_threads_stays(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setattr(psutil, "cpu_percent", None)  # nothing is measured
    before = torch.get_num_threads()
    set_threads()
    assert torch.get_num_threads() == before


@pytest.mark.parametrize(
    ("precision", "dtype"), [("float32", torch.float32), ("bfloat16", torch.bfloat16)]
)
def test_products_are_in_the_chosen_precision(precision, dtype):
    with Compute(CPU, precision).autocast():
        assert (torch.ones(4, 4) @ torch.ones(4, 4)).dtype == dtype
    assert (torch.ones(4, 4) @ torch.ones(4, 4)).dtype == torch.float32


def test_frames_fit_a_gpu_that_has_twice_their_bytes_free(machine):
    machine(cuda=True, free=200)
    assert [Compute(CUDA, "float32").fits(size) for size in (99, 100, 101)] == [True, True, False]
