"""The typed form of params.yaml."""

from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import get_args

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from tactile_viewgcn.params import Range, System, flat, load

FILE = Path(__file__).parents[1] / "params.yaml"


def params(*changes):
    return load(FILE, changes)


def mistakes(*changes):
    """What `load` says is wrong, without the file's name in front."""
    with pytest.raises(ValueError, match=r"params\.yaml: ") as caught:
        params(*changes)
    return str(caught.value).removeprefix(f"{FILE}: ").split("; ")


def test_the_shipped_file_is_the_recipe_of_the_paper():
    found = flat(params())
    recipe = {
        "views": 8,
        "preprocess.baseline": "empty_hand",
        "preprocess.filter": "flags",
        "split.by": "source",
        "cluster.method": "kmeans",
        "cluster.scope": "object",
        "pretrain.epochs": 30,
        "pretrain.lr": 5e-3,
        "pretrain.weight_decay": 1e-4,
        "pretrain.momentum": 0.9,
        "pretrain.halve_every": 10,
        "pretrain.batch": 32,
        "pretrain.noise": 0.015,
        "model.neighbours": 4,
        "finetune.epochs": 15,
        "finetune.lr_backbone": 1e-4,
        "finetune.lr": 5e-4,
        "finetune.batch": 20,
        "evaluate.trials": 10,
        "evaluate.scope": ["object", "recording"],
    }
    assert {key: found[key] for key in recipe} == recipe


def test_the_flat_form_has_every_value_of_the_file_under_its_dotted_key():
    tree = yaml.safe_load(FILE.read_text())

    def leaves(branch, prefix):
        for key, value in branch.items():
            yield from leaves(value, f"{prefix}{key}.") if isinstance(value, dict) else [(prefix + key, value)]

    expected = dict(leaves(tree, ""))
    assert "glove.effects.motion" in expected and "seed" in expected
    assert flat(params()) == expected


def test_changes_touch_the_keys_they_name_and_no_others():
    before, after = flat(params()), flat(params("views=12", "cluster.method=none", "model.neighbours=[3, 3, 2]"))
    changed = {key: value for key, value in after.items() if value != before[key]}
    assert changed == {"views": 12, "cluster.method": "none", "model.neighbours": [3, 3, 2]}


def test_the_last_of_two_changes_of_a_key_counts():
    assert params("views=12", "views=20").views == 20


def test_parameters_cannot_be_assigned_to():
    with pytest.raises(FrozenInstanceError):
        params().views = 3
    with pytest.raises(FrozenInstanceError):
        params().cluster.method = "none"


@pytest.mark.parametrize("text", ["5e-4", "0.0005", "5.0E-4"])
def test_a_number_may_be_written_with_or_without_a_point(text):
    assert params(f"finetune.lr={text}").finetune.lr == 0.0005


