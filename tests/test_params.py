"""params.yaml, its presets and changes, and what `load` refuses before any stage works."""

import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from dvc.utils.serialize import modify_yaml

from tactile_viewgcn import TactileClassifier, cli
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import (
    VIRTUAL,
    default_params,
    everywhere,
    load,
    preset_changes,
    presets,
)
from tactile_viewgcn.schema import as_change, flatten, parse, set_value

ROOT = Path(__file__).parents[1]
FILE = ROOT / "params.yaml"


def params(*changes):
    return load(FILE, changes)


def refusal(*changes, path=FILE):
    """Return what `load` says is wrong: one line, within one second of the processor."""
    begin = time.process_time()
    with pytest.raises(UserError, match=rf"{path.name}: ") as caught:
        load(path, changes)
    assert time.process_time() - begin < 1
    text = str(caught.value)
    assert len(text) < 2000 and "\n" not in text
    return text


def test_the_shipped_file_is_the_recipe_of_the_paper():
    recipe = (
        "views=8 split.by=source cluster.method=kmeans cluster.scope=object "
        "pretrain.epochs=30 pretrain.lr=5e-3 pretrain.weight_decay=1e-4 pretrain.step_size=10 "
        "pretrain.batch=32 pretrain.noise=0.015 model.neighbours=4 "
        "finetune.epochs=15 finetune.optimiser=sgd finetune.lr_backbone=1e-4 finetune.lr=5e-4 "
        "finetune.batch=20 evaluate.trials=10"
    )
    assert params(*recipe.split()) == params()


@pytest.mark.parametrize(
    "key", ["data.columns", "data.shape", "model.members", "model.neighbours", "glove.objects"]
)
def test_dvc_may_change_a_value_to_a_list_and_back(tmp_path, key):
    path = tmp_path / "params.yaml"
    path.write_bytes(FILE.read_bytes())
    section, name = key.split(".")
    before = yaml.safe_load(FILE.read_text())
    for value in (["a"], ["b", "c"], before[section][name], ["d"], before[section][name]):
        with modify_yaml(path) as values:
            values[section][name] = value
        changed = before[section] | {name: value}
        assert yaml.safe_load(path.read_text()) == before | {section: changed}


def test_the_typed_form_has_every_value_of_the_file_and_changes_set_the_keys_they_name():
    before = flatten(params())
    after = flatten(params("views=12", "cluster.method=none", "model.neighbours=[3, 3, 2]"))
    assert before == flatten(yaml.safe_load(FILE.read_text()))  # each key stands in the file
    assert before == flatten(default_params())
    changed = {key: value for key, value in after.items() if value != before[key]}
    assert changed == {"views": 12, "cluster.method": "none", "model.neighbours": [3, 3, 2]}
    assert params("views=12", "views=20").views == 20  # the last one counts


@pytest.mark.parametrize(
    "text", ["5e-4", "+5E-04", ".5", "5.", "1e400", "12", "true", "~", "1.2.3", "1e", "a b"]
)
def test_values_are_read_as_dvc_reads_them(text):
    dvc = pytest.importorskip("dvc.utils.serialize")
    assert repr(parse(f"a: {text}", "text")) == repr(dvc.parse_yaml(f"a: {text}", "params.yaml"))


@pytest.mark.parametrize("key", sorted(flatten(params())))
def test_every_key_refuses_a_value_of_another_type(key):
    """No key takes a mapping, only data.source takes any text, and only a switch takes true."""
    got = {f"{key}={{a: 1}}": "{'a': 1}"}
    if key != "data.source":
        got[f"{key}=zzz"] = "'zzz'"
    if flatten(params())[key] is not True:
        got[f"{key}=true"] = "True"
    for change, value in got.items():
        text = refusal(change)
        assert f"{key}: " in text and f"(got {value})" in text


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        ("seed=-1", "seed: |0 (got -1)"),
        ("pretrain.lr=1e400", "pretrain.lr: |(got inf)"),
        ("model.system=view_gnc", "model.system: |did you mean view_gcn?"),
        ("model.neighbours=[4,0,4,4]", "model.neighbours: |3 items|(got [4, 0, 4, 4])"),
        ("glove.leave_out=[moton]", "glove.leave_out: |'motion'|'noise'|(got 'moton')"),
        ("model.members=[trees, trees]", "model.members: |(got ['trees', 'trees'])"),
        ("cluster.scop=recording", "unknown key cluster.scop|cluster.scope?"),
        ("data.layout=PART/OBJECT/PART", "data.layout: |PART |(got 'PART/OBJECT/PART')"),
        ("data.columns=[force:emg]", "data.columns: |force:emg"),
        ("views", "'views'"),
        ("views=[1", "--set 'views=[1': "),
    ],
)
def test_a_mistake_names_its_key_its_value_and_what_is_allowed(change, parts):
    text = refusal(change)
    assert [part for part in parts.split("|") if part not in text] == []


