"""A classifier's file that somebody altered runs no code and crashes nothing: one line from all that load it."""

import os
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from tactile_viewgcn.cli import cli
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.glove_data import OBJECTS, ROOT, SHAPE, model_file, recording, write
from tests.recognition.test_mlflow_model import serve

RAN = "the code in the file has run"


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


def learnt(change, system: str = "trees") -> dict:
    """The content, and in it the arrays of the first member's estimator of single frames, changed."""
    tree = content(system)
    change(tree["learnt"]["members"][0]["1"])
    return tree


def put(name: str, value: float, system: str = "trees") -> dict:
    """A different number in the first place of an array."""
    return learnt(lambda state: state[name].view(-1)[:1].fill_(value), system)


def nested(depth: int) -> list:
    """A list that stands twice in a list that stands twice, and so on, which pickle stores once."""
    lists: list = [0]
    for _ in range(depth):
        lists = [lists, lists]
    return lists


def changed(**changes) -> dict:
    return content() | changes


def preprocessed(**changes) -> dict:
    tree = content()
    return tree | {"preprocessing": tree["preprocessing"] | changes}


def calibrated(**changes) -> dict:
    return changed(calibration={"by_frames": [1.0] * 8, "by_recordings": [], "most_frames": 8} | changes)


def of_width(width: int) -> dict:
    """A network that names a width of which its weights are not."""
    tree = content("mvcnn")
    return tree | {"model": tree["model"] | {"backbone": tree["model"]["backbone"] | {"width": width}}}


def with_nan() -> dict:
    tree = content("mvcnn")
    tree["learnt"]["head.classifier.3.bias"].fill_(np.nan)
    return tree


def of_sensors(**changes) -> dict:
    tree = content()
    return tree | {"learnt": tree["learnt"] | changes}


#: what was altered, and what the line names
ALTERED = {
    "a pickle": (lambda: {"weights": Code()}, "UnpicklingError"),
    "a pickle as a member": (lambda: learnt(lambda state: state.update(left=Code())), "UnpicklingError"),
    "a tree that loops": (lambda: learnt(lambda state: state["right"].clamp_(max=1)), "a child that is not below it"),
    "a tree that points outside": (lambda: put("right", 10**9), "a child that is not below it"),
    "a feature outside": (lambda: put("feature", 10**9), "a feature that there is not"),
    "a leaf that is no number": (lambda: put("shares", np.nan), "not finite"),
    "an array of another size": (lambda: learnt(lambda of: of.update(centre=of["centre"][1:]), "svm"), "array points"),
    "a text as an array": (lambda: learnt(lambda state: state.update(roots="0")), "AttributeError"),
    "a class that there is not": (lambda: put("classes", 7), "a class that there is not"),
    "another estimator": (lambda: changed(learnt=content("svm")["learnt"]), "half_squares"),
    "no estimator": (lambda: of_sensors(members=[{}]), "no estimator"),
    "other sensors": (lambda: of_sensors(live=torch.eye(*SHAPE, dtype=torch.bool)), "other sensors"),
    "a unit of 0": (lambda: of_sensors(unit=0.0), "unit"),
    "a file of an earlier version": (lambda: changed(format=5), "train it again"),
    "a key missing": (lambda: {key: value for key, value in content().items() if key != "scale"}, "scale"),
    "a key too many": (lambda: changed(code="x"), "code"),
    "numbers shown many times": (lambda: changed(viewpoints=torch.zeros(1, 3).expand(900, 3)), "number by number"),
    "a tensor of a huge size": (lambda: preprocessed(noise=torch.zeros(1).expand(10**9, 10**6)), "number by number"),
    "no viewpoints": (lambda: changed(viewpoints=torch.zeros(0, 3)), "viewpoints"),
    "another layout": (lambda: preprocessed(live=torch.ones(20, 20, dtype=torch.bool)), "noise"),
    "no sensor": (lambda: preprocessed(live=torch.zeros(SHAPE, dtype=torch.bool)), "live"),
    "a baseline that is no number": (lambda: preprocessed(baselines={"": torch.full(SHAPE, np.nan)}), "not finite"),
    "a baseline of another layout": (lambda: preprocessed(baselines={"": torch.zeros(2, 2)}), "baselines"),
    "a text as noise": (lambda: preprocessed(noise="0"), "TypeError"),
    "a class twice": (lambda: changed(classes=["ball"] * 3), "classes"),
    "a class without a name": (lambda: changed(classes=["ball", None, "pen"]), "classes.1"),
    "another type of counts": (lambda: preprocessed(dtype="O"), "dtype"),
    "a scale of 0": (lambda: changed(scale=0.0), "scale"),
    "a temperature below 0": (lambda: calibrated(by_frames=[-1.0] * 8), "temperatures"),
    "endless frames": (lambda: calibrated(most_frames=10**8), "most_frames"),
    "an unknown baseline": (
        lambda: preprocessed(params=content()["preprocessing"]["params"] | {"baseline": "x"}),
        "params.baseline",
    ),
    "an unknown member": (lambda: changed(model=content()["model"] | {"members": ["os.system"]}), "members"),
    "lists without end": (lambda: changed(learnt=nested(40)), "several places"),
    "lists within lists": (lambda: changed(learnt=[[[]]]), "learnt"),
    "a width that would fill the memory": (lambda: of_width(1_000_000), "weights"),
    "a weight that is no number": (with_nan, "not finite"),
}
THREE = ("a pickle", "a tree that loops", "a tree that points outside")


