"""The files of an evaluation, its row in MLflow and its lines of text, for known trials."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.evaluation.earlier_stages import costs, new_session, read_records, simulation
from tactile_viewgcn.evaluation.evaluate import scores_of
from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.results import summary, summary_lines, write_results
from tactile_viewgcn.evaluation.row import description, row_of
from tactile_viewgcn.evaluation.trials import Predictions, Trials
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.params import VIRTUAL
from tactile_viewgcn.provenance import Record
from tests.records import RECORD

CLASSES = ["cup", "pen, red", "tape"]
LABELS = np.array([0, 0, 1, 1], dtype=np.int16)
LATENCY = {
    "single": {"median": 1.5, "p95": 2.25},
    "batch": {"median": 0.5},
    "whole": {"median": 3.0},
}
COUNTS = {"resolved.model.members": "svm + trees"}
RECORDS = {
    "pretrain": replace(RECORD, seconds=12.34567, peak_mb=900.0, counts={"weights.backbone": 7}),
    "finetune": replace(RECORD, stage="finetune", seconds=1234.5, peak_mb=1300.5, counts=COUNTS),
}
_ROW = {"low": 0.1, "high": 0.9, "unit": "s"}
LIVE = [
    _ROW | {"answer": "so far", "level": 0.25, "error": 0.75, "share": 0.5, "contact": 0.2},
    _ROW | {"answer": "final", "level": None, "error": 0.5, "share": 1.0, "contact": 1.5},
    _ROW | {"answer": "predict", "level": None, "error": 0.25, "share": None, "contact": None},
]
TIMING = costs(LATENCY, RECORDS, 50.0, 1000.0)


@pytest.fixture
def evaluation():
    """Return the predictions and metrics of two trials of four anchors, and of two recordings.

    Under the protocol object three and two answers are right, under recording two and one.
    """
    # the three best classes with each first one; cup is not among them if tape is the first
    best = np.array([[0, 1, 2], [1, 0, 2], [2, 1, 3]])
    groups = np.array([0, 0, 1, 1])
    of_object = best[[[0, 0, 1, 2], [0, 2, 1, 2]]]
    of_recording = best[[[0, 2, 1, 2], [2, 2, 1, 0]]]
    of_whole = best[[[0, 2]]]
    trials = {
        "object": Trials(of_object, LABELS, groups, groups, 4),
        "recording": Trials(of_recording, LABELS, groups, groups, 4),
        "whole": Trials(of_whole, LABELS[::2], groups[::2], groups[::2], 30),
    }
    trials["recording"].fewer[1] = np.array([[1, 0, 0, 0], [0, 0, 0, 0]])
    predictions = Predictions(trials, np.array(CLASSES))
    metrics = {
        "views": 4,
        "classes": 4,
        "trials": 2,
        "frames": {"train": 9, "test": 4},
        "recordings": {"test": 2},
        "groups": {"test": 2},
    }
    for protocol, answers in trials.items():
        metrics[protocol] = scores_of(answers, np.random.default_rng(0), 4)
    return predictions, metrics


@pytest.mark.parametrize(("source", "total"), [(VIRTUAL, 1341.8), ("my_glove", 1296.8)])
def test_the_total_has_the_simulation_where_its_recordings_were_read(
    tmp_path, monkeypatch, source, total
):
    monkeypatch.chdir(tmp_path)
    ingest = replace(RECORD, stage="ingest", seconds=0.0, inputs={"source": {"path": source}})
    simulate = replace(RECORD, stage="simulate", seconds=45.0)
    (tmp_path / VIRTUAL).parent.mkdir(parents=True)
    (tmp_path / f"{VIRTUAL}.json").write_text(simulate.text)
    records = simulation({"ingest": ingest}) | RECORDS
    assert costs(LATENCY, records, 50.0, 1.0)["seconds"]["total"] == pytest.approx(total, abs=0.1)


def test_the_error_rate_for_a_new_session_is_that_of_the_training_run():
    error = {"mean": 0.3, "low": 0.1, "high": 0.5}
    note = Note("", topic="new session", value=error)
    records = {"finetune": replace(RECORD, notes=[note])}
    assert new_session(records) == {"new_session": {"error": error}}


@pytest.mark.parametrize("content", ["", '{"stage": "ingest", "seconds": 1}', "[]"])
def test_records_are_read_by_stage_and_a_damaged_one_is_named(tmp_path, content):
    (tmp_path / "pretrain.json").write_text(RECORD.text)
    assert read_records(tmp_path) == {"pretrain": RECORD}
    (tmp_path / "ingest.json").write_text(content)
    with pytest.raises(UserError, match=r"ingest\.json: damaged"):
        read_records(tmp_path)


def test_the_tables_have_a_row_for_each_trial_pair_and_class_with_test_frames(tmp_path, evaluation):
    def rows(name):
        return list(csv.reader((tmp_path / name).read_text().splitlines()))

    predictions, metrics = evaluation
    shown = summary(metrics, TIMING)
    write_results(tmp_path, predictions, metrics, TIMING, shown, LIVE)
    assert json.loads((tmp_path / "metrics.json").read_text()) == metrics
    assert json.loads((tmp_path / "timing.json").read_text()) == TIMING
    assert json.loads((tmp_path / "summary.json").read_text()) == shown
    assert rows("trials.csv") == [
        ["protocol", "trial", "error"],
        ["object", "0", "0.25"],
        ["object", "1", "0.5"],
        ["recording", "0", "0.5"],
        ["recording", "1", "0.75"],
        ["whole", "0", "0.5"],
    ]
    heading, *by_views = rows("views.csv")
    assert heading == ["protocol", "views", "error", "low", "high"]
    assert [row[:3] for row in by_views] == [
        ["object", "4", "0.375"],
        ["recording", "1", "0.875"],
        ["recording", "4", "0.625"],
        ["recording", "30", "0.5"],
    ]
    assert by_views[0][3:] == [str(metrics["object"]["error"][end]) for end in ("low", "high")]
    assert rows("live.csv") == [
        ["answer", "level", "error", "low", "high", "share", "contact", "unit"],
        ["so far", "0.25", "0.75", "0.1", "0.9", "0.5", "0.2", "s"],
        ["final", "", "0.5", "0.1", "0.9", "1.0", "1.5", "s"],
        ["predict", "", "0.25", "0.1", "0.9", "", "", "s"],
    ]
    heading, *by_object = rows("per_class.csv")
    assert heading == ["protocol", "object", "answers", "error"]
    assert len(by_object) == 3 * 2
    assert by_object[2:4] == [
        ["recording", "cup", "4", "0.75"],
        ["recording", "pen, red", "4", "0.5"],
    ]
    heading, *confusion = rows("confusion.csv")
    assert heading == ["protocol", "object", "predicted", "count"]
    assert len(confusion) == 3 * 9
    assert sum(int(count) for *_, count in confusion) == 2 * 2 * 4 + 2
    assert ["object", "cup", "tape", "1"] in confusion
    assert ["object", "pen, red", "tape", "2"] in confusion


def test_the_lines_have_errors_with_intervals_and_live_answers(evaluation):
    _, metrics = evaluation
    error = metrics["object"]["error"]
    text = f"37.5 ({100 * error['low']:.1f} to {100 * error['high']:.1f})"
    lines = "\n".join(summary_lines(metrics, TIMING, LIVE))
    assert f"object protocol: error {text} %, std over trials 17.7, top-3 error 12.5 %" in lines
    live = "live: error 75.0 (10.0 to 90.0) % after 0.25 s of contact, 50.0 (10.0 to 90.0) % when"
    assert f"  {live} the hand opens" in lines


@pytest.fixture
def finished(evaluation):
    """Return the finished run of the evaluation, whose members `auto` chose."""
    predictions, metrics = evaluation
    values = {"model.members": "auto", "data.source": "glove", "split.by": "recording"}
    params = {"values": values, "changed": {}}
    records = RECORDS | {"evaluate": Record("evaluate", run_id="12ab", params=params)}
    return FinishedRun("", metrics, TIMING, predictions, records, LIVE)


def test_the_row_has_errors_costs_and_what_auto_chose(finished):
    metrics = finished.metrics
    row = row_of(finished, summary(metrics, TIMING), None)
    assert row.tags == {"resolved.model.members": "svm + trees"}
    assert row.parameters == {
        "classes": 4,
        "frames.train": 9,
        "frames.test": 4,
        "recordings.test": 2,
        "groups.test": 2,
        "weights.backbone": 7,
    }
    expected = {
        "error.object": 3 / 8,
        "error.recording": 5 / 8,
        "error.whole": 1 / 2,
        "top3_error.object": 1 / 8,
        "top3_error.recording": 3 / 8,
        "top3_error.whole": 0,
        "ms_per_answer": 1.5,
        "ms_per_recording": 3.0,
        "seconds.pretrain": 12.346,
        "seconds.finetune": 1234.5,
        "seconds.evaluate": 50.0,
        "seconds.total": 1296.846,
        "peak_mb": 1300.5,  # of the hungriest stage
    }
    for name in ("whole", "recording", "object"):
        for end in ("low", "high"):
            expected[f"error.{name}.{end}"] = round(metrics[name]["error"][end], 4)
    scores = {name: value for name, value, step in row.metrics if step == 0}
    assert scores == pytest.approx(expected)
    assert [metric for metric in row.metrics if metric[2] > 0] == [
        ("trials.error.object", 0.25, 1),
        ("trials.error.object", 0.5, 2),
        ("trials.error.recording", 0.5, 1),
        ("trials.error.recording", 0.75, 2),
        ("trials.error.whole", 0.5, 1),
        ("views.error.object", 0.375, 4),
        ("views.error.recording", 0.875, 1),
        ("views.error.recording", 0.625, 4),
        ("views.error.recording", 0.5, 30),
    ]


def test_the_description_has_the_error_on_whole_recordings_the_seconds_and_the_report(finished):
    error = finished.metrics["whole"]["error"]
    interval = percent_interval(error["mean"], error["low"], error["high"])
    assert description(finished, "glove · best") == (
        f"**glove · best**: {interval} % error on whole recordings, "
        "1,297 s.\n\n`tactile-viewgcn report 12ab`"
    )


def test_the_peak_is_that_of_the_evaluation_if_it_needs_the_most_memory():
    assert costs(LATENCY, RECORDS, 50.0, 2000.04)["peak_mb"] == 2000.0
