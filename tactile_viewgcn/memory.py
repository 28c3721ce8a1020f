"""How much memory is free, and whether data are held in it or stay in their file."""

import os
import re
from collections.abc import Iterator
from pathlib import Path

MAX_MEMORY_SHARE = 0.5  # data are held in memory, or on the device, if they take at most so much of what is free
CGROUPS, OWN_CGROUPS = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
#: of version 2 and of version 1: the file of the limit, that of what is used, and the line in it without cache
CGROUP_FILES = (("memory.max", "memory.stat", "anon"), ("memory.limit_in_bytes", "memory.stat", "total_rss"))


def fits_memory(size: float) -> bool:
    """Whether so many bytes, in each process that torchrun started, are at most a share of the free memory."""
    return size * int(os.environ.get("LOCAL_WORLD_SIZE", 1)) <= MAX_MEMORY_SHARE * free_memory()


def free_memory() -> float:
    """Bytes that this process can still take: of the machine, and of the limits of its cgroups (Slurm, Docker)."""
    info = Path("/proc/meminfo")
    if not info.exists():  # outside Linux
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else float("inf")
    free = 1024 * int(re.findall(r"MemAvailable:\s+(\d+)", info.read_text())[0])
    return min([free, *(limit - used for limit, used in _cgroup_limits())])


def _cgroup_limits() -> Iterator[tuple[float, float]]:
    """Limit, and bytes used, of each cgroup with a limit that this process is in, directly or not; cache is not used.

    Inside a container the cgroup's own folder may be the root of the file system of cgroups.
    """
    lines = OWN_CGROUPS.read_text().splitlines() if OWN_CGROUPS.exists() else []
    for _, kinds, place in (line.split(":", 2) for line in lines):
        group = CGROUPS / kinds / place.strip("/")
        for folder in (group, *group.parents):
            for limit, stat, used in CGROUP_FILES:
                value = (folder / limit).read_text().strip() if (folder / limit).exists() else "max"
                if value != "max":
                    yield float(value), float(re.findall(rf"^{used} (\d+)", (folder / stat).read_text(), re.M)[0])
