"""The model card of a run whose numbers are known."""

import re
from copy import copy
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tactile_viewgcn.evaluation.finished_run import FinishedRun
from tactile_viewgcn.evaluation.trials import WHOLE, Predictions, Trials
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.pages.card import escaped, model_card, of_stag, write_card
from tactile_viewgcn.pages.run_page import run_facts
from tactile_viewgcn.params import VIRTUAL
from tests.glove_data import OBJECTS, recogniser
from tests.records import RECORD

# A row for each object. The first is once taken for the third, and the third twice for the second.
ANSWERS = [[0, 0, 0, 2], [1, 1, 1, 1], [2, 2, 1, 1]]
READ = {
    "frames": 1200,
    "recordings": 24,
    "objects": 3,
    "sessions": 2,
    "sensors": 80,
    "recordings.with_shared_frames": 0,
    "recordings.with_times": 24,
}
KEPT = {
    "frames.kept": 1000,
    "recordings.kept": 24,
    "frames.train": 500,
    "recordings.train": 12,
    "groups.train": 12,
    "frames.validation": 0,
    "recordings.validation": 0,
    "groups.validation": 0,
    "frames.test": 500,
    "recordings.test": 12,
    "groups.test": 12,
}
VALUES = {
    "data.source": "my glove",
    "data.shape": "auto",
    "data.layout": "auto",
    "data.columns": [],
    "split.by": "recording",
    "split.folds": 2,
    "split.fold": 1,
    "model.system": "sensors",
    "model.members": ["kernel"],
}
ORIGIN = {
    "time": "2026-01-02T03:04:05+00:00",
    "mlflow.source.git.commit": "c" * 40,
    "git.dirty": "false",
    "processor": "A CPU",
    "cores": "2",
    "device": "cpu",
    "precision": "float32",
    "python": "3.11.7",
    "torch": "2.10.0",
}


def error(mean, low, high, **others):
    """Return an error rate with its interval, and other scores."""
    return {"error": {"mean": mean, "low": low, "high": high}} | others


def a_run(*, notes=(), live=(), names=OBJECTS, metrics=None, **changes):
    """Return a run of 12 test recordings, of which 3 are answered wrongly.

    Args:
        notes: notes of the preprocessing.
        live: errors of the recordings as a stream.
        names: the objects.
        metrics: metrics that are added or replaced.
        changes: parameters of other values.
    """
    labels = np.repeat(np.arange(3), 4)
    answers = np.array(ANSWERS).reshape(1, -1, 1)
    groups = np.arange(12)
    whole = Trials(answers, labels, groups, groups.astype(str), 48)
    scores = {
        "views": 8,
        "groups": {"test": 12},
        "new_sessions": False,
        WHOLE: error(0.25, 0.125, 0.5),
        "recording": error(0.375, 0.25, 0.625, top3_error=0.0625),
        "object": error(0.3125, 0.1875, 0.5),
    }
    params = {"values": VALUES | changes, "changed": {}}
    record = replace(RECORD, params=params, origin=ORIGIN, notes=[])
    records = {
        "ingest": replace(record, counts=READ, inputs={"source": {"path": "x", "md5": "a1b2"}}),
        "preprocess": replace(record, counts=KEPT, notes=list(notes)),
        "finetune": replace(record, origin=ORIGIN | {"time": "2026-01-01T00:00:00+00:00"}),
        "evaluate": replace(record, name="my glove · kernels", run_id="f" * 32),
    }
    timing = {"latency_ms": {"whole": {"median": 3.25}}}
    predictions = Predictions({WHOLE: whole}, np.array(names))
    return FinishedRun("", scores | (metrics or {}), timing, predictions, records, list(live))


def card_of(run=None, **changes):
    """Return the card as one line, in which single blanks separate the words.

    Args:
        run: by default `a_run`.
        changes: attributes of the model of other values.
    """
    model = copy(recogniser())
    for name, value in changes.items():
        setattr(model, name, value)
    return " ".join(model_card(run or a_run(), model).split())


