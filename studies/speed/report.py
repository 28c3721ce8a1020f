"""The study's text: the machine, and a sentence above each table."""

import os
import platform
from pathlib import Path

import torch

from studies.results import markdown
from studies.speed.agreement import TOLERANCE
from tactile_viewgcn.compute import Compute


def machine(compute: Compute) -> str:
    """The processor, its cores, torch and its threads, the device and the precision of the fast path."""
    gpu = f"; {torch.cuda.get_device_name(compute.device)}" if compute.device.type == "cuda" else ""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return (
        f"{processor()}, {cores} cores, torch {torch.__version__} with {torch.get_num_threads()} threads{gpu}; "
        f"fast path on {compute.device.type} in {compute.precision}"
    )


def processor() -> str:
    """The model of the processor."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def text(compute: Compute, agreement: list[dict], recipe: list[dict]) -> str:
    """What stands above the table of pairs."""
    limits = " and ".join(f"more than {limit:g} in {name}" for name, limit in TOLERANCE.items())
    return f"""# What the fast paths gain

{machine(compute)}.

One network of a short training on the same view sets, against plain float32: `difference` is the largest difference
of a logit as a share of the largest logit, over the view sets that select the same views ({limits} is refused);
`of all` is that of all view sets, and `changed` counts the selected views that are others.

{markdown(agreement)}

The paper's recipe on STAG's size, not run but multiplied out from the medians below, against the released design: plain
float32, batches of 32 frames and of 20 view sets, every view of every view set through the backbone in every trial.

{markdown(recipe)}

Medians of rounds in which the works take turns: `ratio` is how many times as fast the fast path is (median of the
rounds' ratios), `of products` and `of convolutions` its rate against that of large matrix products in its precision and
of the backbone's convolutions alone in the same round, and a limit stands under `fast`; fine-tuning is a
fifth of five epochs, what the first does once included."""
