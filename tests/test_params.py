"""params.yaml, its presets, and what `load` refuses before any stage works."""

import ast
from pathlib import Path
from typing import get_args

import pytest
import yaml

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import PRESETS, load, preset_changes
from tactile_viewgcn.schema import flatten
from tactile_viewgcn.systems import System

ROOT = Path(__file__).parents[1]
FILE = ROOT / "params.yaml"
NO_SYSTEM = {"pooled_view"}  # its ViewSystem gives a system one view more: model.pooled_view, no choice of model.system


def params(*changes):
    return load(FILE, changes)


def refusal(*changes):
    """What `load` says is wrong."""
    with pytest.raises(UserError, match=r"params\.yaml: ") as caught:
        params(*changes)
    return str(caught.value)


def test_the_shipped_file_is_the_recipe_of_the_paper():
    values = flatten(params())
    recipe = {
        "views": 8,
        "preprocess.baseline": "auto",
        "preprocess.filter": "auto",
        "split.by": "source",
        "cluster.method": "kmeans",
        "cluster.scope": "object",
        "pretrain.epochs": 30,
        "pretrain.lr": 5e-3,
        "pretrain.weight_decay": 1e-4,
        "pretrain.momentum": 0.9,
        "pretrain.step_size": 10,
        "pretrain.batch": 32,
        "pretrain.noise": 0.015,
        "model.neighbours": 4,
        "finetune.epochs": 15,
        "finetune.lr_backbone": 1e-4,
        "finetune.lr": 5e-4,
        "finetune.batch": 20,
        "evaluate.trials": 10,
        "evaluate.protocols": ["object", "recording"],
    }
    assert {key: values[key] for key in recipe} == recipe


def test_every_value_of_the_file_is_in_the_typed_form():
    tree = yaml.safe_load(FILE.read_text())

    def leaves(branch, prefix):
        for key, value in branch.items():
            yield from leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else [(prefix + key, value)]

    assert flatten(params()) == dict(leaves(tree, ""))


def test_changes_set_the_keys_they_name_and_no_others():
    before, after = flatten(params()), flatten(params("views=12", "cluster.method=none", "model.neighbours=[3, 3, 2]"))
    changed = {key: value for key, value in after.items() if value != before[key]}
    assert changed == {"views": 12, "cluster.method": "none", "model.neighbours": [3, 3, 2]}


def test_the_last_of_two_changes_of_a_key_counts():
    assert params("views=12", "views=20").views == 20


@pytest.mark.parametrize("key", sorted(flatten(params())))
def test_every_key_refuses_a_value_of_another_type(key):
    """A mapping is allowed nowhere; a text that is no choice only where any text is."""
    assert f"{key} is " in refusal(f"{key}={{a: 1}}")
    if key == "data.source":
        assert params(f"{key}=zzz").data.source == "zzz"
    else:
        assert f"{key} is 'zzz'; expected " in refusal(f"{key}=zzz")


@pytest.mark.parametrize(
    "change",
    [
        "views=0",
        "views=1001",
        "seed=-1",
        "seed=4294967296",
        "pretrain.epochs=-1",
        f"pretrain.epochs={'9' * 400}",
        "pretrain.lr=0",
        "pretrain.lr=.nan",
        "pretrain.lr=1.0e+39",
        "pretrain.momentum=1",
        "preprocess.quiet_share=0",
        "split.folds=1",
        "model.system=foo",
        "model.neighbours=[3, 0]",
        "evaluate.protocols=[]",
        "augment.shift=9",
    ],
)
def test_a_value_out_of_its_range_is_refused(change):
    assert f"{change.split('=')[0]} is " in refusal(change)


def test_several_mistakes_are_listed_at_once():
    text = refusal("views=0", "cluster.scop=recording", "pretrain.lr=-1", "evaluate.trials=ten", "views.count=3")
    for part in ("views is", "did you mean cluster.scope?", "pretrain.lr is -1", "evaluate.trials is 'ten'"):
        assert part in text


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        (("split.folds=4", "split.fold=4"), "split.fold split.folds"),
        (("viewpoints=cube", "views=12"), "viewpoints views"),
        (("viewpoints=dodecahedron", "views=8"), "viewpoints views"),
        (("preprocess.baseline=none", "preprocess.filter=contact"), "preprocess.filter preprocess.baseline"),
        (("cluster.assignment=area", "cluster.method=none"), "cluster.assignment cluster.method"),
        (("cluster.assignment=matched", "cluster.method=none"), "cluster.assignment cluster.method"),
        (("model.system=gvcnn", "model.backbone.kind=perceptron"), "model.system model.backbone.kind"),
        (("model.system=conv_lstm", "model.backbone.kind=perceptron"), "model.system model.backbone.kind"),
        (("finetune.num_views=random", "model.selector=joint"), "model.selector finetune.num_views"),
        (("evaluate.confidence_threshold=0.9", "finetune.num_views=random"), "confidence_threshold split.validation"),
        (("evaluate.confidence_threshold=0.9", "split.validation=0.2"), "confidence_threshold finetune.num_views"),
        (("model.system=rotationnet", "model.assignments=rotations", "views=12"), "model.assignments views"),
        (
            ("model.system=rotationnet", "model.assignments=rotations", "viewpoints=circle"),
            "model.assignments viewpoints",
        ),
    ],
)
def test_values_that_do_not_go_together_are_refused(changes, keys):
    text = refusal(*changes)
    assert "expected" in text or "which has" in text
    assert all(key in text for key in keys.split())


