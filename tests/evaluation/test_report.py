"""What an evaluation leaves behind: metrics, timings, tables, five lines."""

import csv
import json

import numpy as np
import pytest

from tactile_viewgcn import evaluation
from tactile_viewgcn.evaluation import Evaluation, Trials, evaluate_table, summary
from tactile_viewgcn.results import costs, lines, metrics_tree, numbers, read_records, write_results
from tactile_viewgcn.split import TEST, TRAIN
from tests.tables import CPU, fewer_anchors, recipe, table, trained

CLASSES = ["cup", "pen, red", "tape"]
LABELS = np.array([0, 0, 1, 1], dtype=np.int16)
LATENCY = {"single": {"median": 1.5, "p95": 2.25}, "batch": {"median": 0.5}}
RECORDS = {
    "pretrain": {"stage": "pretrain", "run_id": "a", "seconds": 12.34567, "peak_mb": 900.0},
    "finetune": {"stage": "finetune", "run_id": "b", "seconds": 1234.5, "peak_mb": 1300.5},
}
DEMANDED = {"views", "classes", "trials", "frames.train", "frames.test", "groups.test"} | {
    f"{scope}.{key}"
    for scope in ("object", "recording")
    for key in ("top1.mean", "top1.spread", "top1.ci95.low", "top1.ci95.high", "top3.mean", "error.mean")
}
TIMED = {
    "seconds.pretrain",
    "seconds.finetune",
    "seconds.evaluate",
    "latency_ms.single.median",
    "latency_ms.single.p95",
    "latency_ms.batch.median",
    "peak_mb",
}


def trials(predicted, near):
    predicted = np.array(predicted)
    return Trials(predicted, predicted == LABELS, np.array(near, dtype=bool), 0)


def made_up(groups=(0, 0, 1, 1), scopes=("object", "recording")):
    """Two trials of four anchors: three and two of them right by object, two and one by recording."""
    protocols = {
        "object": trials([[0, 0, 1, 2], [0, 2, 1, 2]], [[1, 1, 1, 1], [1, 1, 1, 0]]),
        "recording": trials([[0, 2, 1, 2], [2, 2, 1, 0]], [[1, 1, 1, 1], [1, 1, 1, 0]]),
    }
    protocols = {scope: protocols[scope] for scope in scopes}
    groups = np.array(groups)
    scores = {scope: summary(runs, groups, np.random.default_rng(0)) for scope, runs in protocols.items()}
    return Evaluation(protocols, LABELS, groups, scores, 7.65432, LATENCY)


def written(folder, found=None):
    found = found or made_up()
    metrics, timing = metrics_tree(found, table(), 4), costs(found, RECORDS, 1000.0)
    write_results(folder, metrics, timing, found, CLASSES)
    return metrics, timing


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_metrics_hold_what_is_compared():
    found = numbers(metrics_tree(made_up(), table(), 4))
    assert found.keys() >= DEMANDED
    assert all(isinstance(value, int | float) and not isinstance(value, bool) for value in found.values())
    assert (found["views"], found["classes"], found["trials"], found["groups.test"]) == (4, 4, 2, 2)
    assert found["object.top1.mean"] == pytest.approx(5 / 8)
    assert found["object.error.mean"] == pytest.approx(3 / 8)
    assert found["object.top3.mean"] == pytest.approx(7 / 8)
    assert found["recording.top1.mean"] == pytest.approx(3 / 8)
    assert found["object.top1.spread"] == pytest.approx(np.std([0.75, 0.5], ddof=1))


def test_metrics_count_anchors_and_kept_frames_of_both_sides():
    frames = fewer_anchors(table(), 5)
    counts = metrics_tree(made_up(), frames, 4)["frames"]
    for name, side in (("train", TRAIN), ("test", TEST)):
        assert counts[name] == (frames.anchor & (frames.side == side)).sum()
        assert counts[f"kept_{name}"] == (frames.side == side).sum()
    assert counts["test"] < counts["kept_test"] == 96


def test_metrics_report_the_clusters_that_had_no_frames(monkeypatch):
    monkeypatch.setattr(evaluation, "latency", lambda *_: LATENCY)
    how, frames = recipe("evaluate.trials=2"), table()
    kept = np.flatnonzero((frames.side == TRAIN) | (np.arange(len(frames)) % 12 < 3))  # 3 test frames a recording
    few = type(frames)(
        **{
            name: value[kept] if isinstance(value, np.ndarray) and len(value) == len(frames) else value
            for name, value in vars(frames).items()
        }
    )
    found = evaluate_table(trained(), few, how.cluster, how.evaluate, CPU, 0)
    assert found.protocols["recording"].empty == 2 * 8
    assert numbers(metrics_tree(found, few, 4))["recording.empty_clusters"] == 2 * 8


