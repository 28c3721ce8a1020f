"""Where the time of a training step goes: its operators, of the pipeline and of the plain network."""

from collections.abc import Callable

import torch
from torch.autograd.profiler import profile

STEPS, LARGEST = 3, 8  # steps that are profiled, operators that are shown


def step_profile(steps: dict[str, Callable[[], None]]) -> list[dict]:
    """A row for each of the operators that take most of the first step's time, and one for all others.

    Each step has its milliseconds in an operator, children excluded, and their share of the step. On a CUDA card they
    are the card's.

    Args:
        steps: training steps by name.
    """
    spent = {name: operators(step) for name, step in steps.items()}
    first = next(iter(spent.values()))
    largest = sorted(first, key=lambda operator: first[operator], reverse=True)[:LARGEST]
    rows = [{"operator": operator} for operator in (*largest, "all others")]
    for name, times in spent.items():
        total = sum(times.values())
        for row in rows:
            chosen = (
                [row["operator"]] if row["operator"] in largest else [each for each in times if each not in largest]
            )
            time = sum(times.get(each, 0.0) for each in chosen)
            row |= {f"{name}, ms": time, f"{name}, %": 100 * time / total}
    return rows


def operators(step: Callable[[], None]) -> dict[str, float]:
    """Milliseconds of a step in each operator, children excluded, after a first step that is not counted."""
    step()
    cuda = torch.cuda.is_available()
    with profile(use_device="cuda" if cuda else None) as record:
        for _ in range(STEPS):
            step()
    key = "self_device_time_total" if cuda else "self_cpu_time_total"
    return {each.key.removeprefix("aten::"): getattr(each, key) / 1e3 / STEPS for each in record.key_averages()}
