"""The calibration's statistics on frames whose answer is counted by hand."""

import numpy as np
import pytest

from benchmarks.calibration import __main__ as command
from benchmarks.calibration import frame_statistics as statistics
from benchmarks.calibration.frame_statistics import Excess
from benchmarks.calibration.picture import DRAWN, frames_on_hand
from tactile_viewgcn.errors import UserError
from tests import small_glove
from tests.stag_files import SENSORS, metadata, save_matlab5


def excess(values, of_object, recording, *, cells, objects=("empty_hand", "cup", "mug"), grams=(np.nan, 50.0, 100.0)):
    """Frames of the cells of a hand; those of object 0 are empty, all others held."""
    sensors = np.zeros((32, 32), dtype=bool)
    sensors[cells] = True
    values, of_object = np.array(values, dtype=np.float32), np.array(of_object)
    baseline, empty = np.full((1, values.shape[1]), 515.0), of_object == 0
    return Excess(
        values, sensors, baseline, of_object, np.array(recording), empty, ~empty, list(objects), np.array(grams)
    )


@pytest.fixture
def square():
    """Four neighbouring cells of the palm, 2 x 2: four held frames and four of an empty hand that flickers by 2."""
    held = [[0, 0, 24, 12], [8, 4, 16, 8], [16, 8, 8, 4], [24, 12, 0, 0]]
    empty = [[0] * 4, [2] * 4, [0] * 4, [2] * 4]
    return excess(held + empty, [1, 2, 2, 1, 0, 0, 0, 0], [0, 1, 1, 2, 3, 3, 3, 3], cells=(slice(2), slice(14, 16)))


def test_frame_statistics_of_four_cells(square):
    rows = statistics.frame_statistics(square)
    assert (rows["baseline"], rows["baseline std"], rows["empty hand, maximum"]) == (515, 0, 2)
    assert rows["noise std"] == pytest.approx(4 / 3)  # of steps 2, -2, 2: sqrt(32 / 9), over sqrt(2)
    shares = [rows[f"cells above {counts}, %"] for counts in (5, 10, 20)]
    assert shares == [100 * 10 / 16, 100 * 6 / 16, 100 * 2 / 16]
    assert (rows["frame maximum, median"], rows["cells above 5 a frame, 50 %"]) == (20, 2.5)
    assert rows["mean excess over 5"] == pytest.approx(13.6 - 5)
    assert (rows["sensors rarely above 10, %"], rows["share of 50 busiest, %"]) == (0, 100)
    assert rows["correlation along rows"] == pytest.approx(1)
    assert rows["correlation along columns"] == pytest.approx(-1)
    assert rows["correlation with weight"] == pytest.approx(-1)  # 36 counts of 50 g, 32 of 100 g


def loaded(thumb, tip, palm, proximal):
    """One held frame with counts on a cell of each part of the hand, and one of the empty hand."""
    cells = np.array([(20, 26), (7, 1), (3, 20), (11, 12)])
    values = np.zeros((2, len(cells)))
    order = np.lexsort(cells.T[::-1])
    values[0] = np.array([thumb, tip, palm, proximal])[order]
    return excess(values, [1, 0], [0, 1], cells=tuple(cells.T))


def test_load_shares_by_hand():
    rows = statistics.load_shares(loaded(thumb=10, tip=20, palm=6, proximal=14))
    assert rows == pytest.approx(
        {"load on the thumb, %": 20, "load on the fingertips, %": 40, "load on the palm, %": 12}
    )
    assert statistics.load_shares(loaded(10, 5, 10, 0))["load on the fingertips, %"] == 0  # 5 counts are no load


def test_the_correlation_of_mean_loads_is_the_mean_over_the_samples():
    same, opposite, other = loaded(10, 20, 30, 40), loaded(40, 30, 20, 10), loaded(20, 40, 60, 80)
    assert command.correlation([same], other) == pytest.approx(1)
    assert command.correlation([same, opposite], other) == pytest.approx(0, abs=1e-12)


def test_cosines_of_four_frames(square):
    within, of_object, of_two = statistics.cosines(square).values()
    assert (within, of_object, of_two) == pytest.approx((0.8, 0, 1.5 / np.sqrt(5)))


