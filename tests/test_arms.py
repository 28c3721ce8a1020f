"""What the arms of a study add up to: tables, pictures, failures."""

from dataclasses import replace

import numpy as np
import pytest

from studies.arms import Arm, read_arms, write_arm
from studies.failures import confused_pairs, mean_frames
from studies.picture import by_arm, by_seconds
from studies.pooling import pooled
from studies.table import rows_of
from tactile_viewgcn.split import TEST
from tests.tables import table

CLASSES = ["ball", "mug"]
LABELS, GROUPS = np.array([0, 0, 1, 1]), np.array([3, 3, 5, 5])
COSTS = {"weights": 10, "pretrain": 2.0, "finetune": 4.0, "single_ms": 1.0, "batch_ms": 0.5, "peak_mb": 100.0}


def arm(
    name, *answers, seed=0, fold=0, repeat=0, recipe="", labels=LABELS, groups=GROUPS, costs=COSTS, classes=CLASSES
):
    """An arm with these answers (A,) in each of its trials, the same under both protocols."""
    predicted = {protocol: np.array(answers, dtype=np.int16) for protocol in ("object", "recording")}
    return Arm(name, seed, fold, repeat, recipe, costs, predicted, labels, groups, classes)


def rows(arms, reference):
    return rows_of(pooled(arms), reference, np.random.default_rng(0))


def test_an_arm_comes_back_as_it_was_written(tmp_path):
    one = arm("view_gcn", [0, 0, 1, 0], [0, 1, 1, 1])
    write_arm(tmp_path / "a.npz", one)
    (found,) = read_arms([tmp_path])
    assert (found.name, found.seed, found.fold, found.costs, found.classes) == ("view_gcn", 0, 0, COSTS, one.classes)
    for protocol in ("object", "recording"):
        np.testing.assert_array_equal(found.predicted[protocol], one.predicted[protocol])
    assert found.right("object").tolist() == [1, 0.5, 1, 0.5]


def test_a_training_that_is_there_twice_and_none_at_all_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"no trained arms; `dvc repro`"):
        read_arms([tmp_path])
    for name in ("a", "b"):
        write_arm(tmp_path / f"{name}.npz", arm("mean", [0, 0, 1, 0]))
    with pytest.raises(ValueError, match=r"b\.npz: arm mean, seed 0, fold 0 is there twice"):
        read_arms([tmp_path])
    write_arm(tmp_path / "b.npz", arm("mean", [0, 0, 1, 0], repeat=1))
    assert [one.repeat for one in read_arms([tmp_path])] == [0, 1]


def test_errors_are_means_over_seeds_and_trials_and_differences_are_paired():
    half, good = arm("half", [0, 1, 1, 0], [0, 1, 0, 1]), arm("good", [0, 0, 1, 1], [0, 0, 1, 0])
    other = arm("good", [0, 0, 0, 0], [0, 0, 1, 1], seed=1)
    first, second, *_ = rows([half, good, other], "half")
    assert (first["arm"], first["error"], first["more"], first["p"]) == ("half", 50, "", "")
    assert second["error"] == pytest.approx(100 * 3 / 16)
    assert second["more"] == pytest.approx(100 * (1 / 8 - 1 / 2))  # seed 0 alone: both were trained from it
    assert second["more low"] <= second["more"] <= second["more high"]
    assert second["repeat sd"] == pytest.approx(100 * np.std([7 / 8, 6 / 8], ddof=1))
    assert second["clustering sd"] == pytest.approx(
        100 * np.mean([np.std([1, 0.75], ddof=1), np.std([0.5, 1], ddof=1)])
    )
    assert first["repeat sd"] == "" and (first["trainings"], second["trainings"]) == (1, 2)


def test_folds_stand_side_by_side_and_their_seconds_add_up():
    folds = [arm("a", [0, 0, 1, 1]), arm("a", [1, 1, 1, 1], fold=1, groups=GROUPS + 10)]
    (found,) = pooled(reversed(folds))
    assert found.groups.tolist() == [3, 3, 5, 5, 13, 13, 15, 15]
    assert found.error("object") == 0.25
    assert found.costs == [COSTS | {"pretrain": 4.0, "finetune": 8.0}]


def test_a_seed_without_a_fold_and_arms_of_other_anchors_are_refused():
    with pytest.raises(ValueError, match="arm a: seed 1 has other folds or anchors"):
        pooled([arm("a", [0] * 4), arm("a", [0] * 4, fold=1), arm("a", [0] * 4, seed=1)])
    with pytest.raises(ValueError, match="arm b was tested on other anchors than a"):
        rows([arm("a", [0] * 4), arm("b", [0] * 4, groups=GROUPS + 1)], "a")
    with pytest.raises(ValueError, match="no arm is called c; there are a, b"):
        rows([arm("a", [0] * 4), arm("b", [0] * 4)], "c")


