"""What an evaluation leaves behind: metrics, timings, tables, five lines."""

import csv
import json

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.evaluation.evaluate import Evaluation, evaluate_table, summary
from tactile_viewgcn.evaluation.report import (
    costs,
    flat_numbers,
    metrics_tree,
    read_records,
    summary_lines,
    write_costs,
    write_results,
)
from tactile_viewgcn.evaluation.row import counts, dataset, divergences, row_metrics, row_tags
from tactile_viewgcn.evaluation.row import summary as summary_of
from tactile_viewgcn.evaluation.trials import Trials
from tactile_viewgcn.frames.split import TEST, TRAIN
from tests.small_tables import CPU, fewer_anchors, recipe, table, trained

CLASSES = ["cup", "pen, red", "tape"]
LABELS = np.array([0, 0, 1, 1], dtype=np.int16)
LATENCY = {"single": {"median": 1.5, "p95": 2.25}, "batch": {"median": 0.5}}
RECORDS = {
    "pretrain": {
        "stage": "pretrain",
        "run_id": "a",
        "seconds": 12.34567,
        "peak_mb": 900.0,
        "inputs": {},
        "counts": {"weights.backbone": 7},
    },
    "finetune": {
        "stage": "finetune",
        "run_id": "b",
        "seconds": 1234.5,
        "peak_mb": 1300.5,
        "inputs": {},
        "counts": {},
    },
}
DEMANDED = {"views", "classes", "trials", "frames.train", "frames.test", "groups.test"} | {
    f"{protocol}.{key}"
    for protocol in ("object", "recording")
    for key in ("top1.mean", "top1.std", "top1.ci95.low", "top1.ci95.high", "top3.mean", "error.mean")
}
TIMED = {
    "seconds.pretrain",
    "seconds.finetune",
    "seconds.evaluate",
    "seconds.total",
    "trials_seconds",
    "latency_ms.single.median",
    "latency_ms.single.p95",
    "latency_ms.batch.median",
    "peak_mb",
}


def trials(predicted, in_top3):
    predicted = np.array(predicted)
    return Trials(predicted, predicted == LABELS, np.array(in_top3, dtype=bool), 0)


def made_up(groups=(0, 0, 1, 1), names=("object", "recording")):
    """Two trials of four anchors: three and two of them right by object, two and one by recording."""
    protocols = {
        "object": trials([[0, 0, 1, 2], [0, 2, 1, 2]], [[1, 1, 1, 1], [1, 1, 1, 0]]),
        "recording": trials([[0, 2, 1, 2], [2, 2, 1, 0]], [[1, 1, 1, 1], [1, 1, 1, 0]]),
    }
    protocols = {protocol: protocols[protocol] for protocol in names}
    groups = np.array(groups)
    scores = {protocol: summary(runs, groups, np.random.default_rng(0)) for protocol, runs in protocols.items()}
    return Evaluation(protocols, LABELS, groups, scores, 7.65432, LATENCY)


def written(folder, result=None):
    result = result or made_up()
    metrics, timing = metrics_tree(result, table(), 4), costs(result, RECORDS, 50.0, 1000.0)
    write_results(folder, metrics, result, CLASSES)
    write_costs(folder, timing, summary_of(metrics, timing))
    return metrics, timing


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_metrics_hold_what_is_compared():
    result = flat_numbers(metrics_tree(made_up(), table(), 4))
    assert result.keys() >= DEMANDED
    assert all(isinstance(value, int | float) and not isinstance(value, bool) for value in result.values())
    assert (result["views"], result["classes"], result["trials"], result["groups.test"]) == (4, 4, 2, 2)
    assert result["object.top1.mean"] == pytest.approx(5 / 8)
    assert result["object.error.mean"] == pytest.approx(3 / 8)
    assert result["object.top3.mean"] == pytest.approx(7 / 8)
    assert result["recording.top1.mean"] == pytest.approx(3 / 8)
    assert result["object.top1.std"] == pytest.approx(np.std([0.75, 0.5], ddof=1))


def test_metrics_count_anchors_and_kept_frames_of_both_sides():
    frames = fewer_anchors(table(), 5)
    counts = metrics_tree(made_up(), frames, 4)["frames"]
    for name, side in (("train", TRAIN), ("test", TEST)):
        assert counts[name] == (frames.anchor & (frames.side == side)).sum()
        assert counts[f"kept_{name}"] == (frames.side == side).sum()
    assert counts["test"] < counts["kept_test"] == 96


