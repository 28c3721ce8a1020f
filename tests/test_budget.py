"""The size of the project: whoever raises one of these numbers lowers another by as much."""

import pytest
import yaml

from tactile_viewgcn.schema import flatten
from tests.imports import ROOT, imported_files

#: most lines of Python in each folder of the package; "" is for the package's own files
LINES = {
    "": 1426,
    "evaluation": 412,
    "frames": 1285,
    "glove": 1472,
    "nn": 484,
    "pages": 767,
    "readers": 1220,
    "recognition": 1365,
    "sensors": 675,
    "systems": 632,
    "tables": 509,
    "training": 752,
    "views": 253,
}
FILES = 104  # of the package
TESTS = 12_501
BESIDE = 1_987  # lines of stages, studies and benchmarks together
ROAD = {"files": 73, "lines": 8_180}  # that the six stages of a frame import
KEYS, DVC_LINES = 66, 121  # of params.yaml and of dvc.yaml
WORDS, README_WORDS = 12_500, 900  # of README and manual together, and of README
STAGES = ("ingest", "preprocess", "cluster", "pretrain", "finetune", "evaluate")


def lines(paths):
    return sum(len(path.read_text().splitlines()) for path in paths)


@pytest.mark.parametrize("folder", LINES)
def test_lines_of_a_folder_of_the_package(folder):
    place = ROOT / "tactile_viewgcn"
    assert lines((place / folder).rglob("*.py") if folder else place.glob("*.py")) <= LINES[folder]


def test_folders_and_files_of_the_package():
    files = list((ROOT / "tactile_viewgcn").rglob("*.py"))
    assert len(files) <= FILES
    assert {path.relative_to(ROOT / "tactile_viewgcn").parts[0] for path in files if "presets" not in path.parts} == {
        *filter(None, LINES),
        *(path.name for path in (ROOT / "tactile_viewgcn").glob("*.py")),
    }


def test_lines_beside_the_package():
    assert lines((ROOT / "tests").rglob("*.py")) <= TESTS
    assert sum(lines((ROOT / name).rglob("*.py")) for name in ("stages", "studies", "benchmarks")) <= BESIDE


def test_the_road_of_a_frame():
    starts = [*(f"stages/{name}.py" for name in STAGES), "tactile_viewgcn/systems/view_gcn.py"]
    files = set().union(*(imported_files(start, {"tactile_viewgcn/__init__.py"}) for start in starts))
    assert len(files) <= ROAD["files"] and lines(ROOT / file for file in files) <= ROAD["lines"]


def test_keys_lines_and_words():
    assert len(flatten(yaml.safe_load((ROOT / "params.yaml").read_text()))) <= KEYS
    assert lines([ROOT / "dvc.yaml"]) <= DVC_LINES
    readme = len((ROOT / "README.md").read_text().split())
    assert readme <= README_WORDS
    assert readme + sum(len(path.read_text().split()) for path in (ROOT / "docs").glob("*.md")) <= WORDS
