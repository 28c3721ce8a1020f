"""A user's program, which mypy checks against the installed package, and which Python runs.

`assert_type` fails for Any. A comment `type: ignore` stands where mypy must see a mistake: mypy
reports the comment if it sees none.
"""

from pathlib import Path
from typing import Any, assert_type

import numpy as np

from tactile_viewgcn import TactileClassifier
from tactile_viewgcn.live.stream import LiveStream, State, Update
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.params import Params
from tactile_viewgcn.readers.discovery import Source, discover
from tactile_viewgcn.readers.source import AUTO, Form, Recording
from tactile_viewgcn.recognition.recogniser import Answer, Recogniser, recording_of
from tactile_viewgcn.tables.recordings import Recordings, read_source

NumbersOfAnyType = np.ndarray[tuple[Any, ...], np.dtype[Any]]


def use_the_class(recordings: list[NumbersOfAnyType], labels: list[int], file: Path) -> None:
    classifier = TactileClassifier(preset="best", system="svm", random_state=0)
    assert_type(classifier, TactileClassifier)
    assert_type(classifier.fit(recordings, labels), TactileClassifier)
    assert_type(classifier.predict(recordings), NumbersOfAnyType)
    assert_type(classifier.predict_proba(recordings), NumbersOfAnyType)
    assert_type(classifier.classes_, NumbersOfAnyType)
    assert_type(classifier.params_, Params)
    assert_type(classifier.notes_, list[Note])
    assert_type(classifier.recogniser_, Recogniser)
    print("predicted", *classifier.predict(recordings))
    classifier.save(file)
    loaded = TactileClassifier.load(file)
    assert_type(loaded, TactileClassifier)
    print("loaded", *loaded.predict(recordings))
    try:
        TactileClassifier(random=1)  # type: ignore[call-arg]
    except TypeError:
        print("refused random")


def follow_a_glove(file: Path, frames: NumbersOfAnyType) -> None:
    stream = TactileClassifier.load(file).stream(sure=0.9, longest=100)
    assert_type(stream, LiveStream)
    assert_type(stream.classes, list[str])
    updates = stream.push(frames, np.arange(len(frames)))
    updates += stream.close()
    assert_type(updates, list[Update])
    last = updates[-1]
    assert_type(last.state, State)
    assert_type(last.object, str | None)
    assert_type(last.probability, float | None)
    assert_type(last.probabilities, NumbersOfAnyType | None)
    assert_type(last.frames, int)
    print("last update", last.state, last.object, last.frames)
    try:
        stream.push(frames[0], seconds=1)  # type: ignore[call-arg]
    except TypeError:
        print("refused seconds")


def use_the_recogniser(file: Path, counts: NumbersOfAnyType) -> None:
    recogniser = Recogniser(file)
    assert_type(recogniser.classes, list[str])
    assert_type(recogniser.calibrated, bool)
    assert_type(recogniser.stream(every=2), LiveStream)
    recording = recording_of(counts, "first")
    assert_type(recording, Recording)
    answers, notes = recogniser.answer_recordings([recording])
    assert_type(answers, list[Answer])
    assert_type(notes, list[Note])
    assert_type(answers[0].contact, int)
    print("answered", answers[0].recording)


def read_a_folder(folder: Path, table: Path) -> None:
    assert_type(AUTO, Form)
    source = discover(folder, AUTO)
    assert_type(source, Source)
    assert_type(source.files, list[Path])
    read_source(folder, table)
    recordings = Recordings.read(table)
    assert_type(recordings, Recordings)
    assert_type(recordings.objects, list[str])
    assert_type(len(recordings), int)
    print("files", len(source.files), "recordings", len(recordings.recordings))
    try:
        discover(folder / "nothing", AUTO)
    except (UserError, FileNotFoundError) as error:
        print("refused", type(error).__name__)


if __name__ == "__main__":
    ramp = np.arange(9)[:, None]
    recordings = [sign * ramp for sign in (1.0, -1.0, 1.1, -1.2)]
    use_the_class(recordings, [1, 2, 1, 2], Path("classifier.pt"))
    follow_a_glove(Path("classifier.pt"), recordings[0])
    use_the_recogniser(Path("classifier.pt"), recordings[0])
    read_a_folder(Path("glove"), Path("table"))