def test_the_card_has_the_numbers_of_the_run():
    lines = model_card(a_run(), recogniser()).splitlines()
    assert lines[0] == "# Model card: my glove · kernels"
    names = ", ".join(f"`{name}`" for name in OBJECTS)
    ball, cup, pen = OBJECTS
    expected = [
        f"3 objects: {names}.",
        "| System | `sensors`, with the members `kernel` |",
        "| Frames in a view set | 8 |",
        "| Shape of a frame | 8 rows, 10 columns |",
        "| Sensors that vary | 80 |",
        "| Readings | raw, as `int16` |",
        "| `preprocess.baseline` | `empty_hand` |",
        "| `preprocess.contact_sensors` | `6` |",
        "| recorded | 1,200 | 24 |  |",
        "| training | 500 | 12 | 12 |",
        "| test | 500 | 12 | 12 |",
        # 3 of 12 recordings
        "| `whole` | whole recordings: one answer to each recording, from all its frames, as a "
        "user gets it | 25.0 (12.5 to 50.0) |  |",
        "| `recording` | recording protocol: 8 frames of one recording | 37.5 (25.0 to 62.5)"
        " | 6.2 |",
        "| `object` | object protocol: 8 frames of any test recordings of the object, as in the "
        "paper | 31.2 (18.8 to 50.0) |  |",
        f"| {pen} | 50.0 | 4 | {cup} (50.0\xa0%) |",
        f"| {ball} | 25.0 | 4 | {pen} (25.0\xa0%) |",
        f"| {cup} | 0.0 | 4 |  |",
        "tactile-viewgcn predict models/classifier.pt NEW_RECORDINGS",
        'classifier = TactileClassifier.load("models/classifier.pt")',
        "| Recordings | md5 a1b2 |",
        f"| Code | {'c' * 40} |",
        "| Trained | 01 January 2026, 00:00 UTC |",
        "| Evaluated | 02 January 2026, 03:04 UTC |",
        "| Machine | A CPU, 2 cores |",
        "| Computed on | cpu in float32 |",
        "| Versions | tactile-viewgcn 0.4.0, python 3.11.7, torch 2.10.0 |",
    ]
    assert [line for line in expected if line not in lines] == []
    assert not [line for line in lines if line.startswith("| validation")]
    text = card_of()
    assert "By chance, 66.7 % of the answers would be wrong." in text
    assert "divided by recording: part 2 of 2 is the test set" in text
    assert "took 3.2 ms" in text


def test_the_errors_of_sessions_are_named_by_what_was_tested():
    not_measured = "The error for a new session (a person, a day, a new fitting) was not measured."
    shared = "The training set and the test set share sessions."
    assert not_measured in card_of() and shared in card_of()
    tested = card_of(a_run(metrics={"new_sessions": True}))
    assert "No session is in both the training set and the test set." in tested
    assert "Error `whole` is of new sessions." in tested
    assert not_measured not in tested
    held_out = card_of(a_run(metrics={"new_session": error(0.5, 0.375, 0.625)}))
    assert "was held out of the fits that answered it | 50.0 (37.5 to 62.5) |" in held_out
    assert not_measured not in held_out


def test_the_card_and_the_page_say_the_same_of_an_error():
    validated = {"groups": {"validation": 12}, "new_session": error(0.5, 0.375, 0.625)}
    run = a_run(metrics=validated, **{"split.by": "grasp"})
    meanings = run_facts(run)["meanings"]
    assert meanings["recording"] == "8 frames of one grasp"
    assert meanings["object"].startswith("8 frames of any validation recordings of the object")
    assert run_facts(a_run(metrics={"views": 1}))["meanings"]["recording"].startswith("1 frame of")
    text = card_of(run)
    for meaning in meanings.values():
        assert f": {meaning} |" in text


def test_what_is_said_of_probabilities_follows_from_the_model_and_the_stream():
    assert recogniser().calibrated
    assert "their temperature was fitted to out-of-fold answers" in card_of()
    assert "They are not calibrated" in card_of(calibrated=False)
    network = {"model.system": "view_gcn"}
    assert "was fitted to answers to the validation set" in card_of(a_run(**network))
    reached = {"answer": "sure", "level": 0.9, "share": 0.5, "error": 0.125, "low": 0, "high": 0.25}
    never = {"answer": "sure", "level": 0.95, "share": 0.0, "error": None, "low": None}
    text = card_of(a_run(live=[reached, never | {"high": None}]))
    assert "| 90 % or more | 50.0 % | 12.5 (0.0 to 25.0) |" in text
    assert "95 % or" not in text
    assert "answer to each grasp that reached a probability before the hand opened." in text
    never |= {"high": None}
    assert "No answer reached 80 % before the hand opened." in card_of(a_run(live=[never]))
    assert "as a stream" not in card_of()


def test_the_card_names_the_set_that_was_answered_and_how_much_of_it_as_a_stream():
    final = {"answer": "final", "level": None, "share": 1.0, "error": 0.25, "low": 0, "high": 0.5}
    part = Note("3 of 12 recordings, evenly chosen, were answered", topic="live", stage="evaluate")
    for tested_set in ("test", "validation"):
        run = a_run(live=[final], notes=[part], metrics={"groups": {tested_set: 12}})
        text = card_of(run).partition("## Probabilities")[2].partition("## ")[0]
        assert f"did not keep the probabilities of the {tested_set} set" in text
        answered = f"Recordings of the {tested_set} set were also answered as a stream, grasp by "
        assert f"{answered}grasp; 3 of 12 recordings, evenly chosen, were answered." in text
        assert ("test" in text) == (tested_set == "test")


