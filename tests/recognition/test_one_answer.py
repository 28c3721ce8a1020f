"""A recording has the same probability in the command, the class, the served model and the
evaluation.
"""

import csv

import numpy as np
import pytest
from click.testing import CliRunner

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.cli import cli
from tactile_viewgcn.evaluation.trials import recording_answers
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import default_params, preset_changes
from tactile_viewgcn.recognition.estimator import train
from tactile_viewgcn.recognition.mlflow_model import RecogniserModel
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.tables.recordings import recordings_of
from tests.glove_data import CPU, OBJECTS, SHAPE, empty_hand, of_arrays, recording, write

ALL_CONTACT = {"preprocess.baseline": "none", "preprocess.zero": 500, "preprocess.filter": "none"}
NETWORK = {
    "precision": "float32",
    "preprocess.scale": 60,
    "model.backbone.width": 8,
    "pretrain.epochs": 5,
    "finetune.epochs": 2,
}


def rising_channels(seed: int) -> np.ndarray:
    """Return three channels (40, 1, 3) that rise if the seed is odd, and fall if it is even."""
    rng = np.random.default_rng(seed)
    rise = np.linspace(-1, 1, 40)[:, None]
    if seed % 2 == 0:
        rise = -rise
    return (rise + rng.normal(0, 0.1, (40, 3)))[:, None]


def grasp(seed: int) -> np.ndarray:
    """Return a recording of one of three objects, in contact from its first frame to its last."""
    return recording(OBJECTS[seed % 3], seed, before=0, held=12 + seed % 5, after=0)


@pytest.mark.parametrize("part", [0, 0.25], ids=["whole counts", "fractions"])
@pytest.mark.parametrize("times", [1 / 1000, 12], ids=["volts", "a different gain"])
def test_what_one_interface_refuses_all_refuse_in_the_same_words(tmp_path, part, times):
    X = [grasp(seed) + part for seed in range(9)]
    y = np.arange(9) % 3
    path = tmp_path / "classifier.pt"
    classifier = TactileClassifier("kernels", params=ALL_CONTACT).fit(X, y)
    new = [times * counts for counts in X[:2]]
    classifier.save(path)
    for index, counts in enumerate(new):
        write(tmp_path / "new" / f"{index}.h5", counts)
    words = ["predict", str(path), str(tmp_path / "new")]
    lists = {"recordings": [counts.tolist() for counts in new]}
    lines = []
    calls = {
        "X[0]": lambda: classifier.predict(new),
        "recording 0": lambda: RecogniserModel(Recogniser(path)).predict(lists),
        str(tmp_path / "new" / "0"): lambda: CliRunner().invoke(cli, words, catch_exceptions=False),
    }
    for first_recording, call in calls.items():
        with pytest.raises(Exception, match="expected") as error:
            call()
        lines.append(str(error.value).partition(first_recording)[2])
    assert lines[0].startswith(" and 1 more of 2 recordings: ")
    assert len(set(lines)) == 1


CASES = {
    "system on the sensors": ("kernels", None, ALL_CONTACT, grasp, 3),
    "channels that rise or fall": ("best", None, {}, rising_channels, 2),
    "network": (None, "view_gcn", ALL_CONTACT | NETWORK, grasp, 3),
}


