"""A classifier's file that somebody altered runs no code and crashes nothing: one line from all that load it."""

import io
import json
import os
import pickle
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.svm import SVC
from skops.io import dumps

from tactile_viewgcn.cli import cli
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recognition.archive import ARCHIVE, read_archive
from tactile_viewgcn.recognition.model_file import load_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.sensors.forest import Forest
from tests.recognition.test_mlflow_model import serve
from tests.small_glove import OBJECTS, ROOT, SHAPE, model_file, recording, write

RAN = "the code in the file has run"
POINTS, LABELS = np.random.default_rng(0).normal(size=(30, 80)), np.arange(30) % 3


class Code:
    """What runs a command when it is unpickled."""

    def __reduce__(self):
        return os.system, (f"echo {RAN}",)


def content(system: str = "trees") -> dict:
    """The content of the file of a network, or of one system on the sensors, on the small glove."""
    changes = ["model.system=mvcnn"] if system == "mvcnn" else ["model.system=sensors", f"model.members=[{system}]"]
    with tempfile.TemporaryDirectory() as folder:
        path = model_file(Path(folder) / "classifier.pt", *changes)
        return torch.load(path, weights_only=True)


def learnt(tree: dict) -> dict:
    """What the first member has learnt."""
    return tree["learnt"]["fitted"]["members"][0]


def pipeline(system: str):
    """Its pipeline."""
    return read_archive(learnt(content(system))["pipeline"][ARCHIVE].numpy().tobytes())


def with_archive(data: bytes, system: str = "trees") -> dict:
    """The same content with another archive as the pipeline."""
    tree = content(system)
    learnt(tree)["pipeline"] = {ARCHIVE: torch.frombuffer(bytearray(data), dtype=torch.uint8)}
    return tree


def with_trees(name: str, node: int, value: float) -> dict:
    """The same with another number in one place of the trees' arrays."""
    state = pipeline("trees").__getstate__()
    state[name][node] = value
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Forest, "__getstate__", lambda self: state)
        return with_archive(dumps(Forest()))


def naming(module_name: str, function: str) -> dict:
    """An archive of skops that asks for a function."""
    schema = json.loads(zipfile.ZipFile(io.BytesIO(dumps(np.zeros(1)))).read("schema.json"))
    node = {"__class__": function, "__module__": module_name, "__loader__": "FunctionNode", "__id__": 1}
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr("schema.json", json.dumps(schema | node | {"content": node}))
    return with_archive(file.getvalue())


def compressed() -> dict:
    return with_archive(dumps(Forest(2).fit(np.zeros((30, 80)), LABELS), compression=zipfile.ZIP_DEFLATED))


def without(name: str) -> dict:
    return {key: value for key, value in content().items() if key != name}


def shared_lists() -> dict:
    """A list that stands twice in a list that stands twice, and so on, which pickle stores once."""
    lists: list = [0]
    for _ in range(40):
        lists = [lists, lists]
    return with_learnt(lists=lists)


def changed(**changes) -> dict:
    return content() | changes


def calibrated(**changes) -> dict:
    tree = content()
    return tree | {"calibration": {"by_frames": [1.0] * 4, "by_recordings": [], "most_frames": 4} | changes}


def wide() -> dict:
    """A network that names a width of which its weights are not."""
    tree = content("mvcnn")
    return tree | {"model": tree["model"] | {"backbone": tree["model"]["backbone"] | {"width": 1_000_000}}}


def with_nan() -> dict:
    tree = content("mvcnn")
    tree["learnt"]["head.classifier.3.bias"].fill_(np.nan)
    return tree


def with_learnt(**changes) -> dict:
    tree = content()
    learnt(tree).update(changes)
    return tree


