"""For each stage, dvc.yaml names the code that it imports and the parameters that it reads."""

import ast

import pytest

from stages.pipeline import params_of, stages
from tactile_viewgcn.params import load
from tactile_viewgcn.schema import flatten
from tests.imports import ROOT, imported_files

STAGES = stages()
PARAMS = load(ROOT / "params.yaml")
SYSTEM = "tactile_viewgcn/systems/${model.system}.py"
SYSTEMS = sorted(path.stem for path in (ROOT / "tactile_viewgcn" / "systems").glob("[!_]*.py"))
#: Files that change results by rounding errors at most. They start a stage, store and show results,
#: or report mistakes.
NEUTRAL = {
    "stages/command.py",
    "stages/job.py",
    "stages/pipeline.py",
    *(path.relative_to(ROOT).as_posix() for path in ROOT.glob("*/**/__init__.py")),
} | {
    f"tactile_viewgcn/{name}.py"
    for name in (
        *("params", "schema", "messages", "files", "training/checkpoint"),
        *("device", "provenance", "tracking", "mlflow_store", "plots", "progress"),
        *("pages/card", "pages/checks", "pages/html", "pages/run_page"),
    )
}


def stages_with_systems():
    """Return the names of stages and systems; a stage that loads no system has "" for it."""
    cases = []
    for name, stage in STAGES.items():
        systems = SYSTEMS if SYSTEM in stage["deps"] else [""]
        cases += [(name, system) for system in systems]
    return cases


CASES = stages_with_systems()


def watched(name, system=""):
    """Return the files and folders of code that the `deps` of a stage name."""
    deps = [dep.replace("${model.system}", system) for dep in STAGES[name]["deps"]]
    return [dep for dep in deps if dep.startswith(("stages", "tactile_viewgcn"))]


def is_below(file, deps):
    return any(file == dep or file.startswith(f"{dep}/") for dep in deps)


def imported(name, system=""):
    """Return the code that changes a stage's result."""
    files = set(imported_files(f"stages/{name}.py", NEUTRAL))
    if system:
        files |= imported_files(SYSTEM.replace("${model.system}", system), NEUTRAL)
    return files


@pytest.mark.parametrize(("name", "system"), CASES)
def test_what_a_stage_imports_lies_in_its_deps(name, system):
    deps = watched(name, system)
    assert {file for file in imported(name, system) if not is_below(file, deps)} == set()


def test_what_is_exempt_is_there():
    assert [name for name in NEUTRAL if not (ROOT / name).is_file()] == []


@pytest.mark.parametrize("name", STAGES)
def test_every_dep_is_there_and_imported(name):
    files = set(imported_files(f"stages/{name}.py", {"tactile_viewgcn/__init__.py"}))
    for stage, system in CASES:
        if stage == name:
            files |= imported(name, system)
    for dep in watched(name, "view_gcn"):
        if dep.endswith(".yaml"):  # a preset
            continue
        assert (ROOT / dep).exists(), dep
        assert any(is_below(file, [dep]) for file in files), dep
    # not the code of another system
    assert not is_below("tactile_viewgcn/systems/mvcnn.py", watched(name, "view_gcn"))


def test_package_files_that_no_dep_names_hold_a_docstring_alone():
    for path in (ROOT / "tactile_viewgcn").glob("*/__init__.py"):
        assert len(ast.parse(path.read_text()).body) == 1 or path.parent.name == "systems", path


def test_every_parameter_is_watched_by_a_stage():
    keys = [f"{key}." for stage in STAGES.values() for key in stage["params"]]
    assert [key for key in flatten(PARAMS) if not f"{key}.".startswith(tuple(keys))] == []


def test_a_stage_has_the_parameters_that_it_names_and_no_others():
    reads = ["seed", "model.backbone", "cluster.method", "cluster.restarts", "split"]
    only = params_of({"params": reads}, PARAMS)
    assert vars(only).keys() == {"seed", "model", "cluster", "split"}
    assert vars(only.model) == {"backbone": PARAMS.model.backbone}
    assert vars(only.cluster) == {
        "method": PARAMS.cluster.method,
        "restarts": PARAMS.cluster.restarts,
    }
    assert (only.seed, only.split) == (PARAMS.seed, PARAMS.split)