def answered(*, right, probability, groups=None, tested_set="test"):
    """Return a run whose answers have known probabilities.

    Args:
        right: whether each answer is right.
        probability: probability of each answer, or of all answers.
        groups: split group of each recording; by default each recording is a group.
        tested_set: the set that was answered.
    """
    count = len(right)
    labels = np.arange(count) % 3
    answers = np.where(right, labels, (labels + 1) % 3)
    if groups is None:
        groups = np.arange(count)
    probabilities = np.full((count, 3), 0.0)
    probabilities[np.arange(count), answers] = probability
    names = labels.astype(str)
    whole = Trials(answers[None, :, None], labels, groups, names, 48, probabilities=probabilities)
    run = a_run(metrics={"groups": {tested_set: len(np.unique(groups))}})
    return replace(run, predictions=Predictions({WHOLE: whole}, np.array(OBJECTS)))


def test_the_card_has_the_probabilities_beside_the_errors():
    right = [True] * 9 + [False] + [True] * 5 + [False] * 5
    run = answered(right=right, probability=np.repeat([0.95, 0.75], 10))
    text = card_of(run).partition("## Probabilities")[2].partition("## ")[0]
    difference = (
        "By their probabilities, 15.0\xa0% of the answers to whole recordings would be wrong, and "
        "30.0\xa0% are: a difference of 15.0 ("
    )
    assert difference in text.replace(" %", "\xa0%")
    low, high = re.findall(r"\| 10 \| (\S+) \| (\S+) \(\S+ to \S+\) \|", text)
    assert low == ("25.0", "50.0")
    assert high == ("5.0", "10.0")
    few = answered(right=right[:12], probability=0.75)
    assert "expected error" not in card_of(few)  # a table of one row says nothing new
    assert "An earlier version made this run" in card_of()


@pytest.mark.parametrize(
    ("right", "probability", "groups", "says"),
    [
        (0.5, 0.95, None, "too high on average."),
        (0.9, 0.4, None, "too low on average."),
        (0.5, 0.5, None, "too high or too low on average is not shown."),
        (0.5, 0.95, np.repeat(range(8), 10), "Too few split groups were tested to say more."),
        (0.5, 0.95, np.zeros(80, int), "Too few split groups were tested to say more."),
    ],
)
def test_the_card_says_whether_probabilities_are_too_high(right, probability, groups, says):
    is_right = np.arange(80) % 10 < 10 * right
    assert says in card_of(answered(right=is_right, probability=probability, groups=groups))


def test_the_card_says_if_the_probabilities_were_calibrated_on_these_same_recordings():
    same = "They were calibrated on these same recordings, so the comparison favours them."
    for system, tested_set in product(("view_gcn", "sensors"), ("validation", "test")):
        run = answered(right=[True] * 12, probability=0.75, tested_set=tested_set)
        run.params["model.system"] = system
        is_same_set = system == "view_gcn" and tested_set == "validation"
        assert (same in card_of(run)) == is_same_set


def test_the_training_and_the_evaluation_have_rows_of_their_own():
    run = a_run()
    record = run.records["finetune"]
    trained = {"mlflow.source.git.commit": "d" * 40, "processor": "CPU 7", "git.dirty": "true"}
    trained |= {"device": "A GPU", "torch": "2.9.1"}
    run.records["finetune"] = replace(record, origin=record.origin | trained)
    run.changed = {"views": 12}
    restores = "with changes that were not committed: the commit does not restore it"
    lines = model_card(run, recogniser()).splitlines()
    start = lines.index("| Trained | 01 January 2026, 00:00 UTC |")
    assert lines[start - 1 : start + 11] == [
        "| Recordings | md5 a1b2 |",
        "| Trained | 01 January 2026, 00:00 UTC |",
        f"| Code | {'d' * 40}, {restores} |",
        "| Machine | CPU 7, 2 cores |",
        "| Computed on | A GPU in float32 |",
        "| Versions | tactile-viewgcn 0.4.0, python 3.11.7, torch 2.9.1 |",
        "| Evaluated | 02 January 2026, 03:04 UTC |",
        f"| Code, in the evaluation | {'c' * 40} |",
        "| Machine, in the evaluation | A CPU, 2 cores |",
        "| Computed on, in the evaluation | cpu in float32 |",
        "| Versions, in the evaluation | python 3.11.7, torch 2.10.0 |",
        "| Changed parameters, in the evaluation | views=12 |",
    ]
    same = model_card(a_run(), recogniser())
    assert ", in the evaluation" not in same and restores not in same
    assert "| Changed parameters | none |" in same.splitlines()


