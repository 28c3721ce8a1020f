"""Which device computes, in which precision."""

from types import SimpleNamespace

import pytest
import torch

from tactile_viewgcn import device as compute
from tactile_viewgcn.device import Compute, keep_freed_memory, select_device
from tactile_viewgcn.errors import UserError


def pretend(monkeypatch, *, cuda=False, cuda_bfloat16=False, avx512_bf16=False, amx=False):
    """A machine that has these."""

    def supported(including_emulation=True):
        return cuda_bfloat16 or including_emulation

    monkeypatch.setattr(torch.cuda, "is_available", lambda: cuda)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", supported)
    monkeypatch.setattr(torch.cpu, "_is_avx512_bf16_supported", lambda: avx512_bf16)
    monkeypatch.setattr(torch.cpu, "_is_amx_tile_supported", lambda: amx)


@pytest.mark.parametrize(
    ("machine", "device", "precision"),
    [
        ({}, "cpu", "float32"),
        ({"avx512_bf16": True}, "cpu", "bfloat16"),
        ({"amx": True}, "cpu", "bfloat16"),
        ({"cuda": True, "avx512_bf16": True}, "cuda", "float32"),
        ({"cuda": True, "cuda_bfloat16": True}, "cuda", "bfloat16"),
    ],
)
def test_auto_takes_what_the_machine_has(monkeypatch, machine, device, precision):
    pretend(monkeypatch, **machine)
    chosen = select_device()
    assert (chosen.device.type, chosen.precision) == (device, precision)


def test_what_is_asked_for_is_taken(monkeypatch):
    pretend(monkeypatch, cuda=True, cuda_bfloat16=True, avx512_bf16=True)
    assert select_device("cpu", "float32") == Compute(torch.device("cpu"), "float32")
    assert select_device("cuda", "float32") == Compute(torch.device("cuda"), "float32")
    pretend(monkeypatch)
    assert select_device("cpu", "bfloat16").precision == "bfloat16"


def test_cuda_is_refused_where_there_is_none(monkeypatch):
    pretend(monkeypatch)
    with pytest.raises(UserError, match="device is cuda"):
        select_device("cuda")


@pytest.mark.parametrize(("precision", "dtype"), [("float32", torch.float32), ("bfloat16", torch.bfloat16)])
def test_products_are_in_the_chosen_precision(precision, dtype):
    with Compute(torch.device("cpu"), precision).autocast():
        assert (torch.ones(4, 4) @ torch.ones(4, 4)).dtype == dtype
    assert (torch.ones(4, 4) @ torch.ones(4, 4)).dtype == torch.float32


def test_freed_memory_is_kept_by_the_c_library_that_can(monkeypatch):
    calls = []
    monkeypatch.setattr(compute.ctypes, "CDLL", lambda _: SimpleNamespace(mallopt=lambda *call: calls.append(call)))
    keep_freed_memory()
    assert sorted(calls) == [(-4, 0), (-1, 2**31 - 1)]  # M_MMAP_MAX and M_TRIM_THRESHOLD of malloc.h
    monkeypatch.setattr(compute.ctypes, "CDLL", lambda _: SimpleNamespace())
    keep_freed_memory()  # another C library is left alone


class Card:
    """A compute of a device that is not there, with so many bytes free, and what is pinned and sent to it."""

    def __init__(self, monkeypatch, free):
        self.sent = []
        pretend(monkeypatch, cuda=True)
        monkeypatch.setattr(torch.cuda, "mem_get_info", lambda _: (free, 10 * free))
        monkeypatch.setattr(torch.Tensor, "pin_memory", lambda values: values)
        move = torch.Tensor.to

        def to(values, *target, **options):
            if target and target[0] == torch.device("cuda"):
                self.sent.append((tuple(values.shape), options.get("non_blocking", False)))
                return values
            return move(values, *target, **options)

        monkeypatch.setattr(torch.Tensor, "to", to)
        self.compute = Compute(torch.device("cuda"), "float32")


@pytest.mark.parametrize(("free", "sent"), [(2 * 96 + 1, [((2, 1, 3, 4), False)]), (2 * 96 - 2, [])])
def test_frames_go_to_a_card_where_they_fit_half_of_its_free_memory(monkeypatch, free, sent):
    card = Card(monkeypatch, free)
    card.compute.frames(torch.zeros(2, 3, 4))
    assert card.sent == sent


def test_rows_of_frames_that_did_not_fit_are_copied_without_waiting(monkeypatch):
    card = Card(monkeypatch, 0)
    rows = card.compute.gather(torch.arange(10.0).view(5, 2), torch.tensor([3, 1]))
    assert rows.tolist() == [[6, 7], [2, 3]]
    assert card.sent == [((2, 2), True)]


def test_on_the_processor_rows_are_taken_and_nothing_is_copied_twice():
    values, compute = torch.arange(10.0).view(5, 2), Compute(torch.device("cpu"), "float32")
    assert compute.gather(values, torch.tensor([3, 1])).tolist() == [[6, 7], [2, 3]]
    assert compute.to_device(values) is values


@pytest.mark.parametrize(("precision", "dtype"), [("float64", torch.float64), ("bfloat16", torch.float32)])
def test_weights_and_frames_are_in_float32_but_for_float64(precision, dtype):
    compute = Compute(torch.device("cpu"), precision)
    batch = compute.frames(torch.arange(24.0).view(2, 3, 4))
    assert compute.dtype == batch.dtype == dtype and batch.is_contiguous(memory_format=torch.channels_last)
    assert batch[1, 0].tolist() == torch.arange(12.0, 24.0).view(3, 4).tolist() and batch.shape == (2, 1, 3, 4)
