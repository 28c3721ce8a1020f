"""A glove of several persons: the errors for a new recording and for a new person.

Both come from one run, in every way.
"""

import json
import shlex
import shutil

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


def write_glove(place, layout, *, unlike=1.0):
    """Write recordings of five sensors of bending fingers.

    Persons differ in offsets and gains, by a multiple of the differences of real persons.
    """
    rng = np.random.default_rng(4)
    bends, rise = rng.uniform(0, 1, (6, 5)), np.clip(np.linspace(0, 1.5, 20), 0, 1)[:, None]
    for person in PERSONS:
        offset, gain = 300 + unlike * rng.normal(0, 60, 5), 250 + unlike * rng.normal(0, 75, 5)
        for label, number in np.ndindex(len(GESTURES), REPEATS):
            counts = (
                offset
                + gain * bends[label] * rise * rng.uniform(0.8, 1.2)
                + rng.normal(0, 6, (20, 5))
            )
            folder = place / layout.format(person=person, gesture=GESTURES[label])
            save(folder / f"{number}.npy", counts.round().astype(np.int16))
    return place


@pytest.fixture(scope="module")
def glove(tmp_path_factory):
    return write_glove(tmp_path_factory.mktemp("glove"), "{person}/{gesture}")


def finished(glove, place, **split):
    """Return the metrics of a run of all stages by a line that `inspect` prints.

    The files of the run are in `place`.
    """
    shutil.copy(ROOT / "params.yaml", place)
    words = shlex.split(" ".join(command_lines(inspect_source(glove), **split)).replace("\\", ""))
    settings = [words[at + 1] for at, word in enumerate(words) if word == "-S"]
    words = changed(*preset_changes("best"), *settings, "device=cpu", "evaluate.trials=1")
    for stage, files in FILES.items():
        result = run_stage(stage, *files.split(), "--record", record_of(stage), *words, cwd=place)
        assert result.returncode == 0, result.stderr
    return json.loads((place / "results/metrics.json").read_text())


def test_one_run_has_the_errors_for_a_new_recording_and_for_a_new_person(
    glove, tmp_path, monkeypatch
):
    metrics = finished(glove, tmp_path)
    new, error = (metrics[name]["error"] for name in ("new_session", "whole"))
    assert error["high"] < new["mean"] < 0.5 and not metrics["new_sessions"]
    assert (
        json.loads((tmp_path / "results/summary.json").read_text())["error.new_session"]
        == new["mean"]
    )
    monkeypatch.chdir(tmp_path)
    text = text_of(run_page(read_run()))
    for each, what in (
        (error, "of a recording that it has not learnt from, in sessions that it has"),
        (new, f"of {NEW}"),
    ):
        assert (
            what in text
            and percent_interval(*(each[key] for key in ("mean", "low", "high"))) in text
        )
    assert (
        "not yet reliable. The whole interval lies below the error of chance. "
        f"For {NEW} the error is higher" in text
    )
    assert "-S split.by=session" in text


def test_the_error_of_a_person_left_out_is_one_by_every_way(glove, tmp_path, monkeypatch):
    metrics = finished(glove, tmp_path, new_sessions=True)
    error = metrics["whole"]["error"]["mean"]
    assert 0.1 < error < 0.5 and metrics["new_sessions"] and "new_session" not in metrics
    lines = []
    call = {"csv_path": None, "echo": lambda *texts: lines.extend(texts)}
    predict(str(tmp_path / "models/classifier.pt"), str(glove / PERSONS[0]), Form(), **call)
    right, count = round((1 - error) * len(GESTURES) * REPEATS), len(GESTURES) * REPEATS
    assert any(line.startswith(f"right: {right} of {count} ") for line in lines)
    monkeypatch.chdir(tmp_path)
    assert f"answered from all frames of {NEW}. It named" in text_of(run_page(read_run()))
    files = {person: sorted((glove / person).glob("*/*.npy")) for person in PERSONS}
    X = {person: [np.load(file) for file in files[person]] for person in PERSONS}
    y = [file.parent.name for file in files[PERSONS[0]]]
    X_train = [recording for person in PERSONS[1:] for recording in X[person]]
    classifier = TactileClassifier().fit(X_train, y * 3, groups=np.repeat(PERSONS[1:], count))
    assert 1 - classifier.score(X[PERSONS[0]], y) == pytest.approx(error)


def test_inspect_gives_both_errors_and_of_one_person_one_line(glove):
    overview, alone = inspect_source(glove), inspect_source(glove / PERSONS[0])
    assert (
        overview.error.high < overview.session_error.error
        and sum(NEW in what for _, what in facts(overview)) == 1
    )
    assert (
        alone.session_error is None
        and command_lines(alone)
        and command_lines(alone, new_sessions=True) == []
    )


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
    assert (
        tuple(overview.recordings.objects) == GESTURES
        and tuple(overview.recordings.sessions) == PERSONS
    )
    texts = [note.text for note in warnings(overview) if note.topic == "folders"]
    other = {"SESSION/OBJECT/FILE": "OBJECT/SESSION/FILE"}.get(order, "SESSION/OBJECT/FILE")
    assert len(texts) == warned and all(f"'data.layout={other}'" in text for text in texts)
    assert f" -S data.layout={order} " in " ".join(command_lines(overview))
