"""Free memory: of the machine, and what the limits of cgroups leave of it."""

from pathlib import Path

import pytest

from tactile_viewgcn import memory

GIGABYTE = 1e9
linux = pytest.mark.skipif(not Path("/proc/meminfo").exists(), reason="cgroups are Linux's")


def test_some_of_the_machine_s_memory_is_free():
    assert 1e6 < memory.free_memory() < 1e14


@linux
@pytest.mark.parametrize(
    ("line", "folder", "files"),
    [
        ("0::/job/step", "job", {"memory.max": "1000000000", "memory.stat": "anon 300000000\nfile 600000000\n"}),
        ("0::/job/step", "job/step", {"memory.max": "1000000000", "memory.stat": "anon 300000000\n"}),
        ("0::/", "", {"memory.max": "1000000000", "memory.stat": "anon 300000000\n"}),  # in a container
        (
            "4:memory:/job",
            "memory/job",
            {"memory.limit_in_bytes": "1000000000", "memory.stat": "cache 9\ntotal_rss 300000000\n"},
        ),
    ],
)
def test_the_limit_of_a_cgroup_counts_without_its_cache(tmp_path, monkeypatch, line, folder, files):
    (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (tmp_path / folder / name).write_text(text)
    (tmp_path / "own").write_text(f"9:name=systemd:/\n{line}\n")
    monkeypatch.setattr(memory, "CGROUPS", tmp_path)
    monkeypatch.setattr(memory, "OWN_CGROUPS", tmp_path / "own")
    assert memory.free_memory() == 0.7 * GIGABYTE
    assert memory.fits_memory(0.35 * GIGABYTE) and not memory.fits_memory(0.36 * GIGABYTE)
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "2")
    assert not memory.fits_memory(0.18 * GIGABYTE)


@linux
def test_a_cgroup_without_a_limit_changes_nothing(tmp_path, monkeypatch):
    (tmp_path / "memory.max").write_text("max\n")
    (tmp_path / "own").write_text("0::/\n")
    monkeypatch.setattr(memory, "CGROUPS", tmp_path)
    monkeypatch.setattr(memory, "OWN_CGROUPS", tmp_path / "own")
    available = next(line for line in Path("/proc/meminfo").read_text().splitlines() if "MemAvailable" in line)
    assert memory.free_memory() == pytest.approx(1024 * int(available.split()[1]), rel=0.2)