def test_arms_of_other_anchors_stand_in_one_table_without_a_reference():
    found = rows([arm("a", [0] * 4), arm("b", [0] * 3, labels=LABELS[:3], groups=GROUPS[:3])], None)
    assert [row["error"] for row in found[:2]] == pytest.approx([50, 100 / 3])
    assert "more" not in found[0]


def test_what_was_not_spent_is_blank():
    (row, _) = rows([arm("trees", [0] * 4, costs={"finetune": 1.0})], None)
    assert (row["finetune s"], row["weights"], row["ms alone"]) == (1.0, "", "")


def test_pairs_are_counted_in_both_directions():
    one = pooled([arm("a", [0, 1, 1, 1], [1, 1, 1, 0])])[0]
    np.testing.assert_array_equal(one.confusion("object"), [[1, 3], [1, 3]])
    (pair,) = confused_pairs(one.confusion("object"), one.classes)
    assert (pair["object"], pair["and"]) == ("ball", "mug")
    assert pair["taken for each other, %"] == 50
    assert (pair["first for second, %"], pair["second for first, %"]) == (75, 25)


def test_mean_frames_are_those_of_the_test_side_over_all_folds():
    frames = table()
    index = frames.on(TEST)
    means, live = mean_frames([frames, frames], frames.classes)
    assert live is frames.live
    for label in range(len(frames.classes)):
        own = index[frames.label[index] == label]
        np.testing.assert_allclose(means[label], frames.inputs(own).mean(axis=0), atol=1e-6)


def text(row):
    return {key: str(value) for key, value in row.items()}


def test_pictures_have_a_mark_for_each_arm():
    arms = [arm("half", [0, 1, 1, 0]), arm("good", [0, 0, 1, 1], costs=COSTS | {"finetune": 9.0})]
    drawn = [text(row) for row in rows(arms, "half")]
    (lines,) = by_arm(drawn).axes
    assert [label.get_text() for label in lines.get_yticklabels()] == ["half", "good"]
    assert [mark.get_label() for mark in lines.containers] == ["object protocol", "recording protocol"]
    seconds, latency = by_seconds(drawn).axes
    assert {tuple(mark.lines[0].get_xydata()[0]) for mark in seconds.containers} == {(4, 50), (9, 0)}
    assert len(latency.containers) == 2


def test_an_arm_is_not_changed_by_pooling():
    one = arm("a", [0, 0, 1, 1])
    before = replace(one)
    pooled([one])
    np.testing.assert_array_equal(one.predicted["object"], before.predicted["object"])


def test_a_repeat_is_paired_with_the_reference_s_training_from_its_seed():
    reference = [arm("a", [0, 0, 1, 1]), arm("a", [1, 1, 0, 0], seed=1)]
    repeats = [arm("b", [0, 0, 1, 0], repeat=1), arm("b", [0, 0, 1, 1], repeat=2)]
    row = next(row for row in rows([*reference, *repeats], "a") if row["arm"] == "b")
    assert row["more"] == pytest.approx(100 / 8)
    assert row["trainings"] == 2 and row["repeat sd"] == pytest.approx(100 * np.std([0.75, 1], ddof=1))


def test_arms_without_a_common_seed_are_not_compared():
    row = rows([arm("a", [0, 0, 1, 1]), arm("b", [0, 0, 1, 0], seed=1)], "a")[1]
    assert (row["arm"], row["more"], row["p"]) == ("b", "", "")


def test_trainings_of_one_arm_with_other_parameters_are_refused():
    for other in ({"recipe": "other"}, {"labels": LABELS[::-1]}):
        with pytest.raises(ValueError, match="arm a: seed 1 "):
            pooled([arm("a", [0] * 4), arm("a", [0] * 4, seed=1, **other)])
    with pytest.raises(ValueError, match=r"other parameters.*delete what an earlier run has left"):
        pooled([arm("a", [0] * 4), arm("a", [0] * 4, [0] * 4, seed=1)])


def test_a_class_has_one_place_though_a_fold_lacks_another():
    both = [arm("a", [0, 0, 1, 1]), arm("a", [0, 0, 1, 1], fold=1, groups=GROUPS + 9, classes=["cup", "mug"])]
    (found,) = pooled(both)
    assert found.classes == ["ball", "mug", "cup"]
    assert found.labels.tolist() == [0, 0, 1, 1, 2, 2, 1, 1]
    assert found.error("object") == 0
    np.testing.assert_array_equal(found.confusion("object"), np.diag([2, 4, 2]))