def test_metrics_report_the_clusters_that_had_no_frames(monkeypatch):
    monkeypatch.setattr("tactile_viewgcn.evaluation.evaluate.latency", lambda *_: LATENCY)
    params, frames = recipe("evaluate.trials=2"), table()
    kept = np.flatnonzero((frames.side == TRAIN) | (np.arange(len(frames)) % 12 < 3))  # 3 test frames a recording
    few = type(frames)(
        **{
            name: value[kept] if isinstance(value, np.ndarray) and len(value) == len(frames) else value
            for name, value in vars(frames).items()
        }
    )
    result = evaluate_table(trained(), few, params.cluster, params.evaluate, CPU, 0)
    assert result.protocols["recording"].empty == 2 * 8
    assert flat_numbers(metrics_tree(result, few, 4))["recording.empty_clusters"] == 2 * 8


def test_costs_name_each_stage_and_the_hungriest_one_s_memory():
    timing = costs(made_up(), RECORDS, 50.0, 1000.0)
    assert flat_numbers(timing).keys() == TIMED
    assert timing["seconds"] == {"pretrain": 12.346, "finetune": 1234.5, "evaluate": 50.0, "total": 1296.846}
    assert timing["trials_seconds"] == 7.654
    assert timing["latency_ms"] == LATENCY
    assert timing["peak_mb"] == 1300.5
    assert costs(made_up(), RECORDS, 50.0, 2000.04)["peak_mb"] == 2000.0


def test_records_are_read_by_their_stage(tmp_path):
    paths = [tmp_path / f"{number}.json" for number in range(2)]
    for path, record in zip(paths, RECORDS.values(), strict=True):
        path.write_text(json.dumps(record))
    assert read_records(paths) == RECORDS
    assert read_records([]) == {}


@pytest.mark.parametrize("content", ["", '{"stage": "ingest"', '{"stage": "ingest", "seconds": 1}', "[]"])
def test_a_damaged_record_is_named(tmp_path, content):
    (tmp_path / "ingest.json").write_text(content)
    with pytest.raises(UserError, match=r"ingest\.json: damaged"):
        read_records([tmp_path / "ingest.json"])


def test_the_files_hold_the_trees_they_were_made_from(tmp_path):
    metrics, timing = written(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "metrics.json",
        "timing.json",
        "summary.json",
        "trials.csv",
        "confusion.csv",
        "per_class.csv",
    }
    assert json.loads((tmp_path / "metrics.json").read_text()) == metrics
    assert json.loads((tmp_path / "timing.json").read_text()) == timing
    interval = metrics["object"]["top1"]["ci95"]
    assert 0 <= interval["low"] <= interval["high"] <= 1