def test_a_whole_number_is_a_number_too():
    scale = params("preprocess.scale=100").preprocess.scale
    assert (scale, type(scale)) == (100.0, float)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("views=0", "views is 0; expected an integer in [1, 1000]"),
        ("views=eight", "views is 'eight'; expected an integer in [1, 1000]"),
        ("views=8.0", "views is 8.0; expected an integer in [1, 1000]"),
        ("views=true", "views is True; expected an integer in [1, 1000]"),
        ("views=", "views is None; expected an integer in [1, 1000]"),
        ("views=[8]", "views is [8]; expected an integer in [1, 1000]"),
        ("pretrain.epochs=-1", "pretrain.epochs is -1; expected an integer in [0, inf)"),
        ("pretrain.lr=0", "pretrain.lr is 0; expected a number in [1e-30, 1e+30]"),
        ("pretrain.lr=.nan", "pretrain.lr is nan; expected a number in [1e-30, 1e+30]"),
        ("pretrain.lr=.inf", "pretrain.lr is inf; expected a number in [1e-30, 1e+30]"),
        ("pretrain.lr=1.0e+39", "pretrain.lr is 1e+39; expected a number in [1e-30, 1e+30]"),
        ("pretrain.lr=fast", "pretrain.lr is 'fast'; expected a number in [1e-30, 1e+30]"),
        ("pretrain.momentum=1", "pretrain.momentum is 1; expected a number in [0, 1)"),
        ("pretrain.batch=1", "pretrain.batch is 1; expected an integer in [2, inf)"),
        ("preprocess.quiet_share=0", "preprocess.quiet_share is 0; expected a number in (0, 1]"),
        ("preprocess.empty_hand_class=1", "preprocess.empty_hand_class is 1; expected true or false"),
        ("split.folds=1", "split.folds is 1; expected an integer in [2, inf)"),
        ("data.source=3", "data.source is 3; expected a text"),
        ("cluster=none", "cluster is 'none'; expected a section with keys"),
        ("cluster.method=7", "cluster.method is 7; expected kmeans | none"),
        ("cluster.method=kmean", "cluster.method is 'kmean'; expected kmeans | none (did you mean kmeans?)"),
        (
            "model.neighbours=[3, 0]",
            "model.neighbours is [3, 0]; expected an integer in [1, inf) or a list of an integer in [1, inf)",
        ),
        ("evaluate.scope=[]", "evaluate.scope is []; expected a list of object | recording"),
        (
            "evaluate.scope=[object, object]",
            "evaluate.scope is ['object', 'object']; expected a list of object | recording",
        ),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(change, sentence):
    assert "; ".join(mistakes(change)) == sentence


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("view=8", "unknown key view; did you mean views?"),
        ("finetune.epoch=3", "unknown key finetune.epoch; did you mean finetune.epochs?"),
        ("clusters.method=none", "unknown key clusters; did you mean cluster?"),
        ("evaluate.zzz=1", "unknown key evaluate.zzz; known here: trials, stop_at, scope"),
    ],
)
def test_an_unknown_key_is_named_with_the_nearest_known_one(change, sentence):
    assert "; ".join(mistakes(change)) == sentence


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("views", "--set 'views': expected key=value"),
        ("views.count=3", "--set views.count: views is no section"),
        ("views=[1", "--set views: '[1' is not YAML"),
    ],
)
def test_a_change_that_cannot_be_made_is_named(change, sentence):
    assert mistakes(change) == [sentence]


def test_several_mistakes_are_listed_at_once():
    found = mistakes("views=0", "cluster.scop=recording", "pretrain.lr=-1", "evaluate.trials=ten")
    assert sorted(found) == sorted(
        [
            "views is 0",
            "expected an integer in [1, 1000]",
            "unknown key cluster.scop",
            "did you mean cluster.scope?",
            "pretrain.lr is -1",
            "expected a number in [1e-30, 1e+30]",
            "evaluate.trials is 'ten'",
            "expected an integer in [1, inf)",
        ]
    )


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        (("split.folds=4", "split.fold=4"), "split.fold is 4; expected less than split.folds = 4"),
        (("viewpoints=cube", "views=12"), "viewpoints is cube, which has 8 places; views is 12"),
        (("viewpoints=dodecahedron", "views=8"), "viewpoints is dodecahedron, which has 20 places; views is 8"),
        (
            ("preprocess.baseline=none", "preprocess.filter=contact"),
            "preprocess.filter is contact, which needs rest noise; preprocess.baseline is none: "
            "expected empty_hand or quiet",
        ),
        *(
            (
                (f"cluster.assignment={assignment}", "cluster.method=none"),
                f"cluster.assignment is {assignment}, which needs clusters; cluster.method is none",
            )
            for assignment in ("area", "matched")
        ),
        *(
            (
                (f"model.system={system}", "model.backbone.kind=perceptron"),
                f"model.system is {system}, which needs feature maps; model.backbone.kind perceptron has none",
            )
            for system in ("gvcnn", "conv_lstm")
        ),
    ],
)
def test_values_that_do_not_go_together_are_refused(changes, sentence):
    assert "; ".join(mistakes(*changes)) == sentence


def test_the_last_fold_and_the_viewpoints_that_fit_are_allowed():
    assert params("split.folds=4", "split.fold=3").split.fold == 3
    assert params("viewpoints=dodecahedron", "views=20").views == 20
    assert params("viewpoints=circle", "views=7").views == 7


@pytest.mark.parametrize(
    "changes",
    [
        *(("cluster.method=none", f"cluster.assignment={kind}") for kind in ("index", "anchor", "random")),
        *(("cluster.method=kmeans", f"cluster.assignment={kind}") for kind in ("area", "matched")),
        *(("model.backbone.kind=perceptron", f"model.system={kind}") for kind in ("view_gcn", "stag", "cnn_lstm")),
        *(("model.backbone.kind=resnet", f"model.system={kind}") for kind in ("gvcnn", "conv_lstm")),
    ],
)
def test_assignments_that_have_their_clusters_and_systems_that_have_their_maps_are_allowed(changes):
    found = flat(params(*changes))
    assert all(found[key] == value for key, value in (change.split("=") for change in changes))