def test_a_refusal_says_why_and_all_that_is_expected():
    frame = refusal("split.by=frame", "split.validation=0.2")
    assert frame.endswith(
        "split.by is frame, which leaks, and split.validation is 0.2: expected 0, or another split.by"
    )
    cube = refusal("model.system=rotationnet", "model.assignments=rotations", "views=12")
    assert cube.endswith("which needs the cube: expected views 8 and viewpoints cube, or assignments any")


@pytest.mark.parametrize(
    "changes",
    [
        ("split.folds=4", "split.fold=3"),
        ("viewpoints=dodecahedron", "views=20"),
        ("viewpoints=circle", "views=7"),
        *(("cluster.method=none", f"cluster.assignment={name}") for name in ("index", "anchor", "random")),
        *(("cluster.method=kmeans", f"cluster.assignment={name}") for name in ("area", "matched")),
        *(("model.backbone.kind=perceptron", f"model.system={name}") for name in ("view_gcn", "stag", "cnn_lstm")),
        *(("model.backbone.kind=resnet", f"model.system={name}") for name in ("gvcnn", "conv_lstm")),
        ("evaluate.confidence_threshold=0.9", "finetune.num_views=random", "split.validation=0.2"),
        ("model.system=rotationnet", "model.assignments=rotations"),
        ("model.assignments=rotations", "views=12"),
    ],
)
def test_values_that_go_together_are_allowed(changes):
    values = flatten(params(*changes))
    assert all(str(values[key]) == value for key, value in (change.split("=") for change in changes))


def test_the_systems_are_the_files_that_define_one():
    """A file of nn/ with a class that is never a base, and derives from ViewSystem."""
    bases, of_file = {}, {}
    for path in (ROOT / "tactile_viewgcn" / "nn").glob("*.py"):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef):
                bases[node.name], of_file[node.name] = {ast.unparse(base) for base in node.bases}, path.stem

    def derives(name):
        return "ViewSystem" in bases.get(name, ()) or any(map(derives, bases.get(name, ())))

    leaves = {name for name in bases if derives(name)} - set().union(*bases.values())
    assert {of_file[name] for name in leaves} == set(get_args(System)) | NO_SYSTEM


@pytest.mark.parametrize("system", get_args(System))
def test_fewer_views_go_with_the_systems_that_take_them(system):
    from tactile_viewgcn.systems import system_class

    changes = ("finetune.num_views=random", f"model.system={system}")
    if system_class(system).takes_fewer:
        assert params(*changes).model.system == system
    else:
        assert f"model.system is {system}" in refusal(*changes)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_allowed_and_changes_the_values_it_names(name):
    path = ROOT / "tactile_viewgcn" / "presets" / f"{name}.yaml"
    changes, default = preset_changes(name), flatten(params())
    values = flatten(params(*changes))
    expected = yaml.safe_load(path.read_text())
    assert {key: values[key] for key in expected} == expected
    assert {key for key in values if values[key] != default[key]} <= expected.keys()
    assert values != default and path.read_text().startswith("# ")


def test_the_presets_are_the_files_of_their_folder():
    assert {path.stem for path in (ROOT / "tactile_viewgcn" / "presets").glob("*.yaml")} == set(PRESETS)


@pytest.mark.parametrize("name", PRESETS)
def test_a_presets_changes_are_words_that_a_shell_does_not_split(name):
    assert all(len(change.split()) == 1 for change in preset_changes(name))
    if name == "released":
        assert {"model.neighbours=[3,3,2]", "finetune.backbone_dropout=false"} <= set(preset_changes(name))


def test_a_missing_key_is_named(tmp_path):
    lines = FILE.read_text().splitlines(keepends=True)
    path = tmp_path / "short.yaml"
    path.write_text("".join(line for line in lines if not line.startswith(("views:", "  trials:"))))
    with pytest.raises(UserError, match=r"short\.yaml: .*missing key evaluate\.trials.*missing key views"):
        load(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.yaml"):
        load(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize("content", [b"views: [1", b"- views\n", b"", b"views: \xff\xfe"])
def test_a_file_that_is_no_mapping_is_refused(tmp_path, content):
    (tmp_path / "p.yaml").write_bytes(content)
    with pytest.raises(UserError, match=r"p\.yaml: (not YAML|expected keys and values)"):
        load(tmp_path / "p.yaml")


@pytest.mark.stability("batches of one")
@pytest.mark.parametrize("key", ["pretrain.batch", "finetune.batch"])
def test_batches_of_one_from_which_batch_normalisation_learns_nothing_are_refused(row, key):
    row.refused(f"{key} of 1", lambda: load(FILE, (f"{key}=1",)), rf"{key} is 1; expected an integer in \[2")
