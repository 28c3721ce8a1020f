"""The verdict on a run and the next steps follow from its answers, which are chosen here."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.evaluation.evaluate import scores_of
from tactile_viewgcn.evaluation.finished_run import FinishedRun, read_run
from tactile_viewgcn.evaluation.trials import WHOLE, Predictions, Trials
from tactile_viewgcn.evaluation.versus import VERSUS
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.pages.run_page import (
    next_steps,
    page_path,
    report_lines,
    run_checks,
    verdict,
)
from tests.records import RECORD

NAMES = ["ball", "cup", "pen"]
STAGES = ("preprocess", "finetune", "evaluate")
LEAK = Note(
    "better than by chance", "warning", "leak check", "preprocess.baseline", "grasp", "preprocess"
)
RIGHT = [[label] * 12 for label in range(3)]
FEW = [[label] * 2 for label in range(3)]
ALWAYS_BALL = [[0] * 12] * 3
PREDICT = "tactile-viewgcn predict models/classifier.pt NEW_RECORDINGS"


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Run each test in a folder without params.yaml, and return the folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def finished(answers, *, notes=(), **changes):
    """Return a run of three objects.

    Args:
        answers: (3, R), the answers to the test recordings of each object.
        notes: notes of the preprocessing.
        changes: parameters that differ from the committed ones, `_` for a dot.
    """
    answers = np.array(answers)
    labels = np.repeat(np.arange(3), answers.shape[1])
    groups = np.arange(answers.size)
    trials = Trials(answers.reshape(1, -1, 1), labels, groups, groups.astype(str), 48)
    score = scores_of(trials, np.random.default_rng(0), 3)
    predictions = Predictions({WHOLE: trials}, np.array(NAMES))
    changed = {key.replace("_", ".", 1): value for key, value in changes.items()}
    values = {
        "data.source": "my glove",
        "data.shape": "auto",
        "data.layout": "auto",
        "data.columns": [],
    }
    values |= {"split.by": "recording", "split.folds": 3, "model.system": "sensors"}
    values |= {
        "preprocess.baseline": "auto",
        "pretrain.epochs": 30,
        "finetune.epochs": 15,
        "model.members": ["kernel"],
    }
    params = {"values": values | changed, "changed": changed}
    records = {
        stage: replace(RECORD, stage=stage, params=params, run_id="f" * 32) for stage in STAGES
    }
    records["preprocess"] = replace(RECORD, params=params, notes=notes)
    metrics = {WHOLE: score, "groups": {"test": len(groups)}}
    return FinishedRun("", metrics, {}, predictions, records)


def advice(run):
    """Return the verdict, the next steps, and their commands as lines."""
    steps = next_steps(run)
    commands = "\n".join(command for _, command in steps)
    return verdict(run), [step for step, _ in steps], commands


def test_a_line_names_what_params_yaml_now_has_otherwise(elsewhere):
    assert "pretrain.epochs" not in advice(finished(FEW))[2]
    (elsewhere / "params.yaml").write_text("pretrain: {epochs: 3}\nfinetune: {epochs: 15}\n")
    line = advice(finished(FEW, views=4))[2].splitlines()[0]
    assert " -S views=4 " in line
    assert " -S pretrain.epochs=30 " in line
    assert "finetune.epochs" not in line


def test_objects_and_chance_by_hand():
    labels = np.array([0] * 8 + [1] * 4)  # recordings of a cup and a pen; no tape
    answers = np.array([[0, 0, 1, 2, 0, 1, 1, 0, 1, 1, 1, 0]])
    trials = Trials(answers[..., None], labels, labels, labels, 48)
    names = np.array(["cup", "pen", "tape"])
    outcome = replace(finished(FEW), predictions=Predictions({WHOLE: trials}, names))
    assert outcome.tested == "12 recordings, 4 to 8 of each object"
    assert finished(FEW, split_by="grasp").tested == "6 grasps, 2 of each object"
    assert outcome.objects == [
        ("cup", 8, 0.5, "pen (37.5\xa0%)"),
        ("pen", 4, 0.25, "cup (25.0\xa0%)"),
    ]
    assert outcome.chance == pytest.approx(4 / 12)


EVERY_FOLD = "-S views=4 -S 'data.source=\"{here}/my glove\"' -S split.by=recording"


@pytest.mark.parametrize(
    ("answers", "changes", "kind", "reason", "first_step", "command"),
    [
        (
            RIGHT,
            {"data_layout": "OBJECT/FILE"},
            "open",
            "below",
            "Let the classifier",
            f"{PREDICT} --set data.layout=OBJECT/FILE",
        ),
        (
            FEW,
            {"views": 4, "split_fold": 2},
            "unsure",
            "6 recordings, 2 of each",
            "Test every part",
            EVERY_FOLD,
        ),
        (
            ALWAYS_BALL,
            {},
            "bad",
            "reaches the error of chance",
            "Test every part",
            "inspect 'my glove' --html insp",
        ),
        (
            ALWAYS_BALL,
            {"data_shape": [4, 8]},
            "bad",
            "",
            "Test every part",
            "my glove' --set 'data.shape=[4,8]' --html",
        ),
        (
            FEW,
            {"data_source": "data/virtual/recordings"},
            "unsure",
            "",
            "Test every part",
            "each_fold/simulated -S data.source=data/virtual/recordings -S split.by=recording",
        ),
    ],
)
def test_verdict_and_steps_follow_from_error_interval_and_split(
    elsewhere, answers, changes, kind, reason, first_step, command
):
    judged, steps, commands = advice(finished(answers, **changes))
    assert judged.kind == kind and reason in " ".join(judged.reasons)
    assert steps[0].startswith(first_step)
    assert command.replace("{here}", str(elsewhere)) in commands
    assert ("predict" in commands) == (kind != "bad")


def test_a_warning_comes_first_with_the_remedies_that_are_values(elsewhere):
    line = "dvc exp run -S views=4 -S 'data.columns=[\"time:t\"]' "
    line += f"-S 'data.source=\"{elsewhere}/my glove\"'"
    without_clock = line.replace(':t"', ':t","leave_out:my clock, s"')
    line = f"{line} -S preprocess.baseline=grasp"
    other = Note("the table is damaged", "warning", "objects", stage="preprocess")
    done = replace(LEAK, key="views", value=4)  # the run has the remedy already
    clock = replace(LEAK, key="data.columns", value=["leave_out:my clock, s"])
    changes = {"views": 4, "data_columns": ["time:t"]}
    remark = Note("remark", stage="preprocess")
    for note, command in ((LEAK, line), (other, ""), (done, ""), (clock, without_clock)):
        judged, steps, lines = advice(finished(RIGHT, notes=[note, remark], **changes))
        assert judged.kind == "unsure"
        assert "1 warning of a stage puts it in doubt." in judged.reasons
        assert steps[0].startswith("Correct")
        assert lines.split("\n")[0] == command


DOUBTS = [
    (10, 0.25, 0.25, "open"),
    (9, 0.2, 0, "unsure"),
    (10, 0.3, 0, "unsure"),
    (10, 0.2, 0.26, "unsure"),
]


@pytest.mark.parametrize(("groups", "high", "new", "kind"), [*DOUBTS, (1, None, 0, "bad")])
def test_few_groups_a_wide_interval_and_a_new_session_above_it_are_doubts(groups, high, new, kind):
    run = finished(RIGHT)
    run.metrics["groups"] = {"test": groups}
    run.metrics["new_session"] = {"error": {"mean": new}}
    run.metrics[WHOLE]["error"] |= {"mean": 0.1, "low": high and 0.0, "high": high}
    assert verdict(replace(run)).kind == kind


def test_sessions_are_left_out_in_no_more_folds_than_there_are(elsewhere):
    run = finished(RIGHT, notes=[Note("", topic="new session")], split_fold=1)
    run.records["ingest"] = replace(RECORD, counts={"sessions": 2})
    assert {"split.fold=0", "split.by=session", "split.folds=2"} <= set(advice(run)[2].split())


def test_no_verdict_is_an_all_clear():
    for answers in (RIGHT, FEW, ALWAYS_BALL):
        assert "Yes" not in verdict(finished(answers)).answer


def test_a_report_says_which_checks_were_made():
    run = finished(RIGHT, notes=[Note("a", "warning", "unit", stage="ingest")])
    run.records["ingest"] = replace(RECORD, counts={})
    outcomes = {check.what: check.outcome for check in run_checks(run)}
    assert outcomes.pop("units that differ four times or more") == "1 warning"
    assert all(outcome.startswith("not checked") for outcome in outcomes.values())
    counts = {"recordings.with_shared_frames": 0, "recordings.with_times": 0}
    run.records["ingest"] = replace(RECORD, counts=counts)
    run.records["preprocess"] = replace(run.records["preprocess"], counts={"leak.error": 0.5})
    outcomes = {check.what: check.outcome for check in run_checks(run)}
    assert outcomes["equal frames at the ends of recordings"] == "nothing found"
    assert outcomes["objects that are recognised without contact"] == "nothing found"
    assert outcomes["times and frame rates"] == "not checked: no times"


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("", "report.html"),
        ("brave-mug", "report-brave-mug.html"),
        ("HEAD~1", "report-HEAD-1.html"),
        ("refs/exps/a b", "report-refs-exps-a-b.html"),
        ("../runs of/Öl/", "report-runs-of-Öl.html"),
        ("..", "report-run.html"),
        ("/far/" + "x" * 300, f"report-{'x' * 60}.html"),
    ],
)
def test_the_page_of_a_named_run_does_not_replace_that_of_the_workspace(name, file):
    assert str(page_path(name)) == file


def test_the_terminal_has_the_difference_from_the_committed_run():
    note = Note("views=8 -> 4: 16.7 % are wrong", topic=VERSUS)
    for notes, count in (([note], 1), ([], 0)):
        run = finished(RIGHT, notes=notes)
        run.metrics["new_sessions"] = False
        lines = report_lines(run, "report.html: 9 kB")
        compared = [line for line in lines if "committed" in line]
        assert len(compared) == count
        assert all(line.endswith(note.text) for line in compared)


def test_the_terminal_says_why_a_result_is_in_doubt():
    run = finished(RIGHT, notes=[replace(LEAK, key="views", value=4)])
    run.metrics["new_sessions"] = False
    lines = report_lines(run, "report.html: 9 kB")
    (line,) = [line for line in lines if "not yet reliable" in line]
    assert "1 warning of a stage puts it in doubt." in line


def test_a_report_outside_a_clone_says_to_go_to_one(elsewhere, monkeypatch):
    monkeypatch.delenv("DVC_ROOT", raising=False)
    with pytest.raises(UserError, match="clone") as error:
        read_run()
    assert "inspect" not in str(error.value)
    for name in ("dvc.yaml", "params.yaml"):
        (elsewhere / name).touch()
    with pytest.raises(UserError, match="inspect"):
        read_run()