@pytest.mark.parametrize(("recordings_differ", "accuracy"), [(False, 100), (True, 0)])
def test_a_recording_left_out_is_recognised_only_if_it_is_like_the_others(monkeypatch, recordings_differ, accuracy):
    monkeypatch.setattr(statistics, "TREES", 5)
    left, right = [20.0] * 14 + [0.0] * 14, [0.0] * 14 + [20.0] * 14
    second = [right, left] if recordings_differ else [left, right]
    values = np.repeat([left, right, *second], 8, axis=0)
    frames = excess(values, np.repeat([1, 2, 1, 2], 8), np.repeat([0, 1, 2, 3], 8), cells=(slice(2), slice(14)))
    assert statistics.accuracies(frames, 0)["accuracy, recording out, %"] == accuracy


def test_the_baseline_is_each_sessions_median_of_the_empty_hand(tmp_path):
    tree = metadata(objects=2, recordings=2, sessions=2, frames=5)
    frames = statistics.read_excess(save_matlab5(tmp_path / "metadata.mat", tree))
    for session in (0, 1):
        of_session = tree["batchId"].ravel() == session
        counts = tree["pressure"][of_session & frames.empty][:, frames.sensors]
        np.testing.assert_allclose(frames.baseline[session], counts.mean(axis=0), rtol=1e-6)
        counts = tree["pressure"][of_session & frames.held][:, frames.sensors] - np.median(counts, axis=0)
        np.testing.assert_array_equal(frames.values[of_session & frames.held], counts)
    assert frames.empty.sum() == frames.held.sum() == 20 and (frames.sensors & SENSORS == frames.sensors).all()


def test_a_source_may_say_of_grasps_instead_of_frames_when_the_object_is_held(tmp_path):
    tree = metadata(objects=2, recordings=1, frames=6)
    del tree["hasValidLabel"]
    column = np.tile([0, 0, 0, 1, 1, 1], 2)[:, None]
    tree |= {"graspIndex": column.astype(np.uint8), "graspValid": np.tile([0, 1, 1], 4)[:, None].astype(np.uint8)}
    frames = statistics.read_excess(save_matlab5(tmp_path / "metadata.mat", tree))
    assert np.flatnonzero(frames.held).tolist() == [7, 8, 10, 11]
    assert frames.recording.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]


def test_a_session_without_an_empty_hand_is_refused(tmp_path):
    tree = metadata(objects=2, recordings=2, sessions=2, frames=5)
    tree["objectId"][tree["batchId"] == 1] = 1
    with pytest.raises(UserError, match="session 001 has no frames of the empty hand"):
        statistics.read_excess(save_matlab5(tmp_path / "metadata.mat", tree))


def test_another_glove_is_refused(tmp_path):
    small_glove.write(tmp_path / "a.h5", np.zeros((3, 16, 24), dtype=np.int16), object="cup", session="0")
    with pytest.raises(UserError, match="frames of 16 x 24; expected 32 x 32"):
        statistics.read_excess(tmp_path / "a.h5")


def test_a_row_says_how_far_the_mean_over_the_seeds_is_outside_of_the_target(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "TARGETS", tmp_path / "targets.csv")
    command.TARGETS.write_text("statistic,from,to\nnoise,0.5,1\nbaseline,515,515\n")
    simulated = [{"noise": 1.0, "baseline": 514.0}, {"noise": 2.0, "baseline": 516.0}]
    noise, baseline = command.compare(simulated, {"stag.mat": {"noise": 0.9, "baseline": 515.0}})
    assert noise == {
        "statistic": "noise", "STAG": "0.5 to 1", "simulated": 1.5, "lowest": 1, "highest": 2, "deviation": 0.5,
        "stag.mat": 0.9,
    }  # fmt: skip
    assert (baseline["STAG"], baseline["deviation"]) == ("515", 0)


def test_every_target_is_a_statistic(square, monkeypatch):
    monkeypatch.setattr(
        statistics, "accuracies", lambda *_: {"accuracy, random frames, %": 0, "accuracy, recording out, %": 0}
    )
    assert {row["statistic"] for row in command.compare([statistics.all_statistics(square)], {})} == set(
        statistics.all_statistics(square)
    )


def test_the_picture_shows_the_busiest_frame_of_three_recordings_of_each_object():
    values = np.zeros((24, 1024))
    values[1::2] = 7  # of the two frames of each recording
    of_object, cells = np.repeat(np.arange(4), 6), (slice(32), slice(32))
    frames = excess(values, of_object, np.arange(24) // 2, cells=cells, objects=sorted(DRAWN), grams=[1.0] * 4)
    panels = frames_on_hand(frames).axes[:12]
    assert [panel.get_title() for panel in panels[::3]] == ["coin", "mug", "ball", "empty hand"]
    assert all((panel.collections[0].get_array() == 7).all() for panel in panels)