def test_a_missing_key_is_named_with_what_is_expected(tmp_path):
    lines = FILE.read_text().splitlines(keepends=True)
    path = tmp_path / "short.yaml"
    path.write_text("".join(line for line in lines if not line.startswith(("views:", "  trials:"))))
    with pytest.raises(ValueError, match=r"short\.yaml: ") as caught:
        load(path)
    assert "missing key views; expected an integer in [1, 1000]" in str(caught.value)
    assert "missing key evaluate.trials; expected an integer in [1, inf)" in str(caught.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.yaml"):
        load(tmp_path / "nowhere.yaml")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"views: [1", r"p\.yaml: not YAML: "),
        (b"- views\n", r"p\.yaml: expected keys and values, found list"),
        (b"", r"p\.yaml: expected keys and values, found NoneType"),
        (b"views: \xff\xfe", r"p\.yaml: not "),
    ],
)
def test_a_file_that_is_no_mapping_is_refused(tmp_path, content, sentence):
    (tmp_path / "p.yaml").write_bytes(content)
    with pytest.raises(ValueError, match=sentence):
        load(tmp_path / "p.yaml")


@pytest.mark.parametrize("key", ["pretrain.epochs", "pretrain.lr"])
def test_an_integer_beyond_every_float_is_refused(key):
    assert mistakes(f"{key}={'9' * 400}")[0].startswith(f"{key} is 999")


def test_a_range_is_quoted_to_the_last_digit():
    assert mistakes("seed=4294967296")[1] == "expected an integer in [0, 4294967295]"


@settings(max_examples=25, deadline=None)
@given(st.integers(-5, 1100))
def test_views_from_1_to_1000_are_allowed_and_no_others(views):
    if 1 <= views <= 1000:
        assert params(f"views={views}").views == views
    else:
        assert mistakes(f"views={views}")[0] == f"views is {views}"


@settings(max_examples=100, deadline=None)
@given(st.floats(), st.sampled_from(["", "low", "high", "both"]))
def test_a_range_holds_what_its_inequalities_hold(x, without):
    inside = {
        "": -1 <= x <= 2,
        "low": -1 < x <= 2,
        "high": -1 <= x < 2,
        "both": -1 < x < 2,
    }
    assert (x in Range(-1, 2, open=without)) == inside[without]


@pytest.mark.parametrize(
    ("ends", "text"),
    [((0, 1), "in [0, 1]"), ((0, 1, "high"), "in [0, 1)"), ((0, 1, "both"), "in (0, 1)"), ((), "in (-inf, inf)")],
)
def test_a_range_is_written_as_in_mathematics(ends, text):
    assert str(Range(*ends)) == text


@pytest.mark.parametrize("change", ["finetune.sizes=random", "split.validation=0.2", "model.dropout=0.1"])
def test_touches_need_random_sizes_and_validation_groups(change):
    (sentence,) = mistakes("evaluate.stop_at=0.9", change)
    assert sentence.startswith(
        "evaluate.stop_at is 0.9, which needs finetune.sizes random and split.validation above 0"
    )
    assert params("evaluate.stop_at=0.9", "finetune.sizes=random", "split.validation=0.2").evaluate.stop_at == 0.9


def test_the_joint_selector_needs_all_views():
    (sentence,) = mistakes("finetune.sizes=random", "model.selector=joint")
    assert sentence == "model.selector is joint, which needs all views, and finetune.sizes is random: expected per_view"


@pytest.mark.parametrize("system", get_args(System))
def test_systems_that_take_fewer_views_are_those_that_random_sizes_go_with(system):
    from tactile_viewgcn.classifier import system_of

    changes = ("finetune.sizes=random", f"model.system={system}")
    if system_of(system).takes_fewer:
        assert params(*changes).model.system == system
    else:
        (sentence,) = mistakes(*changes)
        assert (
            sentence == f"model.system is {system}, which needs all views, and finetune.sizes is random: expected full"
        )


def test_rotations_need_the_cube():
    rotations = ("model.system=rotationnet", "model.assignments=rotations")
    for changes in (("views=12",), ("viewpoints=circle",)):
        (sentence,) = mistakes(*rotations, *changes)
        assert sentence.startswith("model.assignments is rotations, which needs the cube")
    assert params(*rotations).views == 8
    assert params("model.assignments=rotations", "views=12").views == 12
