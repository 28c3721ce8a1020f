"""The regret of the choice: by hand on a test side that turns the training side round; what is kept; foreign gloves."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from benchmarks.choice import __main__ as command
from benchmarks.choice.__main__ import FOLD
from benchmarks.choice.foreign import dense_array, finger_forces
from benchmarks.choice.regret import candidate_rows, measure, regret_rows
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.sensors.pipelines import MEMBERS
from tactile_viewgcn.tables.array_recordings import ArrayRecordings
from tests.small_tables import ROOT, recipe

PLAIN = ("preprocess.baseline=none", "preprocess.zero=0", "preprocess.filter=none", "split.by=recording")


class Reads:
    """A system that answers with the class that one sensor reads: 10 counts, or 20."""

    def __init__(self, sensor):
        self.sensor = sensor

    def fit(self, data):
        self.middle = data.frames[:, self.sensor].mean()
        return self

    def frame_values(self, sensors):
        return np.float32(sensors[:, [self.sensor]] > self.middle)

    def logits(self, values):
        share = values.mean(axis=1)
        return np.log(np.hstack([1 - share, share]) + 1e-6)


@pytest.fixture
def turned(monkeypatch):
    """Two classes of four recordings, the first one of each is tested, one of 30 frames and one of 3.

    The first sensor tells the class but in the short one; the second tells it on the test side alone.
    """
    monkeypatch.setitem(MEMBERS, "first", lambda: Reads(0))
    monkeypatch.setitem(MEMBERS, "second", lambda: Reads(1))
    labels = np.repeat([0, 1], 4)
    arrays = []
    for number, label in enumerate(labels):
        first = label if number != 4 else 0
        second = label if number in (0, 4) else number % 2
        array = np.zeros((3 if number == 4 else 30, 1, 2), dtype=np.int16)
        arrays.append(array + np.int16([10 + 10 * first, 10 + 10 * second]))
    table = ArrayRecordings(arrays, ["mug", "pen"], labels, np.zeros(8, dtype=int))
    params = recipe(*PLAIN, "split.folds=4", "preprocess.contact_sensors=1")
    return preprocess_recordings(table, params.preprocess, params.split).frames


def test_each_recording_weighs_the_same_and_the_choice_has_not_seen_the_test_side(turned):
    rows = measure(turned, 2, [["second"], ["first"]], 0)
    assert [(row["candidate"], row["error"], row["taken"]) for row in rows] == [
        ("second", 0.0, False),
        ("first", 0.5, True),  # though 30 of 33 frames are right
    ]
    (row, _) = regret_rows(pd.DataFrame(rows).assign(**{"data set": "turned", "deal": 1, "fold": 0}))
    assert row["regret, points"] == "50.0" and row["lowest over deals"] == "second, 0.0"


def test_regret_is_a_mean_over_the_folds_of_a_deal_then_over_deals_then_over_data_sets():
    cells = [  # error of a, of b, and which is taken
        ("x", 1, 0, 0.5, 0.1, "a"),
        ("x", 1, 1, 0.2, 0.4, "a"),
        ("x", 2, 0, 0.3, 0.3, "b"),
        ("y", 1, 0, 0.1, 0.2, "a"),
    ]
    fits = pd.DataFrame([
        dict(zip(FOLD, (name, "all", deal, fold), strict=True))
        | {"candidate": one, "error": error, "taken": one == taken, "choosing": 3.0}
        for name, deal, fold, a, b, taken in cells
        for one, error in (("a", a), ("b", b))
    ])  # fmt: skip
    x, y, mean = regret_rows(fits)
    half = 12.7062 * 10 * 2**0.5 / 2**0.5  # of 20 and 0 points: t of one degree of freedom, their spread, two deals
    assert x["regret, points"] == f"10.0 ({10 - half:.1f} to {10 + half:.1f})" and x["deals"] == "2"
    assert y["regret, points"] == "0.0" and y["choice errs, %"] == "10.0"
    assert mean["regret, points"].startswith("5.0 (") and mean["data set"] == "mean"
    assert [row["taken"] for row in candidate_rows(fits)] == ["2 of 3", "1 of 3", "1 of 1", "0 of 1"]


def test_what_is_finished_is_kept_and_not_measured_again(tmp_path, monkeypatch):
    measured = []

    def of_fold(table, views, candidates, seed):
        measured.append((len(table), views))
        return [{"candidate": "trees", "error": 0.25, "taken": True, "choosing": 1.0}]

    monkeypatch.setattr(command, "measure", of_fold)
    monkeypatch.setattr(
        command.data_sets, "draw", lambda name: dense_array(np.random.default_rng(0), (4, 4), 2, 8, 1, 9)
    )
    words = ("--params", str(ROOT / "params.yaml"), "--kept", str(tmp_path), "--out", str(tmp_path / "out"))

    def run(*more):
        result = CliRunner().invoke(command.choice, [*words, *more])
        assert result.exit_code == 0, result.output
        return result.output

    run("--data", "digits", "--deals", "1")
    assert measured == [(16, 1)]
    assert "| mean " in run("--data", "digits", "--deals", "2") and len(measured) == 2
    run("--data", "digits", "--deals", "1", "--folds", "all", "--train-groups", "1")
    assert len(measured) == 6 and measured[-1] == (6, 1)  # one to train on and two to test, of two objects
    assert len(pd.read_csv(tmp_path / "fits.csv")) == 6
    result = CliRunner().invoke(command.choice, [*words, "--data", "digit"])
    assert result.exit_code == 1 and "--data is digit; expected digits | images" in result.output


def test_foreign_gloves_are_the_same_of_the_same_seed_and_pressed_nearly_everywhere():
    def array(seed):
        return dense_array(np.random.default_rng(seed), (4, 6), objects=3, recordings=2, frames=20)

    arrays, labels = array(0)
    assert labels.tolist() == [0, 0, 1, 1, 2, 2] and {one.shape for one in arrays} == {(20, 4, 6)}
    assert all(np.array_equal(one, again) for one, again in zip(arrays, array(0)[0], strict=True))
    assert not np.array_equal(arrays[0], array(1)[0][0])
    readings = np.stack(arrays)
    assert readings.min() >= 0 and readings.max() <= 1
    assert (readings[:, :4] < 0.15).all() and (readings[:, 10] > 0.05).mean() > 0.7  # open hand, and the grasp
    arrays, _ = finger_forces(np.random.default_rng(0), objects=3, recordings=2, frames=20)
    assert {one.shape for one in arrays} == {(20, 1, 5)} and np.stack(arrays).min() > 10
