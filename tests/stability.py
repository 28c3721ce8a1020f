"""Rows of the stability table from tests: the fixture `row`, and where the rows are printed and
written.

A test with the marker `stability("name of the check")` takes the fixture `row`: `row(quantity,
error, tolerance)` asserts error <= tolerance and records the row, `row.refused(quantity, call,
pattern)` that a call is refused. The fixture `subject` is the trained network of the checks: a
small one, or with `--table` that of the last `dvc repro`.
"""

import re
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.stability.rows import REFUSED, RIGHT, Quantity

if TYPE_CHECKING:
    from tests.trained_network import Subject

TESTS = Path(__file__).parent
ROWS = pytest.StashKey[list[dict]]()
ABOUT = (
    "`error` is the largest difference from a reference in double precision, or an exact one, "
    "relative to the\n"
    "largest number there, unless its quantity says what is counted. A row is `right` with an "
    "error of no more than its\n"
    "tolerance, and `refused` where the project says in one line that it does not do that."
)


class Rows:
    """Records the quantities of a check of a part in `recorded`, and asserts each."""

    def __init__(self, part: str, check: str, folder: Path, recorded: list[dict]):
        self.part, self.check, self.folder, self.recorded = part, check, folder, recorded
        self.begin = time.perf_counter()

    def __call__(
        self, quantity: str, error: float, tolerance: float = 0.0, remark: str = ""
    ) -> None:
        """Assert that the error is no more than the tolerance."""
        self.record(Quantity(quantity, error, tolerance, remark))

    def refused(self, quantity: str, call: Callable[[], object], pattern: str) -> None:
        """Assert that the call ends in a ValueError of one line that contains the pattern."""
        self.record(refusal(quantity, call, pattern))

    def record(self, quantity: Quantity) -> None:
        now = time.perf_counter()
        assert quantity.holds, (
            f"{quantity.name}: {quantity.error} > {quantity.tolerance} {quantity.remark}"
        )
        self.recorded.append(quantity.row(self.part, self.check, now - self.begin, self.folder))
        self.begin = now


def refusal(name: str, call: Callable[[], object], pattern: str) -> Quantity:
    """That a call ends in a ValueError of one line that contains the pattern."""
    try:
        call()
    except ValueError as error:
        message = str(error)
        refused = "\n" not in message and bool(re.search(pattern, message))
        return Quantity(name, np.nan, np.nan, message, refused)
    return Quantity(name, np.nan, np.nan, "was not refused")


@pytest.fixture
def row(request: pytest.FixtureRequest, tmp_path: Path) -> Rows:
    """Rows of the check that the test's marker names, of the part that is the test's folder, or its
    name in tests/.
    """
    recorded = request.config.stash.setdefault(ROWS, [])
    path, check = request.path, request.node.get_closest_marker("stability").args[0]
    part = path.stem.removeprefix("test_") if path.parent == TESTS else path.parent.name
    return Rows(part, check, tmp_path, recorded)


@pytest.fixture(scope="session")
def subject(request: pytest.FixtureRequest) -> "Subject":
    """The trained network of the checks and its frames."""
    from benchmarks.trained import CLASSIFIER, FRAMES, read_trained  # here, for these load torch
    from tactile_viewgcn.device import select_device
    from tactile_viewgcn.params import load
    from tests import glove_data
    from tests.trained_network import Subject

    if not request.config.getoption("--table"):
        return Subject(
            glove_data.trained(), glove_data.table(), glove_data.recipe(), glove_data.CPU
        )
    params = load("params.yaml")
    compute = select_device(params.device, params.precision)
    return Subject(*read_trained(FRAMES, CLASSIFIER, params), compute)


def pytest_addoption(parser: pytest.Parser) -> None:
    words = "Write the stability table into this folder, and check the network that the last "
    words += "`dvc repro` trained."
    parser.addoption("--table", type=Path, help=words)


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print the rows where -m asks for `stability`, and write them into the folder --table if all
    checks hold.
    """
    rows, folder = config.stash.get(ROWS, []), config.getoption("--table")
    counts, checks = (
        Counter(one["verdict"] for one in rows),
        {(one["part"], one["check"]) for one in rows},
    )
    total = f"{len(rows)} quantities of {len(checks)} checks: "
    total += f"{counts[RIGHT]} {RIGHT}, {counts[REFUSED]} {REFUSED}."
    if folder and not {"failed", "error"} & terminalreporter.stats.keys():
        from benchmarks.command import write_table

        write_table(folder, rows, f"{ABOUT}\n{total}")
    if "stability" in config.getoption("markexpr"):
        terminalreporter.section("stability")
        for one in rows:
            numbers = (
                f"{one['error']:.2g} <= {one['tolerance']:.2g}"
                if one["error"] != ""
                else one["remark"]
            )
            terminalreporter.line(
                f"{one['part']}, {one['check']}, {one['quantity']}: {one['verdict']}, {numbers}"
            )
        terminalreporter.line(total)