def test_python_code_stands_only_with_a_command_that_names_the_file():
    python = 'TactileClassifier.load("models/classifier.pt")'
    assert python in card_of()
    logged = card_of(replace(a_run(), name="f" * 32))
    assert f"tactile-viewgcn predict {'f' * 32} NEW_RECORDINGS ``` Use it for" in logged
    assert "TactileClassifier" not in logged
    assert "models/classifier.pt" not in logged
    run = replace(a_run(), name="brave-mug")
    run.records["evaluate"] = replace(run.records["evaluate"], run_id=None)
    applied = card_of(run)
    assert "dvc exp apply brave-mug tactile-viewgcn predict models/classifier.pt" in applied
    assert python in applied


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (VIRTUAL, "The recordings are computed by the same code."),
        ("data/stag/metadata.mat", "STAG is for research only"),
        ("my glove", "The files do not say under which licence the recordings are."),
        ("/data/staging/my_glove", "The files do not say under which licence the recordings are."),
    ],
)
def test_the_licence_and_the_simulation_are_of_the_source(source, words):
    text = card_of(a_run(**{"data.source": source}))
    assert words in text.partition("## Licence")[2]
    assert ("**Simulated data.**" in text) == (source == VIRTUAL)
    assert ("never seen a recording of a real glove" in text) == (source == VIRTUAL)


def test_files_of_stag_are_known_by_their_names():
    for source in ("/data/STAG/classification", "data/stag_lite", "data/my-stag.zip", "stag2/x"):
        assert of_stag(source), source
    for source in ("my_glove/recordings", "/data/staging/my_glove", "nostag", VIRTUAL):
        assert not of_stag(source), source


def test_a_metadata_mat_is_of_stag_perhaps():
    text = card_of(a_run(**{"data.source": "data/metadata.mat"})).partition("## Licence")[2]
    assert "The files do not say under which licence the recordings are." in text
    assert "If these are recordings of STAG, the following holds. STAG is for research" in text
    assert "If these" not in card_of(a_run(**{"data.source": "stag/metadata.mat"}))


def test_warnings_and_checks_are_those_of_the_stages():
    note = Note("see `split.by` of <a>.", "warning", "leak check", stage="preprocess")
    text = card_of(a_run(notes=[note]))
    assert r"- **preprocess**: leak check: see `split.by` of \<a\>." in text
    assert "| objects that are recognised without contact | 1 warning |" in text
    assert "No stage gave a warning" not in text
    assert "No stage gave a warning" in card_of()


def test_names_are_no_markup():
    names = ["a|b", "<i>c</i>", "_d_"]
    text = card_of(a_run(names=names), classes=names)
    assert r"| a\|b | 25.0 | 4 | \_d\_ (25.0 %) |" in text
    assert r"3 objects: a\|b, `<i>c</i>`, `_d_`." in text
    assert r"| \<i\>c\</i\> | 0.0 |" in text


@pytest.mark.parametrize(
    ("text", "markdown"),
    [
        ("tea_box", "tea_box"),
        ("_x_ *y*", r"\_x\_ \*y\*"),
        ("- a", r"\- a"),
        ("1. a", r"1\. a"),
        ("12. a", r"12\. a"),
        ("123) a - b", r"123\) a - b"),
        ("1.5 a-b", "1.5 a-b"),
        ("[a](b) `c` #", r"\[a\](b) \`c\` \#"),
        ("a\n\n# b", r"a\\n\\n\# b"),
    ],
)
def test_a_text_is_shown_as_it_is(text, markdown):
    assert escaped(text) == markdown


def test_a_card_takes_the_place_of_a_card_and_of_no_edited_one(tmp_path):
    path = tmp_path / "card.md"
    card = model_card(a_run(), recogniser())
    for _ in range(2):
        assert write_card(path, card).startswith(f"{path}: the model card, ")
        assert path.read_text("utf-8") == card
    for text in (card.replace("25.0", "0.0"), f"{card}\nmy notes\n", "my own\n"):
        path.write_text(text, "utf-8")
        with pytest.raises(UserError, match=r"card\.md: .* edited, .* move .* away") as refused:
            write_card(path, card)
        assert "remove" not in str(refused.value)  # that would lose the edits
        assert path.read_text("utf-8") == text


def test_a_model_of_other_objects_is_refused():
    with pytest.raises(UserError, match="the model and the results have different objects"):
        model_card(a_run(names=["cup", "mug", "pen"]), recogniser())