def test_costs_name_each_stage_and_the_hungriest_one_s_memory():
    timing = costs(made_up(), RECORDS, 1000.0)
    assert numbers(timing).keys() == TIMED
    assert timing["seconds"] == {"pretrain": 12.346, "finetune": 1234.5, "evaluate": 7.654}
    assert timing["latency_ms"] == LATENCY
    assert timing["peak_mb"] == 1300.5
    assert costs(made_up(), RECORDS, 2000.04)["peak_mb"] == 2000.0


def test_records_are_read_by_their_stage(tmp_path):
    paths = [tmp_path / f"{number}.json" for number in range(2)]
    for path, record in zip(paths, RECORDS.values(), strict=True):
        path.write_text(json.dumps(record))
    assert read_records(paths) == RECORDS
    assert read_records([]) == {}


def test_the_files_hold_the_trees_they_were_made_from(tmp_path):
    metrics, timing = written(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "metrics.json",
        "timing.json",
        "trials.csv",
        "confusion.csv",
        "per_class.csv",
    }
    assert json.loads((tmp_path / "metrics.json").read_text()) == metrics
    assert json.loads((tmp_path / "timing.json").read_text()) == timing
    low, high = metrics["object"]["top1"]["ci95"]
    assert 0 <= low <= high <= 1


def test_results_but_for_timings_repeat_to_the_byte(tmp_path):
    for name in ("one", "two"):
        written(tmp_path / name)
    for name in ("metrics.json", "trials.csv", "confusion.csv", "per_class.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_the_table_of_trials_has_a_row_for_each(tmp_path):
    written(tmp_path)
    found = rows(tmp_path / "trials.csv")
    assert [(row["protocol"], row["trial"]) for row in found] == [
        ("object", "0"),
        ("object", "1"),
        ("recording", "0"),
        ("recording", "1"),
    ]
    assert [float(row["top1"]) for row in found] == [0.75, 0.5, 0.5, 0.25]
    assert [float(row["error"]) for row in found] == [0.25, 0.5, 0.5, 0.75]
    assert [float(row["top3"]) for row in found] == [1, 0.75, 1, 0.75]


def test_the_confusion_table_has_every_pair_by_name(tmp_path):
    written(tmp_path)
    found = rows(tmp_path / "confusion.csv")
    assert len(found) == 2 * 9
    counts = {(r["protocol"], r["held"], r["predicted"]): int(r["count"]) for r in found}
    assert counts["object", "cup", "cup"] == 3
    assert counts["object", "cup", "tape"] == 1
    assert counts["object", "pen, red", "tape"] == 2
    assert counts["recording", "pen, red", "cup"] == 1
    assert sum(counts.values()) == 2 * 2 * 4


def test_the_table_of_classes_leaves_out_those_without_test_frames(tmp_path):
    written(tmp_path)
    found = rows(tmp_path / "per_class.csv")
    assert [(r["protocol"], r["object"], int(r["view_sets"]), float(r["top1"])) for r in found] == [
        ("object", "cup", 4, 0.75),
        ("object", "pen, red", 4, 0.5),
        ("recording", "cup", 4, 0.25),
        ("recording", "pen, red", 4, 0.5),
    ]


def test_numbers_are_flat_and_have_no_gaps():
    tree = {"a": 1, "b": {"c": 0.5, "d": {"e": [0.25, 0.75], "f": None}}}
    assert numbers(tree) == {"a": 1, "b.c": 0.5, "b.d.e.low": 0.25, "b.d.e.high": 0.75}


def test_the_summary_is_five_lines():
    found = made_up()
    text = lines(metrics_tree(found, table(), 4), costs(found, RECORDS, 1000.0))
    low, high = found.scores["object"]["top1"]["ci95"]
    assert text == [
        "evaluate: 96 view sets of 4, 4 classes, 2 trials, 2 groups",
        f"  object protocol: error 37.5 % (95 % interval over groups: {100 - 100 * high:.1f} to {100 - 100 * low:.1f}; "
        "clustering spread 17.7), top-3 error 12.5 %",
        text[2],
        "  time: pretrain 12.3 s, finetune 1,234.5 s, evaluate 7.7 s",
        "  per view set: 1.50 ms alone (95th percentile 2.25), 0.50 ms in batches; peak memory 1,300 MB",
    ]
    assert text[2].startswith("  recording protocol: error 62.5 %")


def test_a_test_side_of_one_group_has_no_interval(tmp_path):
    found = made_up(groups=(3, 3, 3, 3), scopes=("recording",))
    metrics, timing = written(tmp_path, found)
    assert json.loads((tmp_path / "metrics.json").read_text())["recording"]["top1"]["ci95"] is None
    assert "recording.top1.ci95.low" not in numbers(metrics)
    assert "none, the test side is one group" in lines(metrics, timing)[1]
    assert "object" not in metrics
