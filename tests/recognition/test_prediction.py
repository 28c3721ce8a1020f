"""The command `predict`: what it prints and writes, where it finds the model, and what it refuses."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tactile_viewgcn.recognition.unlabelled import Row

from tactile_viewgcn import tracking
from tactile_viewgcn.cli import cli
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.recognition.answer import OBJECT, UNKNOWN, Answer
from tactile_viewgcn.recognition.answer_table import line
from tactile_viewgcn.recognition.prediction import load_model
from tests.mlflow_stores import fresh_store
from tests.small_glove import OBJECTS, SHAPE, empty_hand, model_file, recording, write


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


def call(*words, text=None):
    """Output of the command; it must end well."""
    result = CliRunner().invoke(cli, ["predict", *map(str, words)], input=text, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output.splitlines()


def test_unlabelled_recordings_have_a_line_each(place):
    head, columns, *lines, last = call(place / "classifier.pt", place / "new")
    assert head == "model: ensemble, 3 classes, up to 8 frames; probabilities are calibrated"
    assert [line.split()[:3] for line in lines] == [[str(i), "8/20", name] for i, name in enumerate(OBJECTS)]
    assert all(len(line) <= 80 for line in (columns, *lines))
    assert last == "answers: 3 object"


def test_labelled_recordings_are_counted_and_the_empty_hand_is_right_without_contact(place):
    *_, right, other = call(place / "classifier.pt", place / "known")
    assert right == "right: 4 of 4 (100.0 %); among the first three: 4"
    assert other.startswith("of objects that the model does not know: 1, ")


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


def test_frames_from_standard_input_are_answered(place):
    text = "".join(",".join(map(str, frame.ravel())) + "\n" for frame in recording("pen", 85))
    _, note, line = call(place / "classifier.pt", "-", "--follow", "--json", place / "a.json", text=text)
    assert note.startswith("ready") and line.split()[:4] == ["contact", "1", "8/20", "pen"] and line.endswith(" ms")
    (answer,) = json.loads((place / "a.json").read_text())["answers"]
    assert answer["answer"] == "pen" and answer["latency_ms"] > 0


def test_a_bad_line_of_a_stream_leaves_the_answers_before_it_in_the_files(place):
    text = "".join(",".join(map(str, frame.ravel())) + "\n" for frame in recording("pen", 85))
    with pytest.raises(UserError, match=r"line 61: 2 numbers; expected 8 x 10 = 80"):
        call(place / "classifier.pt", "-", "--follow", "--csv", place / "a.csv", text=f"{text}1,2\n")
    (row,) = csv.DictReader((place / "a.csv").read_text("utf-8").splitlines())
    assert (row["recording"], row["answer"]) == ("contact 1", "pen")


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


@pytest.mark.parametrize("status", [OBJECT, UNKNOWN])
def test_long_names_are_cut_where_the_line_would_be_longer_than_a_terminal(status):
    classes = ["safety glasses of the second drawer", "mug", "a multimeter with two long test leads"]
    answer = Answer(status, np.array([0.61, 0.29, 0.1]), 8, 20)
    text = line(Row("recording of the third of May", "", 0.0, 2.0, 60, answer, latency_ms=12.0), classes)
    assert len(text) <= 80 and "safety" in text and text.endswith(" 12 ms")
    if status == OBJECT:
        assert " 61 %, mug 29 %, a multime" in text


def test_names_with_one_beginning_are_never_cut_alike():
    classes = ["tennis_ball_old", "tennis_ball_new", "mug"]
    answer = Answer(OBJECT, np.array([0.61, 0.29, 0.1]), 8, 20)
    text = line(Row("1", "", 0.0, 2.0, 60, answer, latency_ms=12.0), classes)
    assert text.endswith("8/20  tennis_ball_old 61 %, tennis_ball_new 29 %  12 ms") and len(text) == 80
    longer = ["a tennis ball for the table", "a tennis ball for the garden", "mug"]
    text = line(Row("1", "", 0.0, 2.0, 60, answer, latency_ms=12.0), longer)
    assert text.endswith("8/20  a tennis ball for the table 61 %  12 ms")
    unknown = Answer(UNKNOWN, answer.probabilities, 8, 20)
    text = line(Row("1", "", 0.0, 2.0, 60, unknown), longer)
    assert text.endswith("nearest a tennis ball for the t… 61 %")


def test_a_stream_without_contact_says_so(place):
    text = "".join(",".join(map(str, frame.ravel())) + "\n" for frame in empty_hand(86))
    *_, last = call(place / "classifier.pt", "-", "--follow", "--csv", place / "a.csv", text=text)
    assert last.startswith("40 frames, no contact")
    (head,) = (place / "a.csv").read_text("utf-8").splitlines()
    assert head.startswith("recording,start_s,end_s,answer,class_1,probability_1,") and head.endswith(",object")


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
        (["new/0.h5", "new"], UserError, r"damaged, or not written by this version"),
        (["classifier.pt", "classifier.pt"], UserError, r"neither a MAT-file by its name"),
        (["classifier.pt", "other"], UserError, r"frames of 8 x 9; expected 8 x 10"),
        (["classifier.pt", "new", "--window", "0"], UserError, r"window is 0; expected seconds above 0"),
        (["classifier.pt", "new", "--stop-at", "1.5"], UserError, r"--stop-at is 1.5; expected a probability"),
        (["classifier.pt", "new", "--csv", "a.json"], UserError, r"named by --csv and --json; expected two files"),
        (["classifier.pt", "new/0.h5", "--csv", "new/0.h5"], UserError, r"0.h5: it is read here; name another"),
        (["classifier.pt", "new", "--csv", "no/a.csv"], UserError, r"a.csv: not a file in a folder that exists"),
        (["classifier.pt", "nowhere", "--follow"], UserError, r"nowhere: no such file; expected one of a line a frame"),
        (["classifier.pt", "-", "--follow", "--window", "1"], UserError, r"expected one of the two"),
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
    with pytest.raises(UserError, match=r"models:/glove/1: no MLflow store at sqlite:///"):
        load_model("models:/glove/1")
    assert not (place / "mlflow.db").exists()
    fresh_store(place / "mlflow.db")
    with tracking.stage_run("evaluate") as run:
        address = run.model(place / "classifier.pt", 8, SHAPE, np.dtype(np.int16), list(OBJECTS))
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{place / 'mlflow.db'}")
    mlflow.register_model(address, "glove")
    for name in (run.id, f"runs:/{run.id}", f"runs:/{run.id}/classifier", "models:/glove/1", address):
        assert load_model(name).classes == list(OBJECTS), name
    with pytest.raises(UserError, match=r"models:/glove/7: MLflow store sqlite:///"):
        load_model("models:/glove/7")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    with pytest.raises(UserError, match=r"MLFLOW_TRACKING_URI is disabled"):
        load_model("models:/glove/1")
