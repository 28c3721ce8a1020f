"""Imports run one way along the road of a frame, and in no circle."""

import ast
import os
import subprocess
import sys
from graphlib import TopologicalSorter

import pytest

from tests.imports import ROOT, imported_modules

#: The folders that each folder may import from. All may import the package's own files, "root".
ALLOWED = {
    "root": set(),
    "readers": set(),
    "tables": {"readers"},
    "frames": {"readers", "tables"},
    "views": {"tables"},
    "nn": set(),
    "members": set(),
    "systems": {"nn", "members"},
    "training": {"tables", "views", "nn", "systems"},
    "live": {"readers", "tables", "frames"},
    "recognition": {"readers", "tables", "frames", "views", "nn", "members", "systems", "training"}
    | {"live"},
    "evaluation": {"tables", "frames", "views", "systems", "live", "recognition"},
    "pages": {"readers", "tables", "frames", "members", "systems", "recognition", "evaluation"},
    "glove": set(),
}
# may use all of the package: the names that it exports, and its commands
ENTRANCES = {"tactile_viewgcn/__init__.py", "tactile_viewgcn/cli.py"}
# the first logs runs, the second has the store's address and reads models and files back
KNOW_MLFLOW = {
    "tactile_viewgcn/tracking.py",
    "tactile_viewgcn/mlflow_store.py",
    "tactile_viewgcn/recognition/mlflow_model.py",  # the exception that MLflow's server answers
}
FILES = sorted(
    path.relative_to(ROOT).as_posix() for path in (ROOT / "tactile_viewgcn").rglob("*.py")
)


def folder_of(path):
    """Return the folder of a file, or `root` for a file of the package itself."""
    words = path.split("/")
    return words[1] if len(words) > 2 else "root"


def imported_paths(path):
    """Return the package's files that a file imports itself."""
    imported = set()
    for name in imported_modules(ROOT / path):
        place = name.replace(".", "/")
        imported |= {f"{place}.py", f"{place}/__init__.py"}
    return imported.intersection(FILES) - {path}


def top_level_names(path):
    """Return the names of the packages that a file imports, such as `mlflow`."""
    return {name.partition(".")[0] for name in imported_modules(ROOT / path)}


def test_every_file_imports_only_from_folders_before_its_own():
    wrong = []
    for path in set(FILES) - ENTRANCES:
        allowed = ALLOWED[folder_of(path)] | {folder_of(path), "root"}
        for target in imported_paths(path) - {"tactile_viewgcn/__init__.py"}:
            if folder_of(target) not in allowed:
                wrong.append((path, target))
    assert wrong == []


def test_neither_folders_nor_files_import_each_other_in_a_circle():
    files = {path: imported_paths(path) for path in FILES}
    for graph in (ALLOWED, files):
        assert list(TopologicalSorter(graph).static_order())


def test_the_package_knows_no_programs_and_benchmarks_know_neither_stages_nor_studies_nor_tests():
    benchmarks = [path.relative_to(ROOT).as_posix() for path in (ROOT / "benchmarks").rglob("*.py")]
    others = {"stages", "studies", "tests"}
    for path in FILES:
        assert not top_level_names(path) & (others | {"benchmarks"}), path
    for path in benchmarks:
        assert not top_level_names(path) & others, path


def test_only_the_named_files_know_mlflow_and_they_import_it_only_in_functions():
    know = {path for path in FILES if "mlflow" in top_level_names(path)}
    assert know == KNOW_MLFLOW
    for path in KNOW_MLFLOW:
        for node in ast.parse((ROOT / path).read_text()).body:
            names = []
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module]
            assert not any(name.partition(".")[0] == "mlflow" for name in names), path


def test_the_package_its_commands_the_sensors_and_the_virtual_glove_load_neither_torch_nor_mlflow():
    code = (
        "import sys, tactile_viewgcn.params, tactile_viewgcn.cli, tactile_viewgcn.tracking\n"
        "import stages.simulate\n"
        "import tactile_viewgcn.systems.sensors\n"
        "from tactile_viewgcn.messages import user_message\n"
        "from tactile_viewgcn.provenance import Record\n"
        "assert 'out of memory' in user_message(MemoryError())\n"
        "assert user_message(RuntimeError('x')) is None\n"
        "with tactile_viewgcn.tracking.stage_run(Record('ingest')) as run:\n"
        "    run.log('log_metrics', {'a': 1})\n"
        "    run.dataset('a', 'b')\n"
        "    run.log('log_params', {'a': 1})\n"
        "    assert run.id is None\n"
        "loaded = {'torch', 'mlflow', 'sklearn', 'matplotlib'} & set(sys.modules)\n"
        "assert not loaded, loaded"
    )
    environment = os.environ | {"MLFLOW_TRACKING_URI": "disabled"}
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, env=environment)


@pytest.mark.parametrize("folder", ["nn", "members", "systems"])
def test_building_blocks_know_no_file_and_no_dvc(folder):
    unknown = {"h5py", "pathlib", "dvc", "csv", "json"}
    files = [path for path in FILES if folder_of(path) == folder]
    assert files
    assert [path for path in files if unknown & imported_modules(ROOT / path)] == []