#: what was altered, and the reason that the line has
ALTERED = {
    "a pickle": (lambda: {"weights": Code()}, "UnpicklingError: Weights only load failed"),
    "a pickle as the pipeline": (lambda: with_archive(pickle.dumps(Code())), "BadZipFile: File is not a zip file"),
    "os.system": (lambda: naming("os", "system"), "a pipeline of type os.system is not trusted"),
    "a tree that loops": (lambda: with_trees("left_child", 0, 0), "a tree's node has a child that is not below it"),
    "a tree that points outside": (lambda: with_trees("right_child", 0, 10**9), "a child that is not below it"),
    "a feature outside": (lambda: with_trees("feature", 0, 10**9), "asks for a feature that there is not"),
    "scikit-learn's own trees": (
        lambda: with_archive(dumps(ExtraTreesClassifier(2).fit(POINTS, LABELS))),
        "sklearn.tree._tree.Tree is not trusted",
    ),
    "another estimator": (lambda: with_archive(dumps(SVC().fit(POINTS, LABELS))), "type sklearn.svm._classes.SVC is"),
    "a compressed archive": (compressed, "its archive is compressed"),
    "a leaf that is no number": (lambda: with_trees("leaf_values", 0, np.nan), "a pipeline's number is not finite"),
    "a file of an earlier version": (lambda: without("format"), "no classifier of this version; train it again"),
    "a key missing": (lambda: without("live"), "ValueError: live: Field required"),
    "too many classes": (lambda: with_learnt(classes=10**8), "another number of classes than it names"),
    "numbers shown many times": (lambda: changed(viewpoints=torch.zeros(1, 3).expand(900, 3)), "number by number"),
    "no viewpoints": (lambda: changed(viewpoints=torch.zeros(0, 3)), "viewpoints, calibration: out"),
    "another layout": (lambda: changed(live=torch.ones(20, 20, dtype=torch.bool)), "live, novelty: out of range"),
    "no sensor": (lambda: changed(live=torch.zeros(SHAPE, dtype=torch.bool)), "live, novelty: out of range"),
    "noise below 0": (lambda: changed(noise=-torch.ones(SHAPE)), "noise: out of range"),
    "a baseline that is no number": (lambda: changed(baseline_mean=torch.full((2, *SHAPE), np.nan)), "baseline_mean"),
    "a class twice": (lambda: changed(classes=["ball"] * 3), "classes: Value error, an item stands twice"),
    "a class without a name": (lambda: changed(classes=["ball", None, "pen"]), "classes.1: Input should be a valid"),
    "another type of counts": (lambda: changed(dtype="O"), "dtype: Input should be"),
    "a scale of 0": (lambda: changed(scale=0.0), "scale: Input should be greater than 0"),
    "a temperature below 0": (lambda: calibrated(by_frames=[-1.0] * 4), "calibration.by_frames.0: Input should be"),
    "endless frames": (lambda: calibrated(most_frames=10**8), "calibration.most_frames: Input should be less than"),
    "an unknown baseline": (lambda: changed(preprocess={"baseline": "x"}), "baseline: Input should be"),
    "lists without end": (shared_lists, "a list or mapping stands in several places"),
    "a width that would fill the memory": (wide, "its weights are those of another network"),
    "a weight that is no number": (with_nan, "a weight is no finite number"),
    "other weights": (lambda: with_archive(dumps(Forest(2).fit(POINTS[:, :5], LABELS))), "ValueError: X has"),
}
FOUR = ("a pickle", "os.system", "a tree that loops", "a tree that points outside")  # what the issue names


def altered(folder: Path, name: str) -> Path:
    torch.save(ALTERED[name][0](), folder / "classifier.pt")
    return folder / "classifier.pt"


def test_a_compressed_file_is_refused_before_it_is_unpacked(tmp_path):
    model_file(tmp_path / "good.pt", "model.system=sensors", "model.members=[trees]")
    packed = zipfile.ZipFile(tmp_path / "bad.pt", "w", zipfile.ZIP_DEFLATED)
    with zipfile.ZipFile(tmp_path / "good.pt") as good, packed as bad:
        for member in good.infolist():
            bad.writestr(member.filename, good.read(member))
    with pytest.raises(UserError, match="its archive is compressed"):
        Recogniser(tmp_path / "bad.pt")


