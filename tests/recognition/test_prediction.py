"""The command `predict` prints and writes answers, refuses mistakes, and finds the model."""

import csv
from itertools import islice

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from tactile_viewgcn import TactileClassifier, tracking
from tactile_viewgcn.cli import cli
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import default_params
from tactile_viewgcn.provenance import Record
from tactile_viewgcn.recognition.estimator import train
from tactile_viewgcn.recognition.prediction import load_model
from tactile_viewgcn.tables.recordings import recordings_of
from tests.glove_data import OBJECTS, empty_hand, model_file, recording, write
from tests.mlflow_stores import fresh_store
from tests.readers.files import save


@pytest.fixture
def folder(tmp_path):
    """Return a folder with a model, 3 unlabelled recordings and 5 labelled recordings."""
    model_file(tmp_path / "classifier.pt")
    labelled = tmp_path / "labelled"
    for index, name in enumerate(OBJECTS):
        counts = recording(name, 80 + index)
        write(tmp_path / "new" / f"{index}.h5", counts)
        write(labelled / f"{name}.h5", counts, object=name, session="today")
    write(labelled / "empty.h5", empty_hand(83), object="empty_hand", session="today")
    write(labelled / "zebra.h5", recording("zebra", 84), object="zebra", session="today")
    return tmp_path


