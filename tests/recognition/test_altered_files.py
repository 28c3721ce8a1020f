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


#: The system, the altered entry, its new value or a function of the old one, and a word in the
#: message
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
#: Entries of the plan, which new recordings are measured and checked by
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


def altered(path: Path, system: str, entry: str, value) -> Path:
    """Write the model file of one system on the small glove, with one altered entry.

    Args:
        path: where the file is written.
        system: a member, or `mvcnn`.
        entry: the keys of the entry, joined by slashes.
        value: the new value, a function that makes it of the old one, or ABSENT.

    Returns:
        The path.
    """
    if system == "mvcnn":
        options = SMALL
    else:
        options = ["model.system=sensors", f"model.members=[{system}]"]
    content = torch.load(model_file(path, *options), weights_only=True)
    *keys, last = entry.split("/")
    part = content
    for key in keys:
        part = part[int(key)] if isinstance(part, list) else part[key]
    if callable(value):
        part[last] = value(part[last]).contiguous()
    elif value is ABSENT:
        del part[last]
    else:
        part[last] = value
    torch.save(content, path)
    seal(path)
    return path


def seal(path: Path) -> None:
    """Append the SHA-256 digest of a file to it."""
    content = path.read_bytes()
    path.write_bytes(content + hashlib.sha256(content).digest())


def refused(path: Path) -> str:
    """Return the line with which the recogniser refuses a file."""
    with pytest.raises(UserError) as error:
        Recogniser(path)
    line = str(error.value)
    assert line.startswith(f"{path}: ") and len(line.splitlines()) == 1
    return line


def shuffled(array, rng):
    """Return the values of an array in a random order."""
    return array.ravel()[rng.permutation(array.numel())].reshape(array.shape)


def with_a_row_replaced(array, rng):
    """Return an array with -7 in a random row, or a number times -7."""
    if array.ndim == 0:
        return -7 * array
    return array.index_fill(0, torch.tensor(rng.integers(len(array))), -7)


CHANGES = (
    lambda array, rng: 0 * array,
    lambda array, rng: -1e30 * array,
    lambda array, rng: array * np.nan,
    shuffled,
    with_a_row_replaced,
)


def tensor_entries(part, entry=""):
    """Return the entries of all tensors in a file's content, as `altered` takes them."""
    if isinstance(part, torch.Tensor):
        return [entry.removeprefix("/")]
    entries = []
    if isinstance(part, dict):
        for key in part:
            entries += tensor_entries(part[key], f"{entry}/{key}")
    return entries


def probabilities_of_grasps(path):
    """Return the probabilities (3, 3) of three grasps, or None if the file is refused.

    The second grasp has no open hand, and the third has two frames.
    """
    grasps = (
        recording("cup", 81),
        recording("pen", 83, before=0, after=0),
        recording("pen", 82, held=2),
    )
    try:
        model = Recogniser(path)
        return [answer_of(model, counts).probabilities for counts in grasps]
    except UserError as error:
        assert len(str(error).splitlines()) == 1


@pytest.mark.parametrize("system", ["kernel", "svm", "trees", "convolutions", "mvcnn"])
def test_an_altered_array_is_refused_in_one_line_or_has_finite_answers(tmp_path, system):
    path = tmp_path / "classifier.pt"
    rng = np.random.default_rng(0)
    content = torch.load(altered(path, system, "precision", "float32"), weights_only=True)
    entries = tensor_entries(content)
    for entry in rng.permutation(entries)[:10]:
        for change in CHANGES:
            answers = probabilities_of_grasps(
                altered(path, system, entry, lambda array, change=change: change(array, rng))
            )
            assert answers is None or np.isfinite(answers).all(), entry


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_an_altered_file_is_refused_and_runs_no_code(tmp_path, capfd, case):
    *alteration, named = case
    assert named in refused(altered(tmp_path / "classifier.pt", *alteration))
    assert RAN not in capfd.readouterr().out


def test_a_file_with_any_bit_flipped_is_refused(tmp_path):
    stored = bytearray(model_file(tmp_path / "classifier.pt").read_bytes())
    path = tmp_path / "flipped.pt"
    for position in np.random.default_rng(0).choice(8 * len(stored), 200, replace=False):
        bit = 1 << position % 8
        stored[position // 8] ^= bit
        path.write_bytes(stored)
        assert "digest" in refused(path)
        stored[position // 8] ^= bit


def view_set_answers(model):
    """Return a classifier's probabilities (R, 4, C) for the recordings that its file holds.

    Each recording is answered by view sets of one, two, four and eight frames.
    """
    content = model.content
    classifier = model.classifier
    view_sets = [spread_frames(8, size)[None] for size in (1, 2, 4, 8)]
    logits = []
    for readings in content.examples - content.plan.mean_baseline():
        values = classifier.frame_values(readings)
        logits.append([classifier.view_sets(values, view_set)[0] for view_set in view_sets])
    return softmax(logits, axis=-1)


@pytest.mark.parametrize("system", ["trees", "svm", "pooled_kernel"])
def test_an_altered_estimator_of_view_sets_is_refused_or_answers_alike(tmp_path, system):
    """Estimators of whole recordings do the same. A member that reads an order also has an
    estimator of view sets.
    """
    path = tmp_path / "classifier.pt"
    rng = np.random.default_rng(0)
    tree = torch.load(altered(path, system, "precision", "float32"), weights_only=True)
    expected = view_set_answers(Recogniser(path))
    refusals = 0
    entries = [entry for entry in tensor_entries(tree) if "/sets/" in entry]
    for entry in entries:
        for change in CHANGES:
            altered(path, system, entry, lambda array, change=change: change(array, rng))
            try:
                actual = view_set_answers(Recogniser(path))
            except UserError as error:
                assert len(str(error).splitlines()) == 1
                refusals += 1
            else:
                # bfloat16's tolerance
                np.testing.assert_allclose(actual, expected, atol=0.101, err_msg=entry)
    assert refusals > len(entries)


@pytest.mark.parametrize("system", ["trees", "svm", "mvcnn"])
def test_a_file_with_a_single_stored_answer_altered_is_refused(tmp_path, system):
    """The answers are altered by more than two processors differ in bfloat16, the precision of the
    training.
    """
    path = tmp_path / "classifier.pt"
    tree = torch.load(altered(path, system, "precision", "bfloat16"), weights_only=True)
    for entry in ("answers", "set_answers"):
        # a network answers view sets and recordings by equal weights
        if system == "mvcnn" and entry == "set_answers":
            continue
        for index in range(tree[entry].numel()):
            change = torch.zeros(tree[entry].shape, dtype=tree[entry].dtype)
            change.view(-1)[index] = 0.15
            altered(path, system, entry, lambda array, change=change: array + change)
            assert "again" in refused(path)


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
