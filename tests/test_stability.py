"""Numerical stability: every case of the study on a small classifier, and faults that it must see."""

import csv
import math
import warnings
from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import torch
from click.testing import CliRunner
from torch import nn

from studies.stability import case, clusters, data, graph, learning, left_out, network, same, scoring
from studies.stability.case import REFUSED, RIGHT, WRONG, Finding, Subject, apart, differing, finite, refusal, run
from tactile_viewgcn.classifier import Classifier, save_classifier
from tactile_viewgcn.frames import write_frames
from tests.tables import CPU, ROOT, SMALL, recipe, table, trained

PARTS = (data, clusters, graph, network, learning, scoring, same, left_out)
CASES = {f"{part.__name__.rpartition('.')[2]}.{one.__name__}": one for part in PARTS for one in part.CASES}
EXPECTED = {  # what is refused, by case
    "data.numbers_that_are_none": 4,
    "data.sensors_that_never_change": 2,
    "data.too_little_data": 4,
    "graph.places_out_of_range": 3,
    "learning.batches_of_one": 2,
}


@pytest.fixture
def subject(tmp_path):
    return Subject(trained(), table(), recipe(), CPU, tmp_path)


def verdicts(subject, *names):
    return [(row["quantity"], row["verdict"], row["remark"]) for row in run([CASES[name] for name in names], subject)]


@pytest.mark.parametrize("name", sorted(set(CASES) - {"learning.learning_rates"}))
def test_nothing_is_wrong_on_a_small_classifier(subject, name):
    rows = verdicts(subject, name)
    assert rows and not [row for row in rows if row[1] == WRONG]
    assert sum(row[1] == REFUSED for row in rows) == EXPECTED.get(name, 0)


def test_trainings_end_with_finite_weights_or_say_that_they_diverged(subject, monkeypatch):
    monkeypatch.setattr(learning, "RATES", np.array([1e-8, 1e-3, 1e3]))
    rows = verdicts(subject, "learning.learning_rates")
    assert [row[1] for row in rows] == [RIGHT, RIGHT, RIGHT, RIGHT, REFUSED, REFUSED]
    assert all("training diverged in epoch" in row[2] for row in rows[4:])


@pytest.mark.parametrize("system", ["stag", "gvcnn", "cnn_lstm", "rotationnet", "vote"])
def test_cases_of_the_network_hold_for_other_systems(tmp_path, system):
    how = recipe(f"model.system={system}")
    torch.manual_seed(0)
    classifier = Classifier(torch.from_numpy(graph.viewpoints(4)), 4, how.model, (12, 12)).eval()
    one = Subject(classifier, table(), how, CPU, tmp_path)
    names = [name for name in CASES if name.partition(".")[0] in ("network", "same")]
    rows = verdicts(one, *names, "learning.gradients_at_the_extremes", "learning.losses_of_sure_logits")
    assert not [row for row in rows if row[1] == WRONG]


def expanded(positions):
    """Squared distances by the expansion of the square."""
    square = positions.square().sum(dim=-1)
    return square[..., :, None] + square[..., None, :] - 2 * positions @ positions.transpose(-1, -2)


def expanded_edges(positions, neighbours, distance="squared"):
    """Edges whose squared distance is expanded; all nodes are neighbours."""
    return expanded(positions).unsqueeze(-1).expand(*neighbours.shape, 10)


class Detached:
    """Equation 4's sum, of which no gradient reaches the senders."""

    @staticmethod
    def apply(taken, sent):
        return nn.functional.leaky_relu(taken.unsqueeze(1) + sent.detach().unsqueeze(2), 0.2).sum(dim=1)


def softmax_of_large_numbers(logits, dim):
    powers = logits.exp()
    p = powers / powers.sum(dim, keepdim=True)
    return (p / (1 - p)).log()


def one_pass_moments(counts):
    """Mean and deviation by the mean of squares less the square of the mean."""
    values = counts.astype(np.float64)
    mean = values.mean(axis=0)
    noise = np.sqrt(np.maximum((values**2).mean(axis=0) - mean**2, data.QUANTISATION**2))
    return mean.astype(np.result_type(counts.dtype, np.float32)), noise