def call(*words):
    """Return the output of the command, which must end well."""
    result = CliRunner().invoke(cli, ["predict", *map(str, words)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output.splitlines()


def answers_in(path):
    """Return the rows of a file of answers."""
    return list(csv.DictReader(path.read_text("utf-8").splitlines()))


def test_unlabelled_recordings_have_a_line_each(folder):
    head, columns, *lines, last, hint = call(folder / "classifier.pt", folder / "new")
    assert head == "model: kernel + pooled_kernel, 3 classes; probabilities are calibrated"
    assert [line.split()[:3] for line in lines] == [
        [str(i), "20", name] for i, name in enumerate(OBJECTS)
    ]
    assert columns.split() == ["recording", "contact", "answer"]
    assert last == "answers: 3 with an object"
    assert "`tactile-viewgcn report` says how often it is wrong" in hint
    network = model_file(folder / "full.pt", "model.system=mvcnn")
    head = call(network, folder / "new")[0]
    assert head == "model: mvcnn, 3 classes; probabilities are not calibrated"


def test_recordings_without_contact_are_named_with_the_reason_unless_they_are_of_an_empty_hand(
    folder,
):
    write(folder / "new" / "open.h5", empty_hand(85))
    _, note, _, *lines = call(folder / "classifier.pt", folder / "new")
    assert note.startswith(
        "contact: no frame is in contact in 1 of 4 recordings: open. An object that presses"
    )
    assert lines[3].split() == ["open", "0", "no", "contact"]
    assert not any(
        "no frame" in line for line in call(folder / "classifier.pt", folder / "labelled")
    )


def test_a_recording_that_is_too_short_for_calibrated_probabilities_is_named(folder):
    """Training recordings have 20 frames in contact."""
    write(folder / "new" / "brief.h5", recording(OBJECTS[0], 86, held=9))
    _, note, *_ = call(folder / "classifier.pt", folder / "new")
    assert note.startswith("contact: 1 of 4 recordings have fewer than 10 frames in contact")
    write(folder / "new" / "brief.h5", recording(OBJECTS[0], 86, held=10))
    lines = call(folder / "classifier.pt", folder / "new")
    assert not any("fewer than" in line for line in lines)


def test_an_empty_hand_that_is_not_used_is_named(folder):
    """One session has too few frames of it, and the other one has enough."""
    for session, frames in (("monday", 4), ("tuesday", 40)):
        write(folder / "days" / f"ball {session}.h5", recording(OBJECTS[0], 87), session=session)
        empty = empty_hand(88)[:frames]
        write(folder / "days" / f"empty {session}.h5", empty, object="empty_hand", session=session)
    _, warning, columns, *_ = call(folder / "classifier.pt", folder / "days")
    assert warning == (
        "warning: baseline: the empty hand of a session has fewer than 5 frames, so it is not "
        "used: empty monday. Record 5 frames or more"
    )
    assert columns.split() == ["recording", "contact", "answer"]


def test_an_empty_hand_is_not_used_without_a_baseline_unless_it_is_one_of_the_objects(folder):
    without_baseline = ("preprocess.baseline=none", "preprocess.filter=none")
    model = model_file(folder / "constant.pt", *without_baseline)
    named = "warning: baseline: the empty hand is not used"
    assert not any(named in line for line in call(model, folder / "labelled"))
    write(folder / "new" / "empty.h5", empty_hand(88), object="empty_hand")
    assert sum(named in line for line in call(model, folder / "new")) == 1


def test_an_answer_empty_hand_is_no_object(tmp_path):
    rng = np.random.default_rng(0)
    names = ["empty_hand", "fist"] * 6
    X = [rng.normal(20 + 10 * (name == "fist"), 1, (20, 5)) for name in names]
    every_frame = {"preprocess.baseline": "none", "preprocess.filter": "none"}
    classifier = TactileClassifier(system="svm", params=every_frame).fit(X, names)
    classifier.save(tmp_path / "classifier.pt")
    save(tmp_path / "new" / "1.npy", X[0])
    save(tmp_path / "new" / "2.npy", X[1])
    *_, last, _ = call(tmp_path / "classifier.pt", tmp_path / "new")
    assert last == "answers: 1 with an object, 1 with an empty hand"


def test_recordings_in_two_files_are_answered_as_whole_ones(folder):
    for index, name in enumerate(OBJECTS):
        left, right = np.split(recording(name, 80 + index), 2, axis=2)
        save(folder / "halves" / f"{index}_left.npy", left)
        save(folder / "halves" / f"{index}_right.npy", right)
    whole = call(folder / "classifier.pt", folder / "new")
    two_files = ("--set", "data.layout=OBJECT/FILE_PART")
    assert call(folder / "classifier.pt", folder / "halves", *two_files) == whole


NAMES = ["thumb", "index", "middle", "ring", "little", "palm"]


def grasps(seed):
    """Yield names and tables (40, 6) of eight grasps of two objects, which take turns.

    The objects press different sensors.
    """
    rng = np.random.default_rng(seed)
    for index in range(8):
        label = index % 2
        readings = 500 + rng.normal(0, 1, (40, 6))
        readings[10:, 3 * label : 3 * label + 3] += 40
        yield ("ball", "mug")[label], pd.DataFrame(readings.round(2), columns=NAMES)


@pytest.fixture(scope="module")
def of_names(tmp_path_factory):
    """Return a classifier of tables whose columns have names."""
    labels, tables = zip(*grasps(0), strict=True)
    path = tmp_path_factory.mktemp("named") / "c.pt"
    TactileClassifier().fit(list(tables), list(labels)).save(path)
    return path


# A change of a table of the model's sensors, and the columns of the result that are left out
COLUMNS = {
    "in another order": (lambda table: table[NAMES[::-1]], []),
    "more columns": (lambda table: table.assign(battery=3.7)[["battery", *NAMES]], ["battery"]),
    "words": (
        lambda table: table.assign(note="cold", when="12:30")[["note", *NAMES[::-1], "when"]],
        ["note", "when"],
    ),
    "a clock": (lambda table: table.assign(tick=np.arange(len(table)) * 7.0), ["tick"]),
    "empty": (lambda table: table.assign(spare=np.nan), []),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_sensors_are_taken_by_the_names_that_the_model_knows_and_others_are_named(
    of_names, tmp_path, name
):
    change, left_out = COLUMNS[name]
    (tmp_path / "same").mkdir()
    (tmp_path / "new").mkdir()
    for index, (label, table) in enumerate(grasps(1)):
        table.to_csv(tmp_path / "same" / f"{index}-{label}.csv", index=False)
        change(table).to_csv(tmp_path / "new" / f"{index}-{label}.csv", index=False)
    lines = call(of_names, tmp_path / "new")
    answers = [line for line in lines if "-" in line[:2]]
    assert answers == [line for line in call(of_names, tmp_path / "same") if "-" in line[:2]]
    assert len(answers) == 8
    for line in answers:
        file, _, answer, *_ = line.split()
        assert file[2:] == answer
    text = "\n".join(lines)
    named = [column for column in ("battery", "note", "when", "tick") if f"'{column}'" in text]
    assert named == left_out


def test_a_table_of_several_recordings_says_how_its_objects_are_named(of_names, tmp_path):
    """The model knows no column `activity`.

    With the key that the command prints, both objects are answered.
    """
    tables = [table.assign(activity=label) for label, table in islice(grasps(1), 2)]
    pd.concat(tables).to_csv(tmp_path / "all.csv", index=False)
    lines = call(of_names, tmp_path / "all.csv")
    assert "'data.columns=[object:activity]'" in " ".join(lines)
    lines = call(of_names, tmp_path / "all.csv", "--set", "data.columns=[object:activity]")
    third_words = [line.split()[2] for line in lines if len(line.split()) > 2]
    assert [word for word in third_words if word in ("ball", "mug")] == ["ball", "mug"]


def test_a_file_of_two_hands_has_sensors_by_the_joined_names(tmp_path):
    labels, tables = zip(*grasps(0), strict=True)
    joined_names = ["l_a", "l_b", "l_c", "r_a", "r_b", "r_c"]
    joined = [table.set_axis(joined_names, axis=1) for table in tables]
    TactileClassifier().fit(joined, list(labels)).save(tmp_path / "c.pt")
    (tmp_path / "new").mkdir()
    for index, (_, table) in enumerate(grasps(1)):
        for hand, columns in (("l", slice(0, 3)), ("r", slice(3, 6))):
            half = table.iloc[:, columns].set_axis(["a", "b", "c"], axis=1).assign(note="x")
            path = tmp_path / "new" / f"{index}_{hand}.csv"
            half[["note", "c", "b", "a"]].to_csv(path, index=False)
    lines = call(tmp_path / "c.pt", tmp_path / "new", "--set", "data.layout=OBJECT/FILE_PART")
    answers = [line.split()[2] for line in lines if line[:1].isdigit()]
    assert answers == list(labels)
    assert any("'note'" in line for line in lines)


def test_a_table_without_some_of_the_model_s_sensors_is_refused(of_names, tmp_path):
    (_, table), *_ = grasps(1)
    (tmp_path / "new").mkdir()
    table.rename(columns={"ring": "f4"}).to_csv(tmp_path / "new" / "1.csv", index=False)
    with pytest.raises(
        UserError, match=r"1\.csv: no column ring .*found thumb, index, middle, f4, little, palm"
    ):
        call(of_names, tmp_path / "new")


def test_a_sensor_of_the_model_that_is_empty_or_left_out_is_refused(of_names, tmp_path):
    (_, table), *_ = grasps(1)
    (tmp_path / "new").mkdir()
    table.assign(ring=np.nan).to_csv(tmp_path / "new" / "1.csv", index=False)
    with pytest.raises(
        UserError, match=r"column 4 \('ring'\), a sensor of the model, is empty in all 40"
    ):
        call(of_names, tmp_path / "new")
    table.to_csv(tmp_path / "new" / "1.csv", index=False)
    with pytest.raises(
        UserError, match=r"ring is a sensor of the model; remove its leave_out from data\.columns"
    ):
        call(of_names, tmp_path / "new", "--set", "data.columns=[leave_out:ring]")


def test_a_table_with_a_column_without_a_name_is_answered_as_it_was_learnt(tmp_path):
    for index, (label, table) in enumerate(grasps(0)):
        (tmp_path / "glove" / label).mkdir(parents=True, exist_ok=True)
        header = [name if name != "ring" else "" for name in NAMES]
        table.to_csv(tmp_path / "glove" / label / f"{index}.csv", index=False, header=header)
    changes = ("model.system=sensors", "model.members=[trees]")
    with recordings_of(str(tmp_path / "glove")) as recordings:
        assert recordings.channel_names == ["thumb", "index", "middle", "", "little", "palm"]
        train(
            recordings, default_params(changes), recordings.columns["recording"], tmp_path / "c.pt"
        )
    lines = call(tmp_path / "c.pt", tmp_path / "glove")
    assert lines[-1] == "right: 8 of 8 objects (100.0 %)"


def test_labelled_recordings_are_counted_and_the_file_holds_what_is_printed(folder):
    words = folder / "classifier.pt", folder / "labelled", "--csv", folder / "a.csv"
    *_, right, other = call(*words)
    assert call(*words)[-2:] == [right, other]  # the file of an earlier call is replaced
    assert right == "right: 3 of 3 objects (100.0 %)"  # the empty hand does not count
    assert other == "with a name that is no object of the model: 1"
    rows = {row["recording"]: row for row in answers_in(folder / "a.csv")}
    assert [name for name in rows["cup"] if "class" in name] == ["class_1", "class_2", "class_3"]
    assert [rows[name]["answer"] for name in OBJECTS] == list(OBJECTS)
    assert rows["empty"]["answer"] == "no contact"
    assert rows["empty"]["class_1"] == ""
    # four are right, as the command prints
    assert [rows[name]["right"] for name in (*OBJECTS, "empty", "zebra")] == [*["True"] * 4, ""]
    assert (rows["cup"]["frames_in_contact"], rows["cup"]["frames"]) == ("20", "60")
    probabilities = [float(rows["cup"][f"probability_{rank}"]) for rank in (1, 2, 3)]
    assert sum(probabilities) == pytest.approx(1, abs=1e-5)
    answers = (folder / "a.csv").read_text("utf-8")
    for text in (f"{answers}my notes\n", "object,colour\ncup,blue\n"):
        (folder / "a.csv").write_text(text, "utf-8")
        with pytest.raises(UserError, match="edited, or this command did not write it"):
            call(*words)
        assert (folder / "a.csv").read_text("utf-8") == text


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
def test_mistakes_are_refused_and_leave_no_file(folder, monkeypatch, words, error, message):
    write(folder / "other" / "1.h5", np.zeros((20, 8, 9), np.int16))
    monkeypatch.chdir(folder)
    with pytest.raises(error, match=message):
        call(*words.split(), "--csv", "a.csv")
    assert not list(folder.glob("a.csv*"))


@pytest.mark.filterwarnings("default")  # MLflow's own
def test_a_model_in_mlflow_is_found_by_its_run_or_its_name(folder, monkeypatch):
    monkeypatch.chdir(folder)
    monkeypatch.setenv("DVC_ROOT", str(folder))
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    with pytest.raises(UserError, match=r"models:/glove/1: no MLflow store: sqlite:///"):
        load_model("models:/glove/1")
    assert not (folder / "mlflow.db").exists()
    fresh_store(folder / "mlflow.db")
    with tracking.stage_run(Record("evaluate")) as run:
        address = run.model("glove · lr=0.5", folder / "classifier.pt", {"classes": list(OBJECTS)})
    import mlflow

    mlflow.set_tracking_uri(f"sqlite:///{folder / 'mlflow.db'}")
    mlflow.register_model(address, "glove")
    for name in (
        run.id,
        f"runs:/{run.id}",
        f"runs:/{run.id}/classifier",
        "models:/glove/1",
        address,
    ):
        assert load_model(name).classes == list(OBJECTS), name
    with pytest.raises(UserError, match=r"models:/glove/7: MLflow store sqlite:///"):
        load_model("models:/glove/7")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    with pytest.raises(UserError, match=r"no MLflow store: disabled"):
        load_model("models:/glove/1")
