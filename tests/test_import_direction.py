"""Imports run one way along the road of a frame, and in no circle."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.imports import imported_modules

ROOT = Path(__file__).parents[1]
PROGRAMS = {"stages", "studies", "benchmarks"}

#: Folder -> the folders that it may import from. "root": the files of tactile_viewgcn itself.
ALLOWED = {
    "root": {"root"},
    "recordings": {"root"},
    "glove": {"recordings", "root"},
    "frames": {"recordings", "root"},
    "views": {"frames", "recordings", "root"},
    "nn": {"root"},
    "training": {"nn", "views", "frames", "recordings", "root"},
    "recognition": {"training", "nn", "views", "frames", "recordings", "root"},
    "evaluation": {"recognition", "nn", "views", "frames", "recordings", "root"},
}
# what may use all of the package: its commands, and what `from tactile_viewgcn import` gives
ENTRANCES = {"tactile_viewgcn/__init__.py", "tactile_viewgcn/cli.py", "tactile_viewgcn/__main__.py"}
KNOWS_MLFLOW = "tactile_viewgcn/tracking.py"
FILES = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "tactile_viewgcn").rglob("*.py"))
BENCHMARKS = sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / "benchmarks").rglob("*.py"))


def folder_of(module: str) -> str:
    """`recordings` of tactile_viewgcn.tables.recordings, `root` of tactile_viewgcn.files."""
    words = module.split(".")
    return words[1] if len(words) > 1 and words[1] in ALLOWED else "root"


@pytest.mark.parametrize("path", [path for path in FILES if path not in ENTRANCES])
def test_a_file_imports_only_from_folders_before_its_own(path):
    here = folder_of(path.removesuffix(".py").replace("/", "."))
    imports = imported_modules(ROOT / path)
    targets = {folder_of(name) for name in imports if name.startswith("tactile_viewgcn.")}
    assert targets <= ALLOWED[here] | {here}
    assert not PROGRAMS & {name.partition(".")[0] for name in imports}


@pytest.mark.parametrize("path", BENCHMARKS)
def test_benchmarks_import_neither_stages_nor_studies_nor_tests(path):
    assert not {"stages", "studies", "tests"} & {name.partition(".")[0] for name in imported_modules(ROOT / path)}


@pytest.mark.parametrize("path", [path for path in FILES if path != KNOWS_MLFLOW])
def test_only_tracking_knows_mlflow(path):
    assert not {name for name in imported_modules(ROOT / path) if name.partition(".")[0] == "mlflow"}


def test_tracking_imports_mlflow_in_functions_alone():
    tree = ast.parse((ROOT / KNOWS_MLFLOW).read_text())
    names = {ast.unparse(node) for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)}
    assert not any("mlflow" in name for name in names)
    assert "mlflow" in {name.partition(".")[0] for name in imported_modules(ROOT / KNOWS_MLFLOW)}


def test_the_package_and_its_commands_load_neither_torch_nor_mlflow():
    code = "import sys, tactile_viewgcn, tactile_viewgcn.params, tactile_viewgcn.cli, tactile_viewgcn.tracking\n"
    code += "loaded = {'torch', 'mlflow', 'sklearn'} & set(sys.modules)\nassert not loaded, loaded"
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.parametrize("path", [path for path in FILES if "/nn/" in path])
def test_networks_know_no_file_and_no_dvc(path):
    assert not {"h5py", "pathlib", "dvc", "csv", "json"} & imported_modules(ROOT / path)


def test_no_files_import_each_other_in_a_circle():
    modules = {path.removesuffix(".py").removesuffix("/__init__").replace("/", "."): path for path in FILES}
    graph = {module: imported_modules(ROOT / path) & set(modules) - {module} for module, path in modules.items()}
    assert list(TopologicalSorter(graph).static_order())
