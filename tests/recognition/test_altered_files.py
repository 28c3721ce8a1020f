"""A classifier's file that is damaged or was altered is refused in one line, and no code in it
runs.
"""

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.special import softmax

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.nn.network import spread_frames
from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.glove_data import SHAPE, answer_of, model_file, recording

RAN = "the code in the file has run"
ABSENT = object()
SMALL = "model.system=mvcnn", "model.backbone.width=8", "pretrain.epochs=1", "finetune.epochs=1"
ESTIMATOR = "learnt/members/trees/whole"


class Code:
    """Runs a command when it is unpickled."""

    def __reduce__(self):
        return os.system, (f"echo {RAN}",)


#: what is altered: the system, the place, its new value or a function of the old one, what the line
#: names
CASES = {
    "a pickle": ("trees", "weights", Code(), "UnpicklingError"),
    "a pickle as an array": ("trees", f"{ESTIMATOR}/left", Code(), "UnpicklingError"),
    "a key missing": ("trees", "scale", ABSENT, "scale"),
    "a key too many": ("trees", "code", "x", "code"),
    "a different member": ("kernel", "model/members", ["trees"], "altered"),
    "a baseline that no count reaches": (
        "trees",
        "plan/baselines",
        torch.full((1, *SHAPE), -1e30),
        "again",
    ),
    "a temperature of nearly 0": ("trees", "temperature", 1e-300, "temperature"),
    "recordings of no length": ("trees", "learnt/short", 1e9, "short"),
    "a width that would fill the memory": ("mvcnn", "model/backbone/width", 1_000_000, "1000000"),
}
#: of the plan: what new recordings could not be measured or checked by
CASES |= {
    "no live sensor": ("trees", "plan/live", torch.zeros(SHAPE, dtype=torch.bool), "no sensor"),
    "live sensors of another type": ("trees", "plan/live", torch.ones(SHAPE), "no sensor"),
    "noise of another shape": ("trees", "plan/noise", torch.ones(3, 3), "noise"),
    "a session without a baseline": ("trees", "plan/sessions", ["session 0", "x"], "baselines"),
    "no baselines": ("trees", "plan/baselines", torch.zeros(0, *SHAPE), "baselines"),
    "a sensor without a name": ("trees", "plan/channel_names", ["a"], "1 names of 80"),
    "one strong reading": ("trees", "plan/strong_readings", [[1.0], [1.0, 2.0]], "pairs"),
    "three rates": ("trees", "plan/rates", [1.0, 2.0, 3.0], "pairs"),
    "a baseline that is not decided": ("trees", "plan/params/baseline", "auto", "not decided"),
    "a number of sensors that is not decided": (
        "trees",
        "plan/params/contact_sensors",
        "auto",
        "not decided",
    ),
    "a filter that there is not": ("trees", "plan/params/filter", "x", "filter"),
}
for noise in (np.inf, -1.0):
    CASES[f"noise {noise}"] = "trees", "plan/noise", torch.full(SHAPE, noise), "noise"


def altered(path: Path, system: str, place: str, value) -> Path:
    """Return a file of one system on the small glove, with a different value in one place."""
    options = SMALL if system == "mvcnn" else ["model.system=sensors", f"model.members=[{system}]"]
    tree = part = torch.load(model_file(path, *options), weights_only=True)
    *keys, last = place.split("/")
    for key in keys:
        part = part[int(key)] if isinstance(part, list) else part[key]
    new = value(part[last]).contiguous() if callable(value) else value
    if new is ABSENT:
        del part[last]
    else:
        part[last] = new
    torch.save(tree, path)
    seal(path)
    return path


def seal(path: Path) -> None:
    """Append the SHA-256 digest of a file to it."""
    path.write_bytes(path.read_bytes() + hashlib.sha256(path.read_bytes()).digest())


def refused(path: Path) -> str:
    """Return the line with which the recogniser refuses a file."""
    with pytest.raises(UserError) as error:
        Recogniser(path)
    line = str(error.value)
    assert line.startswith(f"{path}: ") and len(line.splitlines()) == 1
    return line


#: other values of an array, of all or of a row
CHANGES = (
    lambda array, rng: 0 * array,
    lambda array, rng: -1e30 * array,
    lambda array, rng: array * np.nan,
    lambda array, rng: array.ravel()[rng.permutation(array.numel())].reshape(array.shape),
    lambda array, rng: (
        array.index_fill(0, torch.tensor(rng.integers(len(array))), -7)
        if array.ndim
        else -7 * array
    ),
)


def places_of(part, place=""):
    """Return the places of all tensors in a file's content."""
    if isinstance(part, torch.Tensor):
        return [place.removeprefix("/")]
    return (
        [each for key in part for each in places_of(part[key], f"{place}/{key}")]
        if isinstance(part, dict)
        else []
    )