def altered(folder: Path, name: str) -> Path:
    torch.save(ALTERED[name][0](), folder / "classifier.pt")
    return folder / "classifier.pt"


def refused(path: Path) -> str:
    """The line with which the recogniser refuses a file."""
    with pytest.raises(UserError) as error:
        Recogniser(path)
    line = str(error.value)
    assert line.startswith(f"{path}: ") and len(line.splitlines()) == 1
    return line


def test_a_compressed_file_and_one_that_names_a_part_many_times_are_refused_before_they_are_unpacked(tmp_path):
    good = model_file(tmp_path / "good.pt", "model.system=sensors", "model.members=[trees]")
    with zipfile.ZipFile(good) as file, zipfile.ZipFile(tmp_path / "bad.pt", "w", zipfile.ZIP_DEFLATED) as packed:
        for member in file.infolist():
            packed.writestr(member.filename, file.read(member))
    with zipfile.ZipFile(good, "a") as archive:
        largest = max(archive.infolist(), key=lambda member: member.file_size)
        archive.filelist += [largest] * 30
        archive._didModify = True  # the directory is written anew
    for path in (tmp_path / "bad.pt", good):
        assert "compressed" in refused(path)


@pytest.mark.parametrize("name", ALTERED)
def test_the_recogniser_refuses_it_in_one_line(tmp_path, capfd, name):
    assert ALTERED[name][1] in refused(altered(tmp_path, name))
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
    line = refused(tmp_path / "file.pt")
    assert "no classifier" in line and not {"damaged", "again", "delete", "repro"} & set(line.split())


def test_a_classifier_that_was_cut_short_is_damaged(tmp_path):
    path = model_file(tmp_path / "classifier.pt")
    path.write_bytes(path.read_bytes()[:1000])
    assert "damaged" in refused(path)


@pytest.mark.filterwarnings("default")  # MLflow's own
@pytest.mark.parametrize("name", THREE)
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
def test_mlflow_s_server_ends_with_the_same_line(tmp_path):
    model = saved(tmp_path, altered(tmp_path, "a pickle"))
    with serve(tmp_path, str(model), PYTHONPATH=str(ROOT)) as (process, _, log):
        assert process.wait(540)
    lines = log.read_text().splitlines()
    assert any(line.startswith("tactile_viewgcn.errors.UserError") and ALTERED["a pickle"][1] in line for line in lines)
    assert RAN not in lines