@pytest.mark.parametrize(
    ("preset", "system", "params", "recorded", "objects"), CASES.values(), ids=CASES
)
def test_one_recording_has_one_probability_by_all_interfaces(
    tmp_path, preset, system, params, recorded, objects
):
    X = [recorded(seed) for seed in range(6 * objects)]
    y = np.arange(6 * objects) % objects
    new = [recorded(100 * objects + seed) for seed in range(2 * objects)]
    truth = np.arange(2 * objects) % objects
    classifier = TactileClassifier(preset, system, views=4, params=params).fit(X, y)
    by_class = classifier.predict_proba(new)
    assert system or (by_class.argmax(axis=1) == truth).all()
    classifier.save(tmp_path / "classifier.pt")

    for recording_id, counts in enumerate(new):
        write(tmp_path / "new" / f"{recording_id:02d}.h5", counts, session=str(recording_id))
    model, recordings, answers_file = (
        str(tmp_path / name) for name in ("classifier.pt", "new", "answers.csv")
    )
    words = ["predict", model, recordings, "--csv", answers_file]
    result = CliRunner().invoke(cli, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    rows = csv.DictReader((tmp_path / "answers.csv").read_text("utf-8").splitlines())
    by_command = []
    for row in rows:
        probabilities = {
            row[f"class_{rank}"]: float(row[f"probability_{rank}"])
            for rank in range(1, objects + 1)
        }
        by_command.append([probabilities[str(name)] for name in range(objects)])
    np.testing.assert_allclose(by_command, by_class, atol=1e-6)

    recogniser = Recogniser(tmp_path / "classifier.pt")
    lists = np.empty(len(new), dtype=object)
    lists[:] = [counts.tolist() for counts in new]  # as the server parses a request
    np.testing.assert_allclose(
        RecogniserModel(recogniser).predict({"recordings": lists}), by_class, atol=1e-6
    )

    names = [str(name) for name in range(objects)]
    table = of_arrays([*X, *new], names, np.concatenate([y, truth]), np.arange(len(X + new)))
    frames = preprocess_recordings(
        table,
        recogniser.plan.params,
        classifier.params_.split,
        groups=table.columns["recording"],
    ).frames
    trained = recogniser.classifier
    content = recogniser.content
    trained.prepare(CPU)
    index = np.flatnonzero(frames.recording >= len(X))
    inputs = frames.inputs(index, content.transform)
    values = trained.frame_values(inputs)
    answers = recording_answers(
        trained,
        content.temperature,
        values,
        inputs[:, frames.live],
        frames.recording[index] - len(X),
    )
    np.testing.assert_allclose(np.exp(answers), by_class, atol=1e-6)


@pytest.mark.filterwarnings("ignore:in . of . recordings? no empty or open hand")
def test_recordings_in_memory_have_one_answer_whatever_the_training_s_sessions_are_called(
    tmp_path,
):
    """This glove's baseline differs between sessions, and some recordings have no open hand."""
    rng = np.random.default_rng(0)
    source = tmp_path / "source"
    offsets = {"session 0": 0.0, "session 1": 25.0, "session": -25.0, "": 15.0, "X[0]": -15.0}
    for index, (session, offset) in enumerate(offsets.items()):
        shift = np.rint(offset * rng.normal(0, 1, SHAPE)).astype(np.int16)
        counts = empty_hand(index) + shift
        write(source / f"{index}.h5", counts, object="empty_hand", session=session)
        for label, name in enumerate(OBJECTS):
            for repeat in range(2):
                counts = recording(name, 10 * index + 5 * repeat + label) + shift
                write(source / f"{index}{name}{repeat}.h5", counts, object=name, session=session)
    with recordings_of(source) as table:
        changes = (
            "preprocess.baseline=empty_hand",
            "preprocess.filter=contact",
            "preprocess.contact_sensors=6",
        )
        params = default_params((*preset_changes("kernels"), *changes))
        train(table, params, table.columns["recording"], tmp_path / "classifier.pt")
    held = [recording(name, 90, before=0, after=0) for name in OBJECTS]
    classifier = TactileClassifier.load(tmp_path / "classifier.pt")
    served = RecogniserModel(Recogniser(tmp_path / "classifier.pt"))
    for counts in held:
        expected = classifier.predict_proba([counts])[0]
        others = [other for other in held if other is not counts]
        for X in ([counts] * 6, [*others, counts, *others, counts]):
            rows = classifier.predict_proba(X)
            request = {"recordings": [recorded.tolist() for recorded in X]}
            from_server = served.predict(request).to_numpy()
            for index, recorded in enumerate(X):
                if recorded is counts:
                    np.testing.assert_array_equal(rows[index], expected)
                    np.testing.assert_allclose(from_server[index], expected, atol=1e-6)
