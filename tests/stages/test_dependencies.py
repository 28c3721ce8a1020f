"""The lists of dvc.yaml: code and keys of each stage, up to date, and as short as what the stage reads."""

from dataclasses import make_dataclass
from pathlib import Path

import pytest
import yaml

from stages.command import declared, given
from stages.dependencies import PIPELINES, imported_code, with_dependencies
from tactile_viewgcn.params import load
from tactile_viewgcn.schema import flatten

ROOT = Path(__file__).parents[2]
STAGES = {
    name: stage for file in PIPELINES for name, stage in yaml.safe_load((ROOT / file).read_text())["stages"].items()
}
PARAMS = load(ROOT / "params.yaml")


@pytest.mark.parametrize("file", PIPELINES)
def test_the_lists_are_up_to_date(file):
    text = (ROOT / file).read_text()
    assert with_dependencies(text, ROOT, PARAMS) == text, "stale: run `python -m stages.dependencies`"


def readers(path):
    """The stages whose code the file is."""
    return {name for name, stage in STAGES.items() if path in stage["deps"]}


@pytest.mark.parametrize(
    ("path", "stages"),
    [
        ("tactile_viewgcn/nn/graph.py", {"finetune", "evaluate"}),
        ("tactile_viewgcn/nn/${model.system}.py", {"finetune", "evaluate"}),
        ("tactile_viewgcn/nn/backbone.py", {"pretrain", "finetune", "evaluate"}),
        ("tactile_viewgcn/evaluation/report.py", {"evaluate"}),
        ("tactile_viewgcn/glove/contact.py", {"simulate"}),
        ("tactile_viewgcn/readers/stag_metadata.py", {"ingest"}),
        ("tactile_viewgcn/systems/__init__.py", {"needs"}),
        ("tactile_viewgcn/params.py", set()),
        ("tactile_viewgcn/conflicts.py", set()),
        ("tactile_viewgcn/tracking.py", set()),
        ("stages/command.py", set()),
    ],
)
def test_a_file_reruns_the_stages_that_use_it_alone(path, stages):
    assert readers(path) == stages


def test_no_system_of_another_name_is_a_dependency():
    named = {path for stage in STAGES.values() for path in stage["deps"] if path.startswith("tactile_viewgcn/nn/")}
    assert not named & {f"tactile_viewgcn/nn/{name}.py" for name in ("view_gcn", "mvcnn", "rotationnet", "conv_lstm")}


def test_imports_inside_functions_and_of_packages_are_followed(tmp_path):
    (tmp_path / "stages").mkdir()
    for name, text in {
        "a": "def f():\n    from stages import b\n",
        "b": "import stages.c\nimport numpy\n",
        "c": "",
        "d": "",
    }.items():
        (tmp_path / "stages" / f"{name}.py").write_text(text)
    assert imported_code("stages/a.py", tmp_path) == {"stages/a.py", "stages/b.py", "stages/c.py"}


def test_a_new_key_is_watched_by_the_stages_that_read_its_section_alone():
    cluster = make_dataclass("Cluster", [*vars(PARAMS.cluster), "colour"])(**vars(PARAMS.cluster), colour="red")
    params = make_dataclass("Params", list(vars(PARAMS)))(**vars(PARAMS) | {"cluster": cluster})
    text = (ROOT / "dvc.yaml").read_text()
    stages = yaml.safe_load(with_dependencies(text, ROOT, params))["stages"]
    assert {name for name, stage in stages.items() if "cluster.colour" in stage["params"]} == {"cluster"}
    before = yaml.safe_load(text)["stages"]
    assert {name for name in stages if stages[name]["params"] != before[name]["params"]} == {"cluster"}


def test_every_key_is_watched_by_a_stage():
    watched = {key for stage in STAGES.values() for key in stage["params"]}
    assert watched == set(flatten(PARAMS))


def test_a_stage_is_given_what_it_names_and_no_more():
    reads = ("seed", "model.backbone", "cluster.method", "cluster.restarts", "augment")
    namespace = given(PARAMS, reads)
    assert vars(namespace).keys() == {"seed", "model", "cluster", "augment"}
    assert vars(namespace.model) == {"backbone": PARAMS.model.backbone}
    assert vars(namespace.cluster) == {"method": PARAMS.cluster.method, "restarts": PARAMS.cluster.restarts}
    assert (namespace.seed, namespace.augment) == (PARAMS.seed, PARAMS.augment)
    keys = {f"model.backbone.{name}" for name in vars(PARAMS.model.backbone)} | {"cluster.method", "cluster.restarts"}
    assert declared(PARAMS, reads).keys() == keys | {"seed", "augment.gain", "augment.drop", "augment.shift"}


def test_dvc_runs_the_virtual_glove_in_the_root_and_its_output_is_the_sources_default():
    stage = STAGES["simulate"]
    place = (ROOT / "data" / "virtual" / stage["wdir"]).resolve()
    assert place == ROOT and PARAMS.data.source in stage["outs"] and f"--out {PARAMS.data.source} " in stage["cmd"]