def asked(path):
    """Return the probabilities of a grasp, of a grasp without an open hand, and of a grasp of two
    frames; None if the file is refused.
    """
    new = (
        recording("cup", 81),
        recording("pen", 83, before=0, after=0),
        recording("pen", 82, held=2),
    )
    try:
        model = Recogniser(path)
        return [answer_of(model, counts).probabilities for counts in new]
    except UserError as error:
        assert len(str(error).splitlines()) == 1


@pytest.mark.parametrize("system", ["kernel", "svm", "trees", "convolutions", "mvcnn"])
def test_an_altered_array_is_refused_in_one_line_or_has_finite_answers(tmp_path, system):
    path, rng = tmp_path / "classifier.pt", np.random.default_rng(0)
    places = places_of(torch.load(altered(path, system, "precision", "float32"), weights_only=True))
    for place in rng.permutation(places)[:10]:
        for change in CHANGES:
            answers = asked(
                altered(path, system, place, lambda array, change=change: change(array, rng))
            )
            assert answers is None or np.isfinite(answers).all(), place


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_an_altered_file_is_refused_and_runs_no_code(tmp_path, capfd, case):
    *alteration, named = case
    assert named in refused(altered(tmp_path / "classifier.pt", *alteration))
    assert RAN not in capfd.readouterr().out


def test_a_file_with_any_bit_flipped_is_refused(tmp_path):
    stored, path = (
        bytearray(model_file(tmp_path / "classifier.pt").read_bytes()),
        tmp_path / "flipped.pt",
    )
    for place in np.random.default_rng(0).choice(8 * len(stored), 200, replace=False):
        stored[place // 8] ^= (bit := 1 << place % 8)
        path.write_bytes(stored)
        assert "digest" in refused(path)
        stored[place // 8] ^= bit


def of_view_sets(model):
    """Return the answers of a classifier on the sensors to view sets of each size, of the frames
    that its file holds.
    """
    content, classifier = model.content, model.classifier
    read = [
        classifier.frame_values(each) for each in content.examples - content.plan.mean_baseline()
    ]
    sets = [spread_frames(8, size)[None] for size in (1, 2, 4, 8)]
    return softmax(
        [[classifier.view_sets(values, each)[0] for each in sets] for values in read], axis=-1
    )


@pytest.mark.parametrize("system", ["trees", "svm", "pooled_kernel"])
def test_an_altered_estimator_of_view_sets_is_refused_or_answers_alike(tmp_path, system):
    """Estimators of whole recordings do the same. A member that reads an order also has an
    estimator of view sets.
    """
    path, rng = tmp_path / "classifier.pt", np.random.default_rng(0)
    tree = torch.load(altered(path, system, "precision", "float32"), weights_only=True)
    expected, refusals = of_view_sets(Recogniser(path)), 0
    places = [place for place in places_of(tree) if "/sets/" in place]
    for place in places:
        for change in CHANGES:
            altered(path, system, place, lambda array, change=change: change(array, rng))
            try:
                actual = of_view_sets(Recogniser(path))
            except UserError as error:
                assert len(str(error).splitlines()) == 1
                refusals += 1
            else:
                # bfloat16's tolerance
                np.testing.assert_allclose(actual, expected, atol=0.101, err_msg=place)
    assert refusals > len(places)


@pytest.mark.parametrize("system", ["trees", "svm", "mvcnn"])
def test_a_file_with_a_single_stored_answer_altered_is_refused(tmp_path, system):
    """The answers are altered by more than two processors differ in bfloat16, the precision of the
    training.
    """
    path = tmp_path / "classifier.pt"
    tree = torch.load(altered(path, system, "precision", "bfloat16"), weights_only=True)
    for place in ("answers", "set_answers"):
        # a network answers view sets and recordings by equal weights
        if system == "mvcnn" and place == "set_answers":
            continue
        for number in range(tree[place].numel()):
            change = torch.zeros(tree[place].shape, dtype=tree[place].dtype)
            change.view(-1)[number] = 0.15
            assert "again" in refused(
                altered(path, system, place, lambda array, change=change: array + change)
            )


@pytest.mark.parametrize(
    ("system", "field"),
    [
        ("trees", "set_answers"),
        ("trees", "plan/least_change"),
        ("trees", "clusters"),
        ("mvcnn", "clusters"),
    ],
)
def test_a_file_of_an_earlier_version_which_lacks_a_field_is_read(tmp_path, system, field):
    path = altered(tmp_path / "classifier.pt", system, field, ABSENT)
    assert Recogniser(path).classes == ["ball", "cup", "pen"]
