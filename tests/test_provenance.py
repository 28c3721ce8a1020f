"""Names of runs: what differs from the params.yaml that git holds."""

import subprocess

import pytest

from tactile_viewgcn.provenance import MOST_FILES, committed_params, git_revision, run_name

WRITTEN = ("dvc.lock", "data/dvc.lock", "results/summary.json")
COMMITTED = {"views": 8, "pretrain.lr": 5e-3, "finetune.lr": 5e-4, "glove.objects": "all", "x.flag": True}


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({}, "mvcnn V=8"),
        ({"pretrain.lr": 0.01}, "pretrain.lr=0.01 mvcnn V=8"),
        ({"finetune.lr": 1e-5, "x.flag": False}, "x.flag=false finetune.lr=1e-05 mvcnn V=8"),
        ({"glove.objects": ["ball", "mug"]}, "glove.objects=[ball,mug] mvcnn V=8"),
        ({"views": 4}, "V=4 mvcnn"),
        ({"pretrain.lr": 0.01, "views": 4}, "V=4 pretrain.lr=0.01 mvcnn"),
        ({"new.key": 1}, "mvcnn V=8"),
    ],
)
def test_a_run_is_named_by_what_differs_first(changes, name):
    values = COMMITTED | changes
    assert run_name(values, COMMITTED, {"model.system": "mvcnn", "views": f"V={values['views']}"}) == name


def git(place, *words):
    identity = ("-c", "user.name=t", "-c", "user.email=t@localhost")
    subprocess.run(["git", *identity, *words], cwd=place, check=True, capture_output=True)


def test_the_committed_values_are_those_of_head_whatever_the_file_says_now(tmp_path):
    path = tmp_path / "params.yaml"
    path.write_text("views: 8\nlr: 5e-4\nmodel:\n  backbone:\n    width: 64\n")
    assert committed_params(path) == {}
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", "params.yaml")
    git(tmp_path, "commit", "-qm", "first")
    path.write_text("views: 4\n")
    assert committed_params(path) == {"views": 8, "lr": 5e-4, "model.backbone.width": 64}


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """The working folder, with files that are committed."""
    monkeypatch.chdir(tmp_path)
    assert git_revision() == {}
    for name in ("a, b", "moved -> here", "öl", *WRITTEN, *map(str, range(MOST_FILES))):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "first")
    return tmp_path


def test_the_revision_names_the_changed_files_whole_whatever_their_names(repository):
    clean = git_revision()
    assert len(clean["mlflow.source.git.commit"]) == 40 and clean["git.dirty"] == "false" and "git.changed" not in clean
    for name in ("a, b", "öl"):
        (repository / name).write_text("changed")
    git(repository, "mv", "moved -> here", "new")
    assert git_revision() == clean | {"git.dirty": "true", "git.changed": "a, b\nmoved -> here\nnew\nöl"}
    for number in range(MOST_FILES):
        (repository / str(number)).write_text("changed")
    listed = git_revision()["git.changed"].split("\n")
    assert len(listed) == MOST_FILES + 1 and listed[-1] == "and 4 more"


def test_what_every_run_writes_is_no_change(repository):
    for name in WRITTEN:
        (repository / name).write_text("changed")
    (repository / "new").mkdir()
    (repository / "new" / "dvc.lock").write_text("1")
    git(repository, "add", "new/dvc.lock")  # as an experiment does
    assert git_revision()["git.dirty"] == "false" and "git.changed" not in git_revision()
