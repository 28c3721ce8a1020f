"""The operators that a training step spends the processor's time in."""

from collections.abc import Callable

from torch.autograd.profiler import profile

STEPS, LARGEST = 3, 8  # steps that are profiled, operators that are shown


def operator_rows(steps: dict[str, Callable[[], None]]) -> list[dict]:
    """A row for each of the operators that take most of the first step's time, and one for all others.

    Each step has its milliseconds in an operator, children excluded, and their share of the step. They are the
    processor's: of a step on a card they would be those of launching its kernels.

    Args:
        steps: training steps by name.
    """
    spent = {name: operator_times(step) for name, step in steps.items()}
    first = next(iter(spent.values()))
    largest = sorted(first, key=lambda operator: first[operator], reverse=True)[:LARGEST]
    rows = [{"operator": operator} for operator in (*largest, "all others")]
    for name, times in spent.items():
        total = sum(times.values())
        shown = {operator: times.get(operator, 0.0) for operator in largest}
        shown["all others"] = total - sum(shown.values())
        for row in rows:
            time = shown[row["operator"]]
            row |= {f"{name}, ms": time, f"{name}, %": 100 * time / total}
    return rows


def operator_times(step: Callable[[], None]) -> dict[str, float]:
    """Milliseconds of a step in each operator, children excluded, after a first step that is not counted."""
    step()
    with profile() as record:
        for _ in range(STEPS):
            step()
    return {each.key.removeprefix("aten::"): each.self_cpu_time_total / 1e3 / STEPS for each in record.key_averages()}
