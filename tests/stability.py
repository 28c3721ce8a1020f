"""The stability table, whose rows come from tests.

A test with the marker `stability("name of the check")` takes the fixture `row`. The call
`row(quantity, error, tolerance)` asserts that the error is within the tolerance, and records a row
of the table. The call `row.refused(quantity, call, pattern)` asserts and records that a call is
refused. The fixture `subject` is the trained network of the checks. It is a small one, or with
`--table` the one that the last `dvc repro` trained.
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
    """Asserts and records the quantities of a check.

    Attributes:
        part: part of the project.
        check: name of the check.
        folder: folder of the test's files.
        recorded: rows of the table, to which the check's are added.
        begin: time in seconds at which the last quantity was recorded.
    """

    def __init__(self, part: str, check: str, folder: Path, recorded: list[dict]):
        self.part = part
        self.check = check
        self.folder = folder
        self.recorded = recorded
        self.begin = time.perf_counter()

    def __call__(
        self, quantity: str, error: float, tolerance: float = 0.0, remark: str = ""
    ) -> None:
        """Assert that the error is no more than the tolerance."""
        self.record(Quantity(quantity, error, tolerance, remark))

    def refused(self, quantity: str, call: Callable[[], object], pattern: str) -> None:
        """Assert that the call raises a ValueError with one line that contains the pattern."""
        self.record(refusal(quantity, call, pattern))

    def record(self, quantity: Quantity) -> None:
        """Assert that the quantity holds, and add its row."""
        now = time.perf_counter()
        assert quantity.holds, (
            f"{quantity.name}: {quantity.error} > {quantity.tolerance} {quantity.remark}"
        )
        self.recorded.append(quantity.row(self.part, self.check, now - self.begin, self.folder))
        self.begin = now


def refusal(name: str, call: Callable[[], object], pattern: str) -> Quantity:
    """Return whether a call raises a ValueError with one line that contains the pattern."""
    try:
        call()
    except ValueError as error:
        message = str(error)
        refused = "\n" not in message and bool(re.search(pattern, message))
        return Quantity(name, np.nan, np.nan, message, refused)
    return Quantity(name, np.nan, np.nan, "was not refused")


@pytest.fixture
def row(request: pytest.FixtureRequest, tmp_path: Path) -> Rows:
    """Return the rows of the check that the test's marker names.

    The part is named by the test's folder, or by the test's file if the file is in tests/ itself.
    """
    path = request.path
    part = path.parent.name
    if path.parent == TESTS:
        part = path.stem.removeprefix("test_")
    check = request.node.get_closest_marker("stability").args[0]
    recorded = request.config.stash.setdefault(ROWS, [])
    return Rows(part, check, tmp_path, recorded)


@pytest.fixture(scope="session")
def subject(request: pytest.FixtureRequest) -> "Subject":
    """Return the trained network of the checks and its frames."""
    # imported late, since these load torch
    from benchmarks.trained import CLASSIFIER, FRAMES, read_trained
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
    """Add the option --table."""
    text = "Write the stability table into this folder, and check the network that the last "
    text += "`dvc repro` trained."
    parser.addoption("--table", type=Path, help=text)


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    """Print the rows if `-m` names `stability`.

    If there is a folder --table and no check failed, the table is written into it.
    """
    rows = config.stash.get(ROWS, [])
    verdicts = Counter(row["verdict"] for row in rows)
    checks = {(row["part"], row["check"]) for row in rows}
    total = f"{len(rows)} quantities of {len(checks)} checks: "
    total += f"{verdicts[RIGHT]} {RIGHT}, {verdicts[REFUSED]} {REFUSED}."
    folder = config.getoption("--table")
    if folder and not {"failed", "error"} & terminalreporter.stats.keys():
        from benchmarks.command import write_table

        write_table(folder, rows, f"{ABOUT}\n{total}")
    if "stability" in config.getoption("markexpr"):
        terminalreporter.section("stability")
        for row in rows:
            result = row["remark"]
            if row["error"] != "":
                result = f"{row['error']:.2g} <= {row['tolerance']:.2g}"
            terminalreporter.line(
                f"{row['part']}, {row['check']}, {row['quantity']}: {row['verdict']}, {result}"
            )
        terminalreporter.line(total)
