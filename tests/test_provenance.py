"""Names of runs, the revision of their code, and the values that differ from git's params.yaml."""

import subprocess
import sys
from importlib.metadata import version

import numpy as np
import pytest

from tactile_viewgcn import provenance
from tactile_viewgcn.params import default_params, preset_changes, presets
from tactile_viewgcn.provenance import changed_params, git_revision, origin, peak_mb, run_name
from tactile_viewgcn.schema import flatten

WRITTEN = ("dvc.lock", "data/dvc.lock", "results/summary.json", "params.yaml")


BEST = {"model.system": "sensors", "model.members": "auto"}
STAG = "/home/me/blindfolded_lite/metadata.mat"


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({}, "simulated · view_gcn · published split"),
        ({"model.system": "mvcnn"}, "simulated · mvcnn · published split"),
        (
            {"finetune.lr": 1e-5, "views": 12},
            "simulated · view_gcn · published split · views=12 finetune.lr=1e-05",
        ),
        (
            BEST | {"data.source": "data/flex_glove", "split.by": "session"},
            "flex_glove · best · by session",
        ),
        (
            {
                "data.source": STAG,
                "split.by": "grasp",
                "split.folds": 6,
                "split.fold": 2,
                "seed": 7,
            },
            "blindfolded_lite · view_gcn · by grasp, fold 2 of 6 · seed=7",
        ),
        ({"data.source": "my/one table.csv"}, "one table · view_gcn · published split"),
    ],
)
def test_a_row_is_named_by_data_method_and_what_is_held_out_then_by_other_changes(changed, name):
    assert run_name("evaluate", flatten(default_params()) | changed, changed) == name


def test_every_preset_is_named_and_one_with_a_change_has_it_too():
    for preset in presets():
        values = flatten(default_params(tuple(preset_changes(preset))))
        assert run_name("evaluate", values, {}) == f"simulated · {preset} · published split"
    changed = {"finetune.epochs": 3}
    values = flatten(default_params((*preset_changes("kernels"), "finetune.epochs=3")))
    assert run_name("evaluate", values, changed).endswith(
        "kernels · published split · finetune.epochs=3"
    )


def test_the_run_of_a_stage_begins_with_the_stage():
    assert run_name("pretrain", {"pretrain.lr": 0.01}, {"pretrain.lr": 0.01}) == (
        "pretrain · pretrain.lr=0.01"
    )
    assert run_name("ingest", {"data.source": "data/lab"}, {}) == "ingest · lab"


def git(place, *words):
    identity = ("-c", "user.name=t", "-c", "user.email=t@localhost")
    subprocess.run(["git", *identity, *words], cwd=place, check=True, capture_output=True)


def test_changed_are_the_values_that_differ_from_those_of_head_whatever_the_file_says_now(tmp_path):
    values = {"views": 4, "lr": 5e-4, "model.backbone.width": 8, "new.key": 1}
    path = tmp_path / "params.yaml"
    path.write_text("views: 8\nlr: 5e-4\nmodel:\n  backbone:\n    width: 64\n")
    assert changed_params(values, path) == {}
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", "params.yaml")
    git(tmp_path, "commit", "-qm", "first")
    path.write_text("views: 4\n")
    assert changed_params(values, path) == {"views": 4, "model.backbone.width": 8}


def test_the_revision_says_whether_the_code_differs_and_what_every_run_writes_is_no_code(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert git_revision() == {}
    for name in ("code -> öl", *WRITTEN):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "first")
    for name in WRITTEN:
        (tmp_path / name).write_text("changed")
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / "dvc.lock").write_text("1")
    git(tmp_path, "add", "new/dvc.lock")  # as an experiment does
    clean = git_revision()
    assert len(clean["mlflow.source.git.commit"]) == 40 and clean["git.dirty"] == "false"
    git(tmp_path, "mv", "code -> öl", "new")
    assert git_revision() == clean | {"git.dirty": "true"}


def test_a_record_names_the_versions_that_were_used_and_none_of_a_package_that_is_not_here(
    monkeypatch,
):
    record = origin("evaluate")
    assert record["numpy"] == np.__version__
    for name in ("torch", "scikit-learn", "dvc", "mlflow"):
        assert record[name] == version(name)
    monkeypatch.setattr(provenance, "PACKAGES", ("numpy", "no-such-package"))
    record = origin("evaluate")
    assert record["numpy"] == np.__version__ and "no-such-package" not in record


@pytest.mark.parametrize(
    "allocate", [lambda size: len(b"\1" * size), "print(len(bytes([1]) * {}))".format]
)
def test_the_peak_of_memory_counts_what_was_freed_here_or_in_a_child(allocate):
    size = int(1e6 * (peak_mb() + 100))  # more than the peak so far
    if isinstance(code := allocate(size), str):
        subprocess.run([sys.executable, "-c", code], check=True)
    assert peak_mb() > size / 1e6
