"""This process: how long it has run, on what and with how much memory."""

import os
import platform
import re
import resource
import time
from pathlib import Path

LOADED = time.time()
LOST = (  # said by one of several processes, see `first_to_tell`
    "another process of this training has ended or does not answer, so all end; started again, the training goes on "
    "after its last whole epoch"
)


def seconds_since_start() -> float:
    """Seconds since this process began, imports included; outside Linux since this module was loaded."""
    try:
        uptime = float(Path("/proc/uptime").read_text().split()[0])
        ticks = Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]
    except OSError:
        return time.time() - LOADED
    return uptime - int(ticks) / os.sysconf("SC_CLK_TCK")


def launched() -> bool:
    """Whether `torchrun` started this process, alone or with others."""
    return "TORCHELASTIC_RUN_ID" in os.environ


def rank() -> int:
    """Number of this process among those that train together, from 0."""
    return int(os.environ["RANK"]) if launched() else 0


def first_to_tell() -> bool:
    """Whether no other process that `torchrun` started with this one has asked this before, to tell why it ends."""
    if not launched():
        return True
    try:  # a folder of theirs, which torchrun removes
        (Path(os.environ["TORCHELASTIC_ERROR_FILE"]).parents[1] / "told").touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


def processor() -> str:
    """The processor's name, as the system tells it."""
    info = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.*)", info.read_text()) if info.exists() else []
    return names[0] if names else platform.processor() or platform.machine()


def usable_cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def peak_mb() -> float:
    """The most memory that this process, or one that it started and that has ended, has held, in MB (10^6 bytes)."""
    status = Path("/proc/self/status")
    if status.exists():  # Linux, whose ru_maxrss would count the process that started this one
        (line,) = (line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        children = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
        return max(int(line.split()[1]), children) * 1024 / 1e6
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
