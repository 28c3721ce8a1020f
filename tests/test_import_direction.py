"""Imports run one way along the road of a frame, and in no circle."""

import ast
import os
import subprocess
import sys
from graphlib import TopologicalSorter

import pytest

from tests.imports import ROOT, imported_modules

#: Folder -> the folders that it may import from; all may import the package's own files, "root".
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
    "evaluation": {"tables", "views", "systems", "live", "recognition"},
    "pages": {"readers", "tables", "frames", "members", "systems", "recognition", "evaluation"},
    "glove": set(),
}
# what may use all of the package: its commands, and what `from tactile_viewgcn import` gives
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
    """`tables` of tactile_viewgcn/tables/frames.py, `root` of tactile_viewgcn/files.py."""
    words = path.split("/")
    return words[1] if len(words) > 2 else "root"


def imported_paths(path):
    """The package's files that a file itself imports."""
    names = (name.replace(".", "/") for name in imported_modules(ROOT / path))
    return {
        file for name in names for file in (f"{name}.py", f"{name}/__init__.py") if file in FILES
    } - {path}


def test_every_file_imports_only_from_folders_before_its_own():
    wrong = {
        (path, target)
        for path in set(FILES) - ENTRANCES
        for target in imported_paths(path) - {"tactile_viewgcn/__init__.py"}
        if folder_of(target) not in ALLOWED[folder_of(path)] | {folder_of(path), "root"}
    }
    assert wrong == set()


def test_neither_folders_nor_files_import_each_other_in_a_circle():
    for graph in (ALLOWED, {path: imported_paths(path) for path in FILES}):
        assert list(TopologicalSorter(graph).static_order())


def test_the_package_knows_no_programs_and_benchmarks_know_neither_stages_nor_studies_nor_tests():
    benchmarks = [path.relative_to(ROOT).as_posix() for path in (ROOT / "benchmarks").rglob("*.py")]
    others = {"stages", "studies", "tests"}
    for paths, unknown in ((FILES, others | {"benchmarks"}), (benchmarks, others)):
        for path in paths:
            assert not unknown & {
                name.partition(".")[0] for name in imported_modules(ROOT / path)
            }, path


def test_only_a_named_pair_knows_mlflow_and_imports_it_in_functions_alone():
    know = {
        path
        for path in FILES
        if any(name.partition(".")[0] == "mlflow" for name in imported_modules(ROOT / path))
    }
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
    assert [
        path
        for path in FILES
        if folder_of(path) == folder and unknown & imported_modules(ROOT / path)
    ] == []
