"""Whether a result is good, and what to do next, of runs made up so that the answer is known."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from tactile_viewgcn.evaluation.predictions import Predictions
from tactile_viewgcn.intervals import proportion_interval
from tactile_viewgcn.notes import Note
from tactile_viewgcn.pages.finished_run import FinishedRun
from tactile_viewgcn.pages.verdict import Outcome, _needed, next_steps, outcome_of, verdict

NAMES = ["ball", "cup", "pen"]
STAGES = ("preprocess", "finetune", "evaluate")
LEAK = Note("better than by chance", "warning", "leak check", "preprocess.baseline", "grasp", "preprocess")


def finished(answers, *, notes=(), metrics=None, **changes):
    """A run of three objects with as many test recordings each as `answers` has columns, ten anchors a recording.

    Args:
        answers: of each object, the answer to all anchors of each of its recordings.
        changes: parameters that differ from the committed ones, `_` for a dot.
    """
    answers = np.repeat(np.array(answers), 10, axis=1)
    labels, predicted = np.repeat(np.arange(3), answers.shape[1]), answers.ravel()
    groups = np.arange(len(labels)) // 10
    wrong = (predicted != labels).astype(float)
    low, high = proportion_interval(wrong, groups, np.random.default_rng(0))
    score = {"error": {"mean": float(wrong.mean()), "low": low, "high": high}, "top3_error": 0.0}
    predictions = Predictions(
        {"recording": predicted[None]}, labels, groups, groups.astype(str), np.array(NAMES), np.zeros(3), np.ones(1)
    )
    changed = {key.replace("_", ".", 1): value for key, value in changes.items()}
    values = {
        "data.source": "my glove",
        "split.by": "recording",
        "split.folds": 3,
        "model.system": "lda",
        "model.members": [],
        "preprocess.baseline": "auto",
        "preprocess.scale": "auto",
        "pretrain.epochs": 30,
        "finetune.epochs": 15,
    }
    params = {"values": values | changed, "changed": changed}
    records = {stage: {"notes": [], "params": params, "run_id": "f" * 32} for stage in STAGES}
    records["preprocess"]["notes"] = [asdict(note) for note in notes]
    metrics = {"recording": score, "groups": {"test": len(np.unique(groups))}} | (metrics or {})
    return FinishedRun("", metrics, {}, predictions, records, None)


def advice(run):
    """The verdict, what to do, and the commands."""
    outcome = outcome_of(run)
    steps = next_steps(run, outcome)
    return verdict(run, outcome), [step.what for step in steps], "\n".join(step.command for step in steps)


RIGHT = [[label] * 12 for label in range(3)]
FEW = [[label] * 2 for label in range(3)]


def test_a_low_error_on_many_recordings_without_a_warning_is_good():
    judged, steps, commands = advice(finished(RIGHT))
    assert judged.kind == "good" and judged.answer.startswith("Yes: it is better than guessing")
    assert steps == ["Ask the classifier about new recordings of the same glove."]
    assert commands == "tactile-viewgcn predict models/classifier.pt NEW_RECORDINGS"


def test_the_same_on_few_recordings_is_not_to_be_relied_on():
    run = finished(FEW, views=4)
    judged, steps, commands = advice(run)
    assert judged.kind == "unsure" and "Little was tested: 6 recordings, 2 of each object." in judged.reasons
    assert steps[:2] == ["Record more.", "Test every recording once."]
    assert "dvc exp run --queue -S split.fold=0,1,2 -S views=4\ndvc queue start" in commands
    assert "points wide with 6 recordings on the test side" in next_steps(run, outcome_of(run))[0].why


def test_an_interval_that_reaches_guessing_is_no_result():
    always_ball = [[0] * 12] * 3
    judged, steps, commands = advice(finished(always_ball))
    assert judged.kind == "bad" and judged.answer == "No: this result is no better than guessing."
    assert "Every answer was ball: the classifier tells nothing apart." in judged.reasons
    assert steps[0] == "See whether the recordings can tell the objects apart."
    assert "tactile-viewgcn inspect 'my glove' --html inspection.html" in commands and "predict" not in commands
    assert not any("never recognised" in step for step in steps), "it follows from the same answer everywhere"


@pytest.mark.parametrize(
    ("changes", "command"),
    [
        ({"model_system": "view_gcn", "pretrain_epochs": 50}, "-S pretrain.epochs=100 -S finetune.epochs=30"),
        ({"model_system": "max_network"}, "-S model.system=max_network -S finetune.epochs=30"),
    ],
)
def test_a_network_is_trained_longer_than_it_was_and_only_what_is_trained(changes, command):
    run = finished([[0] * 12] * 3, **changes)
    (step,) = (step for step in next_steps(run, outcome_of(run)) if step.what == "Train longer.")
    assert step.command.startswith("dvc exp run -S ") and step.command.endswith(command)


@pytest.mark.parametrize(
    ("groups", "ends", "needed"),
    [
        (4, (0.0, 0.602), 17),  # all right
        (10, (0.0, 0.308), 17),
        (10, (0.02, 0.308), 17),  # the low end is resampled
        (4, (0.1, 0.9), 64),
        (16, (0.3, 0.7), 64),
        (1, None, 17),
    ],
)
def test_how_many_groups_an_interval_of_20_points_takes(groups, ends, needed):
    assert _needed(Outcome("recording", 0.1, 0.9, ends, groups, groups, [], "", [])) == needed


@pytest.mark.parametrize(
    ("name", "run_id", "command"),
    [
        ("", "f" * 32, "tactile-viewgcn predict models/classifier.pt NEW_RECORDINGS"),
        ("f" * 32, "f" * 32, f"tactile-viewgcn predict {'f' * 32} NEW_RECORDINGS"),
        ("my-wolf", None, "dvc exp apply my-wolf\ntactile-viewgcn predict models/classifier.pt NEW_RECORDINGS"),
    ],
)
def test_a_model_is_named_where_it_is(name, run_id, command):
    run = replace(finished(RIGHT), name=name)
    run.records["evaluate"]["run_id"] = run_id
    assert advice(run)[2] == command


def test_a_warning_comes_first_with_the_remedies_that_are_values():
    other = Note("the table is damaged", "warning", "objects", stage="preprocess")
    for notes, commands in ([LEAK], "dvc exp run -S views=4 -S preprocess.baseline=grasp"), ([other], ""):
        judged, steps, lines = advice(finished(RIGHT, notes=[*notes, Note("remark", stage="preprocess")], views=4))
        assert judged.kind == "unsure" and "1 warning below puts it in doubt." in judged.reasons
        assert steps[0] == "Mend what the warning names, and run again."
        assert lines.split("\n")[0] == commands


def test_an_object_that_is_never_recognised_is_named():
    answers = [[0] * 12, [2] * 12, [2] * 12]
    run = finished(answers)
    (step,) = (step for step in next_steps(run, outcome_of(run)) if "never" in step.what)
    assert "cup" in step.what and "pen" in step.why
    _, steps, _ = advice(finished(answers, data_source="data/virtual/recordings"))
    assert not any("never" in step for step in steps), "nobody can record simulated objects again"


def test_single_frames_held_out_are_not_good_and_simulated_recordings_are_not_predicted():
    judged, steps, commands = advice(finished(RIGHT, split_by="frame"))
    assert steps[0] == "Hold out whole recordings." and commands.startswith("dvc exp run -S split.by=recording")
    assert judged.kind == "unsure" and "Single frames were held out" in " ".join(judged.reasons)
    _, steps, commands = advice(finished(RIGHT, data_source="data/virtual/recordings"))
    assert steps == ["Take your own recordings."] and commands == "tactile-viewgcn inspect data/my_glove"


def test_one_group_cannot_be_judged():
    run = finished(FEW)
    run.metrics["recording"]["error"] |= {"low": None, "high": None}
    assert advice(run)[0].answer == "This result cannot be judged."
