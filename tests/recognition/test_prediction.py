"""The command `predict`: what it prints and writes, where it finds the model, and what it refuses."""

import csv

import numpy as np
import pytest
from click.testing import CliRunner

from tactile_viewgcn import tracking
from tactile_viewgcn.cli import cli
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.recognition.prediction import load_model
from tests.glove_data import OBJECTS, empty_hand, model_file, recording, write
from tests.mlflow_stores import fresh_store
from tests.readers.files import save


@pytest.fixture
def place(tmp_path):
    """A folder with a model, an unlabelled folder of three recordings and a labelled one of five."""
    model_file(tmp_path / "classifier.pt")
    for number, name in enumerate(OBJECTS):
        write(tmp_path / "new" / f"{number}.h5", recording(name, 80 + number))
        write(tmp_path / "labelled" / f"{name}.h5", recording(name, 80 + number), object=name, session="today")
    write(tmp_path / "labelled" / "empty.h5", empty_hand(83), object="empty_hand", session="today")
    write(tmp_path / "labelled" / "zebra.h5", recording("zebra", 84), object="zebra", session="today")
    return tmp_path


def call(*words):
    """Output of the command; it must end well."""
    result = CliRunner().invoke(cli, ["predict", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output.splitlines()


def answers_in(path):
    return list(csv.DictReader(path.read_text("utf-8").splitlines()))


def test_unlabelled_recordings_have_a_line_each(place):
    head, columns, *lines, last, errs = call(place / "classifier.pt", place / "new")
    assert head == "model: kernel + pooled_kernel, 3 classes; probabilities are calibrated"
    assert [line.split()[:3] for line in lines] == [[str(i), "20", name] for i, name in enumerate(OBJECTS)]
    assert columns.split() == ["recording", "contact", "answer"]
    assert last == "answers: 3 with an object" and errs.startswith("how often it errs")
    uncalibrated = call(model_file(place / "full.pt", "model.system=mvcnn"), place / "new")[0]
    assert uncalibrated == "model: mvcnn, 3 classes; probabilities are not calibrated"


def test_recordings_in_two_files_are_answered_as_whole_ones(place):
    for number, name in enumerate(OBJECTS):
        for hand, half in zip(("left", "right"), np.split(recording(name, 80 + number), 2, axis=2), strict=True):
            save(place / "halves" / f"{number}_{hand}.npy", half)
    whole = call(place / "classifier.pt", place / "new")
    assert call(place / "classifier.pt", place / "halves", "--set", "data.layout=OBJECT/FILE_PART") == whole


def test_labelled_recordings_are_counted_and_the_file_holds_what_is_printed(place):
    words = place / "classifier.pt", place / "labelled", "--csv", place / "a.csv"
    *_, right, other = call(*words)
    assert call(*words)[-2:] == [right, other]  # the file of an earlier call is replaced
    assert right == "right: 4 of 4 (100.0 %)"  # the empty hand is right without contact
    assert other == "with a name that is no object of the model: 1"
    rows = {row["recording"]: row for row in answers_in(place / "a.csv")}
    assert [name for name in rows["cup"] if "class" in name] == ["class_1", "class_2", "class_3"]
    assert [rows[name]["answer"] for name in OBJECTS] == list(OBJECTS)
    assert rows["empty"]["answer"] == "no contact" and rows["empty"]["class_1"] == ""
    assert [rows[name]["right"] for name in (*OBJECTS, "empty", "zebra")] == [*["True"] * 4, ""]  # as many as printed
    assert (rows["cup"]["frames_in_contact"], rows["cup"]["frames"]) == ("20", "60")
    assert sum(float(rows["cup"][f"probability_{number}"]) for number in (1, 2, 3)) == pytest.approx(1, abs=1e-5)
    answers = (place / "a.csv").read_text("utf-8")
    for text in (f"{answers}my notes\n", "object,colour\ncup,blue\n"):
        (place / "a.csv").write_text(text, "utf-8")
        with pytest.raises(UserError, match="remove it or name another"):
            call(*words)
        assert (place / "a.csv").read_text("utf-8") == text


@pytest.mark.parametrize(
    "words, error, message",
    [
        ("nowhere.pt new", FileNotFoundError, "nowhere.pt: .*models/classifier.pt"),
        ("new new", FileNotFoundError, "new: a folder; .*models/classifier.pt"),
        ("classifier.pt nowhere", OSError, "nowhere: no such file"),
        ("new/0.h5 new", UserError, "0.h5: no classifier"),
        ("classifier.pt classifier.pt", UserError, "classifier.pt: no recordings"),
        ("classifier.pt other", UserError, r"8, 9\).*frames, 8, 10"),
    ],
)
def test_mistakes_are_refused_and_leave_no_file(place, monkeypatch, words, error, message):
    write(place / "other" / "1.h5", np.zeros((20, 8, 9), np.int16))
    monkeypatch.chdir(place)
    with pytest.raises(error, match=message):
        call(*words.split(), "--csv", "a.csv")
    assert not list(place.glob("a.csv*"))


@pytest.mark.filterwarnings("default")  # MLflow's own
def test_a_model_in_mlflow_is_found_by_its_run_or_its_name(place, monkeypatch):
    monkeypatch.chdir(place)
    monkeypatch.setenv("DVC_ROOT", str(place))
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    with pytest.raises(UserError, match=r"models:/glove/1: no MLflow store: sqlite:///"):
        load_model("models:/glove/1")
    assert not (place / "mlflow.db").exists()
    fresh_store(place / "mlflow.db")
    with tracking.stage_run(Record("evaluate")) as run:
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