def test_results_but_for_timings_repeat_to_the_byte(tmp_path):
    for name in ("one", "two"):
        written(tmp_path / name)
    for name in ("metrics.json", "trials.csv", "confusion.csv", "per_class.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_the_table_of_trials_has_a_row_for_each(tmp_path):
    written(tmp_path)
    result = rows(tmp_path / "trials.csv")
    assert [(row["protocol"], row["trial"]) for row in result] == [
        ("object", "0"),
        ("object", "1"),
        ("recording", "0"),
        ("recording", "1"),
    ]
    assert [float(row["top1"]) for row in result] == [0.75, 0.5, 0.5, 0.25]
    assert [float(row["error"]) for row in result] == [0.25, 0.5, 0.5, 0.75]
    assert [float(row["top3"]) for row in result] == [1, 0.75, 1, 0.75]


def test_the_confusion_table_has_every_pair_by_name(tmp_path):
    written(tmp_path)
    result = rows(tmp_path / "confusion.csv")
    assert len(result) == 2 * 9
    counts = {(r["protocol"], r["held"], r["predicted"]): int(r["count"]) for r in result}
    assert counts["object", "cup", "cup"] == 3
    assert counts["object", "cup", "tape"] == 1
    assert counts["object", "pen, red", "tape"] == 2
    assert counts["recording", "pen, red", "cup"] == 1
    assert sum(counts.values()) == 2 * 2 * 4


def test_the_table_of_classes_leaves_out_those_without_test_frames(tmp_path):
    written(tmp_path)
    result = rows(tmp_path / "per_class.csv")
    assert [(r["protocol"], r["object"], int(r["view_sets"]), float(r["top1"])) for r in result] == [
        ("object", "cup", 4, 0.75),
        ("object", "pen, red", 4, 0.5),
        ("recording", "cup", 4, 0.25),
        ("recording", "pen, red", 4, 0.5),
    ]


def test_numbers_are_flat_and_have_no_gaps():
    tree = {"a": 1, "b": {"c": 0.5, "d": {"e": {"low": 0.25}, "f": None}}}
    assert flat_numbers(tree) == {"a": 1, "b.c": 0.5, "b.d.e.low": 0.25}


def test_the_summary_is_five_lines():
    result = made_up()
    text = summary_lines(metrics_tree(result, table(), 4), costs(result, RECORDS, 50.0, 1000.0))
    low, high = result.scores["object"]["top1"]["ci95"].values()
    assert text == [
        "evaluate: 96 view sets of 4, 4 classes, 2 trials, 2 groups",
        f"  object protocol: error 37.5 % (95 % interval over groups: {100 - 100 * high:.1f} to {100 - 100 * low:.1f}; "
        "std over trials 17.7), top-3 error 12.5 %",
        text[2],
        "  time: pretrain 12.3 s, finetune 1,234.5 s, evaluate 50.0 s, total 1,296.8 s; the trials 7.7 s",
        "  per view set: 1.50 ms alone (95th percentile 2.25), 0.50 ms in batches; peak memory 1,300 MB",
    ]
    assert text[2].startswith("  recording protocol: error 62.5 %")


def test_a_test_side_of_one_group_has_no_interval(tmp_path):
    result = made_up(groups=(3, 3, 3, 3), names=("recording",))
    metrics, timing = written(tmp_path, result)
    assert json.loads((tmp_path / "metrics.json").read_text())["recording"]["top1"]["ci95"] is None
    assert "recording.top1.ci95.low" not in flat_numbers(metrics)
    assert "none, there is one group" in summary_lines(metrics, timing)[1]
    assert "object" not in metrics


def test_the_row_has_errors_and_costs_as_metrics_and_constants_beside_them():
    metrics = metrics_tree(made_up(), table(), 4)
    row = row_metrics(metrics, costs(made_up(), RECORDS, 50.0, 1000.0))
    assert row == pytest.approx(
        {
            "error.object": 3 / 8,
            "error.recording": 5 / 8,
            "top3_error.object": 1 / 8,
            "top3_error.recording": 1 / 8,
            "ms_per_view_set": 1.5,
            "seconds.pretrain": 12.346,
            "seconds.finetune": 1234.5,
            "seconds.evaluate": 50.0,
            "seconds.total": 1296.846,
            "peak_mb": 1300.5,
        }
    )
    constants = counts(metrics, RECORDS)
    assert (constants["classes"], constants["frames.test"], constants["weights.backbone"]) == (4, 96, 7)
    assert not constants.keys() & row.keys()


def test_the_dataset_is_the_source_that_ingest_read():
    source = {"path": "data/stag", "md5": "0123456789abcdef"}
    assert dataset({"ingest": {"inputs": {"source": source}}}, "frames.h5", "ff") == ("data/stag", "01234567")
    assert dataset({}, "frames.h5", "fedcba9876543210") == ("frames.h5", "fedcba98")


def test_the_row_names_the_other_stages_runs_and_what_diverged():
    records = RECORDS | {"pretrain": RECORDS["pretrain"] | {"counts": {"diverged_in_epoch": 3.0}}}
    metrics = metrics_tree(made_up(), table(), 4) | divergences(records)
    tags = row_tags(metrics, records)
    assert (tags["stage.pretrain"], tags["stage.finetune"]) == ("a", "b")
    assert tags["diverged.pretrain"] == "in epoch 3" and "diverged.finetune" not in tags
    interval = metrics["object"]["top1"]["ci95"]
    assert tags["error.object.ci95"] == f"{100 - 100 * interval['high']:.1f} to {100 - 100 * interval['low']:.1f}"
    assert "pretrain diverged in epoch 3" in summary_lines(metrics, costs(made_up(), records, 50.0, 1000.0))[-1]