def test_all_mistakes_are_listed_at_once():
    text = refusal(
        "views=0", "cluster.scop=recording", "pretrain.lr=-1", "evaluate.trials=ten", "seed.count=3"
    )
    for part in ("views: ", "cluster.scope?", "pretrain.lr: ", "evaluate.trials: ", "seed: "):
        assert text.count(part) == 1


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        (("split.folds=4", "split.fold=4"), "split.fold split.folds"),
        (("evaluate.side=validation",), "evaluate.side split.validation"),
        (("viewpoints=cube", "views=12"), "viewpoints views"),
        (("model.neighbours=[3,3]",), "model.neighbours"),
        (("preprocess.baseline=none", "preprocess.filter=contact"), "preprocess.filter"),
        (
            ("finetune.num_views=random", "model.selector=joint"),
            "model.selector finetune.num_views",
        ),
        (
            ("model.system=sensors", "split.validation=0.5"),
            "split.validation model.system evaluate.side",
        ),
    ],
)
def test_values_that_do_not_go_together_are_refused(changes, keys):
    text = refusal(*changes)
    assert [key for key in keys.split() if f"{key} " not in text] == []
    assert ";" in refusal(*changes, "split.folds=2", "split.fold=2")  # every conflict at once


def test_a_view_graph_has_a_level_for_each_halving_that_leaves_two_views():
    for views, levels in ((2, 1), (3, 1), (4, 2), (7, 2), (8, 3), (100, 3)):
        numbers = [1] * levels
        assert params(f"views={views}", f"model.neighbours={numbers}").model.neighbours == numbers
        if levels > 1:
            text = refusal(f"views={views}", f"model.neighbours={numbers[1:]}")
            assert f"{levels} levels" in text


def test_a_source_that_dvc_copies_into_its_workspaces_keeps_its_path_and_any_other_is_absolute(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path("tracked.dvc").touch()
    paths = {name: str(everywhere(Path(name))) for name in (VIRTUAL, "tracked", "other")}
    assert paths == {VIRTUAL: VIRTUAL, "tracked": "tracked", "other": str(tmp_path / "other")}


@pytest.mark.parametrize("name", presets())
def test_a_preset_is_allowed_and_changes_the_values_it_names(name):
    path = ROOT / "tactile_viewgcn" / "presets" / f"{name}.yaml"
    changes = preset_changes(name)
    default = flatten(params())
    values = flatten(params(*changes))
    expected = yaml.safe_load(path.read_text())
    assert {key: values[key] for key in expected} == expected
    assert {key for key in values if values[key] != default[key]} <= expected.keys()
    assert values != default and path.read_text().startswith("# ")
    assert all(len(change.split()) == 1 for change in changes)  # a shell does not split them


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"views: \xff\xfe", "YAML"),
        (b"views: !!python/object/apply:os.system [ls]", "YAML"),
        (b"- views\n", "list"),
        (b"", "nothing"),
        (b"a: " + b"[" * 1000, "YAML"),
    ],
)
def test_a_file_that_is_no_plain_yaml_is_refused_in_a_line(tmp_path, content, word):
    path = tmp_path / "p.yaml"
    path.write_bytes(content)
    assert word in refusal(path=path)


def test_a_key_that_a_file_lacks_has_its_default(tmp_path):
    (tmp_path / "p.yaml").write_text("views: 12\nfinetune: {epochs: 2}\n")
    assert load(tmp_path / "p.yaml") == default_params(("views=12", "finetune.epochs=2"))


def test_neither_the_class_nor_inspect_reads_the_params_yaml_of_the_working_folder(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    Path("params.yaml").write_text("broken: [")
    recordings = []
    for seed in range(8):
        lowest = 500 + 40 * (seed % 2)
        recordings.append(np.random.default_rng(seed).integers(lowest, lowest + 30, (20, 4)))
    expected = default_params(("model.system=sensors", "model.members=[kernel]"))
    assert TactileClassifier(system="kernel").fit(recordings, [0, 1] * 4).params_ == expected
    with pytest.raises(OSError, match=r"^nowhere: no such file"):
        cli.cli(["inspect", "nowhere"], standalone_mode=False)


@pytest.mark.stability("batches of one")
@pytest.mark.parametrize("key", ["pretrain.batch", "finetune.batch"])
def test_batches_of_one_from_which_batch_normalisation_learns_nothing_are_refused(row, key):
    row.refused(f"{key} of 1", lambda: load(FILE, (f"{key}=1",)), rf"{key}: .*equal to 2")


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ("data/glöve 16", '"data/glöve 16"'),
        ('it\'s "b", #1 & {c}: $d', '"it\'s \\"b\\", #1 & {c}: $d"'),
        (True, "true"),
        ("12", '"12"'),
        ("1e-3", '"1e-3"'),
        (150.0, "150.0"),
        (["ball", "a b", 3], '["ball","a b",3]'),
        (["pressure:emg", "time:t, [s]"], '["pressure:emg","time:t, [s]"]'),
    ],
)
def test_a_change_is_read_back_the_same_by_params_yaml_and_by_dvc_s_own_parser(value, text):
    hydra = pytest.importorskip("hydra.core.override_parser.overrides_parser")
    parser = hydra.OverridesParser.create()
    change = as_change("key", value)
    tree = {}
    set_value(tree, change)
    assert change == f"key={text}"

    def unquoted(value):
        """Return a value of Hydra's parser as plain values."""
        if isinstance(value, list):
            return list(map(unquoted, value))
        return getattr(value, "text", value)

    assert tree["key"] == value == unquoted(parser.parse_override(change).value())
