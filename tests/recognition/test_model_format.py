"""A model file of the previous version is read; an unknown format is refused in one line."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tactile_viewgcn.recognition.model_format import FORMAT, UPGRADES, package_version, upgraded
from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.glove_data import answer_of, model_file
from tests.recognition.test_altered_files import refused, seal

FILES = Path(__file__).parent / "model_files"
#: The probabilities of all members, and of the members that read the order of time
ALL_MEMBERS = [
    [0.9184, 0.0377, 0.0439],
    [0.0379, 0.9181, 0.0440],
    [0.0441, 0.0377, 0.9182],
]
IN_TIME = [
    [0.9266, 0.0363, 0.0371],
    [0.0366, 0.9263, 0.0371],
    [0.0370, 0.0358, 0.9272],
]
#: Written by version 0.4.0 for recordings as `touched` gives them, with fewer trees and
#: convolutions than usual: the file, its members, and the probabilities that 0.4.0 gave to one new
#: recording of each object
EARLIER = {
    "0.4.0_members.pt": (
        ["kernel", "pooled_kernel", "svm", "trees", "convolutions"],
        ALL_MEMBERS,
    ),
    "0.4.0_in_time.pt": (["trees", "convolutions"], IN_TIME),
}


def touched(label, seed):
    """Return counts (12, 1, 6) of the ball, the cup or the pen; each presses two of six sensors."""
    counts = np.random.default_rng([seed, label]).normal(0, 1, (12, 6))
    counts[:, 2 * label : 2 * label + 2] += 30
    return np.rint(counts).astype(np.int16)[:, None]


@pytest.mark.parametrize("name", EARLIER)
def test_a_file_of_the_version_before_is_read_and_answers_as_it_did_there(name):
    members, expected = EARLIER[name]
    assert (FILES / name).stat().st_size < 200_000
    model = Recogniser(FILES / name)
    assert model.classes == ["ball", "cup", "pen"]
    assert model.content.model.members == members
    answers = [answer_of(model, touched(label, 7)).probabilities for label in range(3)]
    np.testing.assert_allclose(answers, expected, atol=1e-3)
    # one frame is a view set: svm answers for members that read the order of time
    single_frames = [touched(label, 7)[:1] for label in range(3)]
    answers = [answer_of(model, frame).probabilities for frame in single_frames]
    assert np.argmax(answers, axis=1).tolist() == [0, 1, 2]


def test_a_file_has_the_number_of_its_format_and_the_version_that_wrote_it(tmp_path):
    values = torch.load(model_file(tmp_path / "classifier.pt"), weights_only=True)
    assert (values["format"], values["version"]) == (FORMAT, package_version())
    assert upgraded(values, "classifier.pt") == values


def test_every_format_before_this_one_has_an_upgrade():
    assert sorted(UPGRADES) == list(range(FORMAT))


def changed(path, **values):
    """Write a model file with some values changed, and return its path."""
    content = torch.load(model_file(path), weights_only=True)
    torch.save(content | values, path)
    seal(path)
    return path


@pytest.mark.parametrize("unknown", [FORMAT + 1, -1, "1", None])
def test_a_file_of_an_unknown_format_is_refused_by_a_line_with_both_versions(tmp_path, unknown):
    line = refused(changed(tmp_path / "classifier.pt", format=unknown, version="9.8.7"))
    for word in ("9.8.7", str(unknown), package_version(), str(FORMAT), "train"):
        assert word in line


def test_a_version_from_outside_is_quoted_in_part_and_harmless(tmp_path):
    version = "9\n\x1b[31m" + 1000 * "9"
    line = refused(changed(tmp_path / "classifier.pt", format=FORMAT + 1, version=version))
    assert line.isprintable()
    assert 50 * "9" not in line