def divided_by_noise(recordings, rest, *, sensors, sigmas):
    counts = recordings.frames(np.arange(len(recordings))).astype(np.float64)
    noise = np.where(rest.noise < 0.3, 0.0, rest.noise)[rest.of_frame]
    return (((counts - rest.mean[rest.of_frame]) / noise) > sigmas).sum(axis=(1, 2)) >= sensors


def plain_certainty(logits, dim):
    return logits.softmax(dim)


def naive_ranks(positions):
    return graph.squared_distances(positions)


def unsorted_labels(scores, views, *, restarts, seed):
    from sklearn.cluster import KMeans

    return KMeans(views, n_init=restarts, random_state=seed).fit_predict(scores)


FAULTS = {
    "distances by expansion": (graph, "squared_distances", expanded, "graph.distances_without_cancellation"),
    "a softmax of large numbers": (network, "log_odds", softmax_of_large_numbers, "network.sure_answers"),
    "moments in one pass": (data, "trimmed", one_pass_moments, "data.a_large_offset"),
    "division by no noise": (data, "in_contact", divided_by_noise, "data.a_sensor_without_rest_noise"),
    "certainty that saturates": ("tactile_viewgcn.nn.view_gcn", "log_odds", plain_certainty, "graph.sure_selectors"),
    "ranks in the network's precision": ("tactile_viewgcn.nn.graph", "_ranks", naive_ranks, "graph.places"),
    "k-means of near duplicates": (clusters, "kmeans", unsorted_labels, "clusters.fewer_distinct_frames_than_clusters"),
    "an interval without width": (
        scoring, "share_interval", lambda correct, groups, rng: (correct.mean(), correct.mean()), "scoring.intervals",
    ),
    "a training that is never looked at": (
        "tactile_viewgcn.epochs", "_fine", lambda *_: True, "learning.last_good_weights",
    ),
    "edges by expansion": (graph, "edge_geometry", expanded_edges, "graph.distances_without_cancellation"),
    "a sum without its gradient": (
        "tactile_viewgcn.nn.view_gcn", "MessageSum", Detached, "learning.gradients",
    ),
    "errors beyond the bins": (
        scoring, "calibration_error", lambda certainty, right: float(np.abs(certainty - right).mean()),
        "scoring.calibration",
    ),
    "the nearest rank": (
        scoring, "middle_and_tail",
        lambda values: {"median": np.sort(values)[len(values) // 2], "p95": values.max()}, "scoring.percentiles",
    ),
    "clipping that wraps": (
        "tactile_viewgcn.frames", "transform",
        lambda excess, kind, scale: (np.asarray(excess, np.float32) / np.float32(scale)) % 1, "data.unusual_frames",
    ),
    "one thread that says something else": (
        same, "joined", lambda _, nodes, sets, __: nodes[torch.from_numpy(sets)].sum() * torch.get_num_threads(),
        "same.threads",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_wrong(subject, monkeypatch, fault):
    module, name, faulty, seen = FAULTS[fault]
    if seen != "same.threads":
        assert all(row[1] != WRONG for row in verdicts(subject, seen))
    module = import_module(module) if isinstance(module, str) else module
    monkeypatch.setattr(module, name, faulty)
    assert any(row[1] == WRONG for row in verdicts(subject, seen))


def test_an_unclustered_run_that_imports_scikit_learn_is_wrong(subject, monkeypatch):
    monkeypatch.setattr(left_out, "_imported", lambda *words: ({"sklearn", "torch"}, 0.1))
    assert [row[1] for row in verdicts(subject, "left_out.libraries")] == [WRONG, RIGHT, WRONG]


def test_an_error_above_the_tolerance_is_wrong_and_so_is_no_number():
    assert Finding("x", 1e-6, 1e-6).verdict == RIGHT
    assert Finding("x", 1.1e-6, 1e-6).verdict == WRONG
    assert Finding("x", math.nan, 1e-6).verdict == Finding("x", math.inf, 1e-6).verdict == WRONG
    assert Finding("x", math.nan, math.nan, refused=True).verdict == REFUSED


def test_what_is_relative_to_the_largest_number_of_the_exact_one():
    assert apart([1.0, 2.0], [1.0, 4.0]) == 0.5
    assert apart([0.25, 0.0], [0.0, 0.0]) == 0.25
    assert apart([1.0], [1.0, 1.0]) == apart([math.nan], [1.0]) == apart([1.0], [math.inf]) == math.inf
    assert differing([1, 2, 3, 4], [1, 2, 4, 3]) == 0.5 and differing([1], [1, 2]) == math.inf
    assert finite([1.0, math.nan, math.inf, 2.0]) == 0.5


def raising(message):
    def call():
        raise ValueError(message)

    return call


def test_a_refusal_has_one_line_that_says_what_is_wrong():
    assert refusal("x", raising("views is 0; expected 1"), "views is 0").verdict == REFUSED
    assert refusal("x", raising("views is 0"), "views is 1").verdict == WRONG
    assert refusal("x", raising("views is 0\nor not"), "views is 0").verdict == WRONG
    assert refusal("x", lambda: 3, "views").verdict == WRONG


def test_a_warning_and_an_exception_are_wrong_and_the_next_case_still_runs(subject):
    def warns(_):
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)
        yield Finding("x", 0, 0)

    def breaks(_):
        yield Finding("first", 0, 0)
        raise IndexError("far\nout")

    def holds(_):
        yield Finding("x", 0, 0)

    rows = case.run([warns, breaks, holds], subject)
    assert [(row["case"], row["verdict"]) for row in rows] == [
        ("warns", WRONG), ("breaks", RIGHT), ("breaks", WRONG), ("holds", RIGHT),
    ]  # fmt: skip
    assert rows[0]["remark"] == "RuntimeWarning: overflow" and rows[2]["remark"] == "IndexError: far out"


def study(place, monkeypatch, cases, frames="frames.h5"):
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "disabled")
    monkeypatch.chdir(place)
    (place / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    write_frames(place / "frames.h5", table())
    save_classifier(place / "classifier.pt", trained(), recipe().model, table())
    module = import_module("studies.stability.stability")
    monkeypatch.setattr(module, "PARTS", [type("Part", (), {"CASES": cases})])
    changes = [word for change in (*SMALL, "precision=float32", "device=cpu") for word in ("--set", change)]
    files = ("--frames", frames, "--classifier", "classifier.pt", "--out", "out", "--record", "record.json")
    return CliRunner().invoke(module.stability, [*changes, *files])


def test_the_study_writes_its_table(tmp_path, monkeypatch):
    result = study(tmp_path, monkeypatch, scoring.CASES)
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines()))
    assert {row["verdict"] for row in rows} == {RIGHT} and {row["part"] for row in rows} == {"scoring"}
    assert f"{len(rows)} quantities of 4 cases: {len(rows)} right, 0 refused, 0 WRONG" in result.output
    assert "Simulated by the virtual glove" in (tmp_path / "out" / "results.md").read_text()


def test_a_summary_says_how_near_a_part_is_to_being_wrong():
    module = import_module("studies.stability.stability")
    rows = [
        {"case": "near", "verdict": RIGHT, "error": 2e-6, "tolerance": 1e-5, "seconds": 1.0},
        {"case": "exact", "verdict": RIGHT, "error": 0.0, "tolerance": 0, "seconds": 0.5},
        {"case": "bad", "verdict": REFUSED, "error": "", "tolerance": "", "seconds": 0.0},
    ]
    assert module.summary(rows) == "2 right, 1 refused, 0 WRONG; at most 0.2 of the tolerance (near), 1.5 s"
    assert module.summary(rows[1:2]) == "1 right, 0 refused, 0 WRONG; 0.5 s"


def test_a_classifier_of_other_frames_is_refused(tmp_path, monkeypatch):
    write_frames(tmp_path / "others.h5", replace(table(), classes=["a", "b", "c", "d"]))
    result = study(tmp_path, monkeypatch, (), frames="others.h5")
    assert result.exit_code == 1
    assert "Error: classifier.pt: of other classes or sensors than others.h5; train it on these frames" in result.output


def test_one_wrong_quantity_fails_the_study_and_its_table_is_there(tmp_path, monkeypatch):
    def holds(_):
        yield Finding("good", 0, 0)
        yield Finding("bad", 1, 0)

    result = study(tmp_path, monkeypatch, (holds,))
    assert result.exit_code == 1
    assert "Error: 1 WRONG, see out/results.md: test_stability, holds, bad" in result.output
    assert "| WRONG |" in (tmp_path / "out" / "results.md").read_text()
    assert not (tmp_path / "record.json").exists()
