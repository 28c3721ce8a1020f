"""This process: how it ends, its processor and memory."""

import platform
import re
import resource
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from tactile_viewgcn.messages import user_message


@contextmanager
def program(*, debug: bool = False) -> Iterator[None]:
    """Context of a whole program: an error that the user can correct ends it with exit code 1 and one line.

    SIGTERM, which `dvc queue kill` sends, ends it with code 143, as an exception, so that temporary files are removed.

    Args:
        debug: such an error keeps its traceback too.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        yield
    except Exception as error:
        message = user_message(error)
        if debug or message is None:
            raise
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the process ends already, and has to print why
        print(f"Error: {message}", file=sys.stderr)
        raise SystemExit(1) from None


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
