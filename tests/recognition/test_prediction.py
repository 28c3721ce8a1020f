"""The command `predict`: what it prints and writes, where it finds the model, and what it refuses."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tactile_viewgcn import tracking
from tactile_viewgcn.cli import cli
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recognition.answer import UNKNOWN
from tactile_viewgcn.recognition.prediction import _summary, load_model
from tests.glove_data import OBJECTS, SHAPE, empty_hand, model_file, recording, write
from tests.mlflow_stores import fresh_store


@pytest.fixture
def place(tmp_path):
    """A folder with a model, an unlabelled folder of three recordings and a labelled one of five."""
    model_file(tmp_path / "classifier.pt")
    for number, name in enumerate(OBJECTS):
        write(tmp_path / "new" / f"{number}.h5", recording(name, 80 + number))
        write(tmp_path / "known" / f"{name}.h5", recording(name, 80 + number), object=name, session="today")
    write(tmp_path / "known" / "empty.h5", empty_hand(83), object="empty_hand", session="today")
    write(tmp_path / "known" / "zebra.h5", recording("zebra", 84), object="zebra", session="today")
    return tmp_path


def call(*words):
    """Output of the command; it must end well."""
    result = CliRunner().invoke(cli, ["predict", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output.splitlines()


def test_unlabelled_recordings_have_a_line_each(place):
    head, columns, *lines, last, errs = call(place / "classifier.pt", place / "new")
    assert head == "model: kernel + max_kernel, 3 classes, up to 8 frames; probabilities are calibrated"
    assert [line.split()[:3] for line in lines] == [[str(i), "8/20", name] for i, name in enumerate(OBJECTS)]
    assert columns.split() == ["recording", "used/contact", "answer"]
    assert last == "answers: 3 with an object" and errs.startswith("how often it errs: ")


def test_recordings_of_one_object_get_one_more_answer_from_all_of_them(place):
    for seed in (85, 86):
        write(place / "one" / f"{seed}.h5", recording("pen", seed))
    *lines, last, _ = call(place / "classifier.pt", place / "one", "--together", "--json", place / "answers.json")
    assert lines[-3:-1] == ["answers: 2 with an object", "the recordings of a folder together, as one object:"]
    assert lines[-1].split()[:3] == ["together", "16/40", "pen"] and last == "answers: 1 with an object"
    first, second, both = json.loads((place / "answers.json").read_text())["answers"]
    assert both["recording"] == "together" and both["frames_used"] == first["frames_used"] + second["frames_used"]


def test_each_folder_and_each_labelled_object_is_answered_together(place):
    for seed, name in enumerate(("pen", "pen", "cup")):
        write(place / "two" / name / f"{seed}.h5", recording(name, 85 + seed))
        write(place / "labelled" / "1" / f"{seed}.h5", recording(name, 85 + seed), object=name, session="today")
    lines = call(place / "classifier.pt", place / "two", "--together")
    assert [line.split()[:3] for line in lines[-4:-2]] == [["cup", "8/20", "cup"], ["pen", "16/40", "pen"]]
    lines = call(place / "classifier.pt", place / "labelled", "--together")
    assert [line.split()[:3] for line in lines[-4:-2]] == [["1/pen", "16/40", "pen"], ["1/cup", "8/20", "cup"]]
    assert lines[-1] == "right: 2 of 2 (100.0 %)"


def test_where_the_confidence_is_not_reached_another_grasp_is_asked_for(place):
    write(place / "new" / "4.h5", (recording("pen", 87) + recording("cup", 88)) // 2)  # as if both were in the hand
    lines = call(place / "classifier.pt", place / "new", "--stop-at", "0.8", "--json", place / "answers.json")
    answers = json.loads((place / "answers.json").read_text())["answers"]
    assert [line.endswith("; grasp it again") for line in lines[2:6]] == [False, False, False, True]
    assert [answer["grasp_again"] for answer in answers] == [False, False, False, True]
    assert call(place / "classifier.pt", place / "new", "--together", "--stop-at", "1")[-3].endswith("; grasp it again")


def test_arrays_of_cells_have_the_models_layout(place):
    (place / "arrays" / "pen").mkdir(parents=True)
    frames = recording("pen", 82).reshape(-1, SHAPE[0] * SHAPE[1])
    np.savetxt(place / "arrays" / "pen" / "2.csv", frames, fmt="%d", delimiter=",", header="sensors", comments="")
    assert call(place / "classifier.pt", place / "arrays")[-1].startswith("right: 1 of 1")
    for path in (place / "arrays" / "pen", place / "arrays" / "pen" / "2.csv"):
        assert call(place / "classifier.pt", path)[2:] == call(place / "classifier.pt", place / "new" / "2.h5")[2:]


def test_labelled_recordings_are_counted_and_the_empty_hand_is_right_without_contact(place):
    *_, right, other = call(place / "classifier.pt", place / "known")
    assert right == "right: 4 of 4 (100.0 %)"
    assert other.startswith("with a name that is no object of the model: 1, ")


@pytest.mark.parametrize(("classes", "counted"), [("abc", False), ("abcd", True)])
def test_the_first_three_are_counted_where_there_are_more_classes(classes, counted):
    best = {f"class_{place}": name for place, name in enumerate("bca", start=1)}
    *_, right = _summary([{"answer": "b", "object": "a", **best}], list(classes))
    assert right == "right: 0 of 1 (0.0 %)" + "; among the first three: 1" * counted


def test_what_is_called_unknown_is_not_counted_as_right():
    known = {"object": "a", "class_1": "a", "class_2": "b", "class_3": None}
    *_, right = _summary([known | {"answer": answer} for answer in ("a", UNKNOWN)], ["a", "b"])
    assert right == "right: 1 of 2 (50.0 %)"


def test_the_files_hold_what_is_printed_and_all_probabilities(place):
    call(place / "classifier.pt", place / "known", "--csv", place / "a.csv", "--json", place / "a.json")
    rows = {row["recording"]: row for row in csv.DictReader((place / "a.csv").read_text("utf-8").splitlines())}
    assert [rows[name]["answer"] for name in OBJECTS] == list(OBJECTS)
    assert rows["empty"]["answer"] == "no contact" and rows["empty"]["class_1"] == ""
    assert (rows["cup"]["frames_used"], rows["cup"]["frames_in_contact"], rows["cup"]["frames"]) == ("8", "20", "60")
    content = json.loads((place / "a.json").read_text(encoding="utf-8"))
    answers = {answer["recording"]: answer for answer in content["answers"]}
    assert content["calibrated"] and sum(answers["cup"]["probabilities"].values()) == pytest.approx(1, abs=1e-5)
    assert answers["empty"]["probabilities"] == {} and answers["empty"]["novelty"] is None


def test_a_file_that_cannot_be_written_leaves_none(place, monkeypatch):
    replace = Path.replace

    def refused(part, path):
        if path.name == "a.json":
            raise OSError("no space left")
        return replace(part, path)

    monkeypatch.setattr(Path, "replace", refused)
    with pytest.raises(OSError, match="no space left"):
        call(place / "classifier.pt", place / "new", "--csv", place / "a.csv", "--json", place / "a.json")
    assert not list(place.glob("a.*"))


def test_a_model_of_v_views_alone_says_that_its_probabilities_are_not_calibrated(place):
    path = model_file(place / "full.pt", "finetune.num_views=full")
    assert "8 frames; probabilities are not calibrated" in call(path, place / "new")[0]
    with pytest.raises(UserError, match="takes 8 views and no fewer"):
        call(path, place / "new", "--stop-at", 0.9)


@pytest.mark.parametrize(
    "words, error, message",
    [
        (["nowhere.pt", "new"], FileNotFoundError, r"nowhere.pt: no such file; expected models/classifier.pt"),
        (["classifier.pt", "nowhere"], FileNotFoundError, r"nowhere: no such file or folder"),
        (["new/0.h5", "new"], UserError, r"0.h5: no classifier; expected what"),
        (["classifier.pt", "classifier.pt"], UserError, r"classifier.pt: no recordings in it"),
        (["classifier.pt", "other"], UserError, r"frames of 8 x 9; expected 8 x 10"),
        (["classifier.pt", "new", "--window", "5e-324"], UserError, r"window is 4.94066e-324; expected seconds, 0.001"),
        (
            ["classifier.pt", "new", "--stop-at", "1.5"],
            UserError,
            r"confidence threshold is 1.5; expected a probability",
        ),
        (["classifier.pt", "new", "--csv", "a.json"], UserError, r"a.json: it is read here, or named twice"),
        (["classifier.pt", "new", "--csv", "new/0.csv"], UserError, r"0.csv: it would be read as a recording"),
        (["new", "new"], FileNotFoundError, r"new: a folder; expected models/classifier.pt"),
    ],
)
def test_mistakes_are_refused_and_leave_no_file(place, monkeypatch, words, error, message):
    write(place / "other" / "1.h5", np.zeros((20, 8, 9), np.int16))
    monkeypatch.chdir(place)
    with pytest.raises(error, match=message):
        call(*words, "--json", "a.json")
    assert not list(place.glob("a.json*"))


@pytest.mark.filterwarnings("default")  # MLflow's own
def test_a_model_in_mlflow_is_found_by_its_run_or_its_name(place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.setenv("DVC_ROOT", str(place))
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    with pytest.raises(UserError, match=r"models:/glove/1: no MLflow store: sqlite:///"):
        load_model("models:/glove/1")
    assert not (place / "mlflow.db").exists()
    fresh_store(place / "mlflow.db")
    with tracking.stage_run("evaluate") as run:
        address = run.model(place / "classifier.pt", {"classes": list(OBJECTS)})
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{place / 'mlflow.db'}")
    mlflow.register_model(address, "glove")
    for name in (run.id, f"runs:/{run.id}", f"runs:/{run.id}/classifier", "models:/glove/1", address):
        assert load_model(name).classes == list(OBJECTS), name
    with pytest.raises(UserError, match=r"models:/glove/7: MLflow store sqlite:///"):
        load_model("models:/glove/7")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    with pytest.raises(UserError, match=r"no MLflow store: disabled"):
        load_model("models:/glove/1")
