"""This process: its run time, processor and memory."""

import os
import platform
import re
import resource
import sys
import time
from contextlib import suppress
from pathlib import Path

LOADED = time.time()


def seconds_since_start() -> float:
    """Seconds since this process began, with imports; outside Linux since this module was loaded."""
    with suppress(OSError):
        uptime = float(Path("/proc/uptime").read_text().split()[0])
        ticks = Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19]
        return uptime - int(ticks) / os.sysconf("SC_CLK_TCK")
    return time.time() - LOADED


def idle_cores(seconds: float = 0.3) -> float:
    """Cores that no program uses during the next `seconds`; infinite where the system does not say.

    The load average would still count the stage before, which has ended.
    """
    readings = []
    with suppress(OSError):
        for pause in (seconds, 0.0):
            readings.append(float(Path("/proc/uptime").read_text().split()[1]))  # seconds idled, summed over cores
            time.sleep(pause)
    before, after = readings or (0.0, 0.0)
    return (after - before) / seconds if after else float("inf")  # some sandboxes always say 0


def processor() -> str:
    """The processor's name."""
    info = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.*)", info.read_text()) if info.exists() else []
    return names[0] if names else platform.processor() or platform.machine()


def peak_mb() -> float:
    """Peak memory, in MB (10^6 bytes), of this process or of a child process that has ended, whichever is larger."""
    peak, children = (resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    with suppress(OSError):  # on Linux ru_maxrss of this process also counts its parent's memory
        peak = int(re.findall(r"VmHWM:\s*(\d+)", Path("/proc/self/status").read_text())[0])
    return max(peak, children) * (1 if sys.platform == "darwin" else 1024) / 1e6