def test_a_part_that_stands_in_the_file_many_times_is_refused(tmp_path):
    path = model_file(tmp_path / "classifier.pt", "model.system=sensors", "model.members=[trees]")
    with zipfile.ZipFile(path, "a") as archive:
        largest = max(archive.infolist(), key=lambda member: member.file_size)
        archive.filelist += [largest] * 30
        archive._didModify = True  # the directory is written anew
    with pytest.raises(UserError, match="names a part many times"):
        Recogniser(path)


def test_a_file_that_is_missing_is_not_called_damaged(tmp_path):
    with pytest.raises(FileNotFoundError):
        load_classifier(tmp_path / "classifier.pt")


@pytest.mark.parametrize("name", ALTERED)
def test_the_recogniser_refuses_it_in_one_line(tmp_path, capfd, name):
    path = altered(tmp_path, name)
    with pytest.raises(UserError) as error:
        Recogniser(path)
    line = str(error.value)
    assert line.startswith(f"{path}: ") and ALTERED[name][1] in line and len(line.splitlines()) == 1
    assert RAN not in capfd.readouterr().out


OTHERS = {
    "a text": lambda path: path.write_text("views: 8\n"),
    "nothing": lambda path: path.write_bytes(b""),
    "a backbone": lambda path: torch.save({"backbone": {"weight": torch.zeros(2)}, "classifier": {}}, path),
    "a tensor": lambda path: torch.save(torch.zeros(2), path),
}


@pytest.mark.parametrize("name", OTHERS)
def test_another_file_is_called_no_classifier_and_nobody_is_told_to_train_or_delete(tmp_path, name):
    OTHERS[name](tmp_path / "file.pt")
    with pytest.raises(UserError, match=r"file.pt: no classifier[;,].* expected what `finetune`") as error:
        Recogniser(tmp_path / "file.pt")
    assert not {"damaged", "again", "delete", "repro"} & set(str(error.value).split())


def test_a_classifier_that_was_cut_short_is_damaged(tmp_path):
    path = model_file(tmp_path / "classifier.pt")
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(UserError, match=r"damaged, altered, or no classifier of this version .*; train it again"):
        Recogniser(path)


@pytest.mark.filterwarnings("default")  # MLflow's own
@pytest.mark.parametrize("name", FOUR)
def test_the_command_and_mlflow_print_the_same_line(tmp_path, capfd, name):
    path = altered(tmp_path, name)
    write(tmp_path / "new" / "1.h5", recording(OBJECTS[0], 80))
    result = CliRunner().invoke(cli, ["predict", str(path), str(tmp_path / "new")])
    assert isinstance(result.exception, UserError) and ALTERED[name][1] in str(result.exception)
    import mlflow

    model = saved(tmp_path, path)
    with pytest.raises(UserError) as error:
        mlflow.pyfunc.load_model(str(model))
    assert ALTERED[name][1] in str(error.value) and len(str(error.value).splitlines()) == 1
    assert RAN not in capfd.readouterr().out


def saved(folder: Path, path: Path) -> Path:
    """An MLflow model of the file, in a folder."""
    import mlflow

    loader = "tactile_viewgcn.recognition.mlflow_model"
    mlflow.pyfunc.save_model(folder / "model", loader_module=loader, data_path=str(path), pip_requirements=[])
    return folder / "model"


@pytest.mark.slow
@pytest.mark.filterwarnings("default")  # MLflow's own
@pytest.mark.parametrize("name", FOUR)
def test_mlflow_s_server_ends_with_the_same_line(tmp_path, name):
    model = saved(tmp_path, altered(tmp_path, name))
    with serve(tmp_path, str(model), PYTHONPATH=str(ROOT)) as (process, _, log):
        assert process.wait(540)
    lines = log.read_text().splitlines()
    assert any(line.startswith("tactile_viewgcn.errors.UserError") and ALTERED[name][1] in line for line in lines)
    assert RAN not in lines
