"""One run on a glove of several persons gives the error rates for a new recording and a new person.

Every way to measure them gives the same rates.
"""

import json
import shlex
import shutil
from itertools import pairwise

import numpy as np
import pytest

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.evaluation.finished_run import read_run
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.pages.inspection_commands import command_lines
from tactile_viewgcn.pages.inspection_facts import facts, warnings
from tactile_viewgcn.pages.run_page import run_page
from tactile_viewgcn.pages.source_inspection import inspect_source
from tactile_viewgcn.params import preset_changes
from tactile_viewgcn.readers.source import Form
from tactile_viewgcn.recognition.prediction import predict
from tests.pages.test_html import text_of
from tests.readers.files import save
from tests.stages.running import FILES, ROOT, changed, record_of, run_stage

GESTURES = ("fist", "flat", "ok", "point", "thumb", "victory")
PERSONS = ("anna", "ben", "cleo", "dan")
REPEATS = 4
NEW = "a new session (a person, a day, a new fitting)"


def write_glove(folder, layout, *, unlike=1.0):
    """Write recordings of five sensors of bending fingers.

    Persons differ in offsets and gains, by a multiple of the differences of real persons.
    """
    rng = np.random.default_rng(4)
    bends = rng.uniform(0, 1, (6, 5))
    rise = np.clip(np.linspace(0, 1.5, 20), 0, 1)[:, None]
    for person in PERSONS:
        offset = 300 + unlike * rng.normal(0, 60, 5)
        gain = 250 + unlike * rng.normal(0, 75, 5)
        for label, repeat in np.ndindex(len(GESTURES), REPEATS):
            signal = gain * bends[label] * rise * rng.uniform(0.8, 1.2)
            counts = offset + signal + rng.normal(0, 6, (20, 5))
            path = folder / layout.format(person=person, gesture=GESTURES[label])
            save(path / f"{repeat}.npy", counts.round().astype(np.int16))
    return folder


@pytest.fixture(scope="module")
def glove(tmp_path_factory):
    return write_glove(tmp_path_factory.mktemp("glove"), "{person}/{gesture}")


def finished(glove, workspace, **split):
    """Return the metrics of a run of all stages by a line that `inspect` prints.

    The run writes its files into the folder `workspace`.
    """
    shutil.copy(ROOT / "params.yaml", workspace)
    line = " ".join(command_lines(inspect_source(glove), **split)).replace("\\", "")
    words = shlex.split(line)
    settings = [setting for option, setting in pairwise(words) if option == "-S"]
    words = changed(*preset_changes("best"), *settings, "device=cpu", "evaluate.trials=1")
    for stage, files in FILES.items():
        options = (*files.split(), "--record", record_of(stage))
        result = run_stage(stage, *options, *words, cwd=workspace)
        assert result.returncode == 0, result.stderr
    return json.loads((workspace / "results/metrics.json").read_text())


def test_one_run_has_the_errors_for_a_new_recording_and_for_a_new_person(
    glove, tmp_path, monkeypatch
):
    metrics = finished(glove, tmp_path)
    error = metrics["whole"]["error"]
    new_error = metrics["new_session"]["error"]
    assert error["high"] < new_error["mean"] < 0.5
    assert not metrics["new_sessions"]
    summary = json.loads((tmp_path / "results/summary.json").read_text())
    assert summary["error.new_session"] == new_error["mean"]
    monkeypatch.chdir(tmp_path)
    text = text_of(run_page(read_run()))
    assert "of a recording that it has not learnt from, in sessions that it has" in text
    assert f"of {NEW}" in text
    for shown in (error, new_error):
        assert percent_interval(shown["mean"], shown["low"], shown["high"]) in text
    conclusion = "not yet reliable. The whole interval lies below the error of chance. "
    assert f"{conclusion}For {NEW} the error is higher" in text
    assert "-S split.by=session" in text


def test_the_error_of_a_person_left_out_is_one_by_every_way(glove, tmp_path, monkeypatch):
    metrics = finished(glove, tmp_path, new_sessions=True)
    error = metrics["whole"]["error"]["mean"]
    assert 0.1 < error < 0.5
    assert metrics["new_sessions"]
    assert "new_session" not in metrics
    lines = []
    call = {"csv_path": None, "echo": lambda *texts: lines.extend(texts)}
    predict(str(tmp_path / "models/classifier.pt"), str(glove / PERSONS[0]), Form(), **call)
    right = round((1 - error) * len(GESTURES) * REPEATS)
    count = len(GESTURES) * REPEATS
    assert any(line.startswith(f"right: {right} of {count} ") for line in lines)
    monkeypatch.chdir(tmp_path)
    assert f"answered from all frames of {NEW}. It named" in text_of(run_page(read_run()))
    X_train = []
    y_train = []
    for person in PERSONS[1:]:
        X, y = recordings_of_person(glove / person)
        X_train += X
        y_train += y
    classifier = TactileClassifier().fit(X_train, y_train, groups=np.repeat(PERSONS[1:], count))
    X, y = recordings_of_person(glove / PERSONS[0])
    assert 1 - classifier.score(X, y) == pytest.approx(error)


def recordings_of_person(folder):
    """Return the recordings (20, 5) of a person, and the names of their gestures."""
    files = sorted(folder.glob("*/*.npy"))
    return [np.load(file) for file in files], [file.parent.name for file in files]


def test_inspect_gives_both_errors_and_of_one_person_one_line(glove):
    overview = inspect_source(glove)
    one_person = inspect_source(glove / PERSONS[0])
    assert overview.error.high < overview.session_error.error
    assert sum(NEW in what for _, what in facts(overview)) == 1
    assert one_person.session_error is None
    assert command_lines(one_person)
    assert command_lines(one_person, new_sessions=True) == []


@pytest.mark.parametrize(
    ("folders", "unlike", "order", "warned"),
    [
        ("{person}/{gesture}", 0.0, "SESSION/OBJECT/FILE", False),  # the persons are alike
        ("{gesture}/{person}", 0.0, "OBJECT/SESSION/FILE", True),
        # the readings tell both apart, so the user has to decide
        ("{person}/{gesture}", 1.0, "SESSION/OBJECT/FILE", True),
    ],
)
def test_what_readings_tell_apart_decides_which_folders_name_the_objects(
    tmp_path, folders, unlike, order, warned
):
    overview = inspect_source(write_glove(tmp_path, folders, unlike=unlike))
    assert tuple(overview.recordings.objects) == GESTURES
    assert tuple(overview.recordings.sessions) == PERSONS
    texts = [note.text for note in warnings(overview) if note.topic == "folders"]
    other = {"SESSION/OBJECT/FILE": "OBJECT/SESSION/FILE"}.get(order, "SESSION/OBJECT/FILE")
    assert len(texts) == warned
    assert all(f"'data.layout={other}'" in text for text in texts)
    assert f" -S data.layout={order} " in " ".join(command_lines(overview))
