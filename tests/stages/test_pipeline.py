"""DVC runs the whole pipeline on tiny data in a clone."""

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
import yaml

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.params import load
from tests.glove_data import SMALL
from tests.stag_files import metadata, save_matlab5
from tests.stages.running import commit, copy_repository, ran, sh

# MLflow's own warnings
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]
ROOT = Path(__file__).parents[2]
WRITTEN = ("dvc.lock", "results/summary.json")  # kept in git
ALL = ["needs", "ingest", "preprocess", "cluster", "pretrain", "finetune", "evaluate"]


def stages_of(output):
    """Return the stages that ran, in the order of ALL.

    DVC chooses the order of stages that do not need each other.
    """
    return sorted(ran(output), key=ALL.index)


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """Return a repository with the files of this one and tiny data, reproduced and committed."""
    repository = tmp_path_factory.mktemp("clone") / "repository"
    copy_repository(repository, without=WRITTEN)
    tree = metadata(objects=4, recordings=2, frames=24)
    source = save_matlab5(repository.parent / "recordings.mat", tree)
    changes = (
        "split.by=source",
        "device=cpu",
        "precision=float32",
        "model.backbone.width=8",
        f"data.source={source}",
    )
    params = asdict(load(repository / "params.yaml", (*SMALL, *changes)))
    (repository / "params.yaml").write_text(yaml.safe_dump(params, sort_keys=False))
    commit(repository)
    assert stages_of(sh("dvc", "repro", cwd=repository)) == ALL
    status = sh("git", "status", "--porcelain", "-uall", cwd=repository)
    assert status.splitlines() == [f"?? {name}" for name in WRITTEN]
    sh("git", "add", *WRITTEN, cwd=repository)
    sh("git", "commit", "-qm", "results", cwd=repository)
    assert stages_of(sh("dvc", "repro", cwd=repository)) == []
    assert sh("git", "status", "--porcelain", cwd=repository) == ""
    return repository


def restore(repository):
    """Restore the committed files."""
    sh("git", "checkout", "-q", "--", ".", cwd=repository)
    sh("dvc", "checkout", "-q", cwd=repository)


def test_a_fresh_clone_shows_the_figures_of_its_commit_and_runs_without_a_warning(clone):
    fresh = clone.parent / "fresh"
    sh("git", "clone", "-q", clone, fresh, cwd=clone)
    for words in ("config user.name t", "config user.email t@localhost"):
        sh("git", *words.split(), cwd=fresh)
    (shown,) = json.loads(sh("dvc", "metrics", "show", "--json", cwd=fresh))[""]["data"].values()
    assert shown["data"] == json.loads((clone / "results" / "summary.json").read_text())
    output = sh(
        "sh", "-c", "dvc exp run -S views=2 2>&1", cwd=fresh, MLFLOW_TRACKING_URI="disabled"
    )
    warnings = [
        line for line in output.splitlines() if "WARNING" in line or "failed to load" in line
    ]
    assert stages_of(output) == ALL
    assert [line for line in warnings if "simulate" not in line and "/virtual/" not in line] == []
    table = sh("dvc", "exp", "show", "--only-changed", "--csv", cwd=fresh)
    columns = table.splitlines()[0].split(",")
    # six figures, one parameter and files, but not every parameter
    assert len(columns) < 24, " ".join(columns)


def test_a_system_without_a_backbone_is_not_pretrained_for_and_the_backbone_of_others_is_restored(
    clone,
):
    backbone = (clone / "models" / "backbone.pt").read_bytes()
    restored = "Stage 'pretrain' is cached - skipping run"
    again = ["needs", "finetune", "evaluate"]

    def switch_to(system, members="[kernel]", *options):
        changes = ("-S", f"model.system={system}", "-S", f"model.members={members}")
        return sh(
            "dvc", "exp", "run", *options, *changes, cwd=clone, MLFLOW_TRACKING_URI="disabled"
        )

    output = switch_to("sensors")
    assert stages_of(output) == ["needs", "cluster", "pretrain", "finetune", "evaluate"]
    assert "cluster: left out" in output and "pretrain: left out" in output
    output = switch_to("sensors", "[svm]")
    assert stages_of(output) == again
    assert "Stage 'pretrain' didn't change" in output
    output = switch_to("mvcnn")
    assert stages_of(output) == again and restored in output
    assert (clone / "models" / "backbone.pt").read_bytes() == backbone
    output = switch_to("sensors", "[trees]", "--temp")
    assert stages_of(output) == again and restored in output
    restore(clone)


def test_another_machine_gets_the_model_by_its_name_and_pulls_the_results(clone, tmp_path):
    published = tmp_path / "published"
    shutil.copytree(clone, published)
    sh("dvc", "remote", "add", "-d", "storage", tmp_path / "storage", cwd=published)
    sh("git", "commit", "-qam", "remote", cwd=published)
    sh("gto", "register", "classifier", "--version", "v0.1.0", cwd=published)
    sh("dvc", "push", cwd=published)
    # the remote is now the only source
    shutil.rmtree(published / ".dvc" / "cache")
    shutil.rmtree(published / "models")

    desk = tmp_path / "desk"
    desk.mkdir()
    sh("dvc", "artifacts", "get", published, "classifier", cwd=desk)
    model = (clone / "models" / "classifier.pt").read_bytes()
    assert (desk / "classifier.pt").read_bytes() == model
    classifier = TactileClassifier.load(desk / "classifier.pt")
    assert classifier.classes_.tolist() == classes_of(clone)

    fresh = tmp_path / "fresh"
    sh("git", "clone", "-q", published, fresh, cwd=tmp_path)
    assert not (fresh / "results" / "metrics.json").exists()
    sh("dvc", "pull", "dvc.yaml", cwd=fresh)
    for name in ("results/metrics.json", "results/predictions.npz", "models/classifier.pt"):
        assert (fresh / name).read_bytes() == (clone / name).read_bytes(), name


def classes_of(repository) -> list[str]:
    """Return the classes of a workspace's results."""
    with np.load(repository / "results" / "predictions.npz") as results:
        return results["classes"].tolist()
