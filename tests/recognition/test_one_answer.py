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
    """Return three channels (40, 1, 3) that rise, or fall for an even seed, between the same
    readings.
    """
    rng = np.random.default_rng(seed)
    return (
        np.linspace(-1, 1, 40)[:, None] * (1 if seed % 2 else -1) + rng.normal(0, 0.1, (40, 3))
    )[:, None]


def grasp(seed: int) -> np.ndarray:
    """Return a recording of one of three objects, in contact from its first frame to its last."""
    return recording(OBJECTS[seed % 3], seed, before=0, held=12 + seed % 5, after=0)


@pytest.mark.parametrize("part", [0, 0.25], ids=["whole counts", "fractions"])
@pytest.mark.parametrize("times", [1 / 1000, 12], ids=["volts", "a different gain"])
def test_what_one_interface_refuses_all_refuse_in_the_same_words(tmp_path, part, times):
    X, y, path = (
        [grasp(seed) + part for seed in range(9)],
        np.arange(9) % 3,
        tmp_path / "classifier.pt",
    )
    classifier, new = (
        TactileClassifier("kernels", params=ALL_CONTACT).fit(X, y),
        [times * counts for counts in X[:2]],
    )
    classifier.save(path)
    for number, counts in enumerate(new):
        write(tmp_path / "new" / f"{number}.h5", counts)
    words, lists = (
        ["predict", str(path), str(tmp_path / "new")],
        {"recordings": [counts.tolist() for counts in new]},
    )
    lines = []
    for first, ask in {
        "X[0]": lambda: classifier.predict(new),
        "recording 0": lambda: RecogniserModel(Recogniser(path)).predict(lists),
        str(tmp_path / "new" / "0"): lambda: CliRunner().invoke(cli, words, catch_exceptions=False),
    }.items():
        with pytest.raises(Exception, match="expected") as error:
            ask()
        lines.append(str(error.value).partition(first)[2])
    assert lines[0].startswith(" and 1 more of 2 recordings: ") and len(set(lines)) == 1


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
    X, y = [recorded(seed) for seed in range(6 * objects)], np.arange(6 * objects) % objects
    new = [recorded(100 * objects + seed) for seed in range(2 * objects)]
    truth = np.arange(2 * objects) % objects
    classifier = TactileClassifier(preset, system, views=4, params=params).fit(X, y)
    by_class = classifier.predict_proba(new)
    assert system or (by_class.argmax(axis=1) == truth).all()
    classifier.save(tmp_path / "classifier.pt")

    for number, counts in enumerate(new):
        write(tmp_path / "new" / f"{number:02d}.h5", counts, session=str(number))
    words = [str(tmp_path / name) for name in ("classifier.pt", "new", "answers.csv")]
    result = CliRunner().invoke(
        cli, ["predict", *words[:2], "--csv", words[2]], catch_exceptions=False
    )
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader((tmp_path / "answers.csv").read_text("utf-8").splitlines()))
    by_command = [
        {row[f"class_{place}"]: float(row[f"probability_{place}"]) for place in (1, 2, 3)[:objects]}
        for row in rows
    ]
    np.testing.assert_allclose(
        [[row[str(name)] for name in range(objects)] for row in by_command], by_class, atol=1e-6
    )

    recogniser = Recogniser(tmp_path / "classifier.pt")
    lists = np.empty(len(new), dtype=object)
    lists[:] = [counts.tolist() for counts in new]  # as the server parses a request
    np.testing.assert_allclose(
        RecogniserModel(recogniser).predict({"recordings": lists}), by_class, atol=1e-6
    )

    table = of_arrays(
        [*X, *new],
        list(map(str, range(objects))),
        np.concatenate([y, truth]),
        np.arange(len(X + new)),
    )
    frames = preprocess_recordings(
        table,
        recogniser.plan.params,
        classifier.params_.split,
        groups=table.columns["recording"],
    ).frames
    trained, content = recogniser.classifier, recogniser.content
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


def test_recordings_in_memory_have_one_answer_whatever_the_training_s_sessions_are_called(
    tmp_path,
):
    """This glove's baseline differs between sessions, and some recordings have no open hand."""
    rng, source = np.random.default_rng(0), tmp_path / "source"
    offsets = {"session 0": 0.0, "session 1": 25.0, "session": -25.0, "": 15.0, "X[0]": -15.0}
    for number, (session, offset) in enumerate(offsets.items()):
        shift = np.rint(offset * rng.normal(0, 1, SHAPE)).astype(np.int16)
        write(
            source / f"{number}.h5",
            empty_hand(number) + shift,
            object="empty_hand",
            session=session,
        )
        for place, name in enumerate(OBJECTS):
            for repeat in range(2):
                counts = recording(name, 10 * number + 5 * repeat + place) + shift
                write(source / f"{number}{name}{repeat}.h5", counts, object=name, session=session)
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
        alone = classifier.predict_proba([counts])[0]
        others = [each for each in held if each is not counts]
        for X in ([counts] * 6, [*others, counts, *others, counts]):
            rows = classifier.predict_proba(X)
            from_server = served.predict({"recordings": [each.tolist() for each in X]}).to_numpy()
            for place, each in enumerate(X):
                if each is counts:
                    np.testing.assert_array_equal(rows[place], alone)
                    np.testing.assert_allclose(from_server[place], alone, atol=1e-6)
