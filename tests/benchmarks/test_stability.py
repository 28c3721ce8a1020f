"""Numerical stability: the checks on a small classifier, their measures, and the command's table."""

import csv
import math
import warnings
from dataclasses import replace

import pytest
import torch
from click.testing import CliRunner

from benchmarks.stability import __main__ as command
from benchmarks.stability import invariance, network
from benchmarks.stability.rows import REFUSED, RIGHT, WRONG, Quantity, max_rel_error, share_different, share_not_finite
from benchmarks.stability.subject import Subject
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.systems.classifier import build_classifier
from tactile_viewgcn.tables.frames import write_frames
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.small_tables import CPU, ROOT, SMALL, recipe, table, trained
from tests.stability import refusal

CHECKS = {check.__name__: check for part in (network, invariance) for check in part.CHECKS}


@pytest.fixture
def subject(tmp_path):
    return Subject(trained(), table(), recipe(), CPU, tmp_path)


def verdicts(subject, *names):
    return [row["verdict"] for row in command.run([CHECKS[name] for name in names], subject)]


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_nothing_is_wrong_on_a_small_classifier(subject, name):
    assert set(verdicts(subject, name)) == {RIGHT}


@pytest.mark.slow
@pytest.mark.parametrize("system", ["stag", "gvcnn", "cnn_lstm", "rotationnet", "vote"])
def test_checks_of_the_network_hold_for_other_systems(tmp_path, system):
    params = recipe(f"model.system={system}")
    torch.manual_seed(0)
    classifier = build_classifier(torch.from_numpy(viewpoints(4)), 4, params.model, (12, 12)).eval()
    assert WRONG not in verdicts(Subject(classifier, table(), params, CPU, tmp_path), *CHECKS)


def test_one_thread_that_says_something_else_is_wrong(subject, monkeypatch):
    def threaded(_, head, nodes, sets, precision):
        return nodes[torch.from_numpy(sets)].sum() * torch.get_num_threads()

    monkeypatch.setattr(Subject, "head_logits", threaded)
    assert WRONG in verdicts(subject, "threads")


def test_an_error_above_the_tolerance_is_wrong_and_so_is_no_number():
    assert Quantity("x", 1e-6, 1e-6).verdict == RIGHT
    assert Quantity("x", 1.1e-6, 1e-6).verdict == WRONG
    assert Quantity("x", math.nan, 1e-6).verdict == Quantity("x", math.inf, 1e-6).verdict == WRONG
    assert Quantity("x", math.nan, math.nan, refused=True).verdict == REFUSED


def test_errors_are_relative_to_the_largest_number_of_the_exact_array():
    assert max_rel_error([1.0, 2.0], [1.0, 4.0]) == 0.5
    assert max_rel_error([0.25, 0.0], [0.0, 0.0]) == 0.25
    assert max_rel_error([1.0], [1.0, 1.0]) == max_rel_error([math.nan], [1.0]) == math.inf
    assert share_different([1, 2, 3, 4], [1, 2, 4, 3]) == 0.5 and share_different([1], [1, 2]) == math.inf
    assert share_not_finite([1.0, math.nan, math.inf, 2.0]) == 0.5


def test_a_refusal_has_one_line_that_says_what_is_wrong():
    def refusing(message):
        raise ValueError(message)

    verdicts = [refusal("x", lambda: refusing("views is 0"), pattern).verdict for pattern in ("is 0", "is 1")]
    verdicts += [refusal("x", call, "is 0").verdict for call in (lambda: refusing("is 0\nor not"), lambda: None)]
    assert verdicts == [REFUSED, WRONG, WRONG, WRONG]


def warns(_):
    warnings.warn("overflow", RuntimeWarning, stacklevel=1)
    yield Quantity("x", 0)


def breaks(_):
    yield Quantity("first", 0)
    raise IndexError("far\nout")


def holds(_):
    yield Quantity("good", 0)


def test_a_warning_and_an_exception_are_wrong_and_the_next_check_still_runs(subject):
    rows = command.run([warns, breaks, holds], subject)
    expected = [("warns", WRONG), ("breaks", RIGHT), ("breaks", WRONG), ("holds", RIGHT)]
    assert [(row["check"], row["verdict"]) for row in rows] == expected
    assert rows[0]["remark"] == "RuntimeWarning: overflow" and rows[2]["remark"] == "IndexError: far out"


BROKEN = """
import warnings, pytest

@pytest.mark.stability("a quantity")
def test_quantity(row):
    row("good", 1, 2)
    row("bad", 2, 1)

@pytest.mark.stability("a warning")
def test_warning(row):
    row("good", 1, 2)
    warnings.warn("overflow")
"""


def test_a_test_that_fails_or_warns_has_a_wrong_row(tmp_path):
    path = tmp_path / "glove" / "test_broken.py"
    path.parent.mkdir()
    path.write_text(BROKEN)
    rows = command.rows_of_tests(("-c", "pyproject.toml", "-p", "tests.stability", "-p", "no:cacheprovider", str(path)))
    assert [(row["part"], row["check"], row["quantity"], row["verdict"]) for row in rows] == [
        ("glove", "a quantity", "good", RIGHT), ("glove", "a quantity", "bad", WRONG),
        ("glove", "a warning", "good", RIGHT), ("glove", "a warning", "an outcome", WRONG),
    ]  # fmt: skip


def test_tests_that_cannot_be_run_are_an_error():
    with pytest.raises(RuntimeError, match="pytest ended with 4"):
        command.rows_of_tests(("tests/nowhere.py",))


@pytest.fixture
def stability(tmp_path, monkeypatch):
    """Runs the command on the small classifier with other checks, and few of the tests."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "params.yaml").write_text((ROOT / "params.yaml").read_text())
    write_frames(tmp_path / "frames.h5", table())
    write_frames(tmp_path / "others.h5", replace(table(), classes=["a", "b", "c", "d"]))
    save_classifier(tmp_path / "classifier.pt", trained(), recipe().model, table())
    monkeypatch.setattr(command.rows_of_tests, "__defaults__", (("-m", "stability", "tests/test_params.py"),))

    def run(*own_checks, frames="frames.h5"):
        monkeypatch.setattr(command, "CHECKS", own_checks)
        changes = [word for change in (*SMALL, "precision=float32", "device=cpu") for word in ("--set", change)]
        files = ("--frames", frames, "--classifier", "classifier.pt", "--out", "out")
        return CliRunner().invoke(command.main, [*changes, *files])

    return run


def test_the_command_writes_one_table_of_tests_and_checks(stability, tmp_path):
    result = stability(holds)
    assert result.exit_code == 0, result.output
    rows = list(csv.DictReader((tmp_path / "out" / "results.csv").read_text().splitlines()))
    assert [row["check"] for row in rows] == ["batches of one", "batches of one", "holds"]
    assert "stability: 3 quantities of 2 checks: 1 right, 2 refused, 0 WRONG, in" in result.output
    assert "Simulated by the virtual glove" in (tmp_path / "out" / "results.md").read_text()
    result = stability(breaks)
    assert result.exit_code == 1
    assert "1 WRONG, see out/results.md: test_stability, breaks, an outcome" in result.output
    assert "| WRONG " in (tmp_path / "out" / "results.md").read_text()


def test_a_classifier_of_other_frames_is_refused(stability):
    result = stability(holds, frames="others.h5")
    assert result.exit_code == 1 and "of other classes or sensors than others.h5" in result.output
    result = stability(holds, frames="nowhere.h5")
    assert result.exit_code == 1 and "nowhere.h5: no such file" in result.output
