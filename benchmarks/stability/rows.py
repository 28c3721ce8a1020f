"""A row of the stability table, and the measures of its error.

A quantity is `right` if its error is no larger than its tolerance. It is `refused` if the project
says in one line that it cannot compute the quantity. Otherwise the check fails, and no table is
written.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

RIGHT = "right"
REFUSED = "refused"


@dataclass(frozen=True)
class Quantity:
    """One quantity of a check.

    Attributes:
        name: name that says which two things are compared.
        error: error as in `max_rel_error` or `share_different`, or a count that should be 0. NaN is
            never right.
        tolerance: largest error that is right.
        remark: anything that the number does not say.
        refused: whether the project refused to compute it, as it should.
    """

    name: str
    error: float
    tolerance: float = 0.0
    remark: str = ""
    refused: bool = False

    @property
    def holds(self) -> bool:
        """Whether the quantity is right or refused."""
        return self.refused or self.error <= self.tolerance

    def row(self, part: str, check: str, seconds: float, folder: Path) -> dict[str, Any]:
        """Return the quantity's row of the table.

        Args:
            part: part of the project.
            check: name of the check.
            seconds: run time of the check.
            folder: folder that paths in the remark become relative to, as they do to the working
                folder.
        """
        row: dict[str, Any] = {"part": part, "check": check, "quantity": self.name}
        if self.refused:
            row |= {"error": "", "tolerance": "", "seconds": seconds, "verdict": REFUSED}
        else:
            row |= {
                "error": float(self.error),
                "tolerance": float(self.tolerance),
                "seconds": seconds,
                "verdict": RIGHT,
            }
        row["remark"] = self.remark.replace(f"{folder}/", "").replace(f"{Path.cwd()}/", "")
        return row


def max_rel_error(values: object, exact: object) -> float:
    """Return the largest difference of two arrays over the largest number of the exact one.

    If the exact array is all 0, the difference itself is returned. If the shapes differ or a number
    is not finite, the result is infinite.

    Args:
        values: computed numbers.
        exact: exact numbers.
    """
    computed = np.asarray(values, dtype=np.float64)
    expected = np.asarray(exact, dtype=np.float64)
    if computed.shape != expected.shape:
        return float("inf")
    if not (np.isfinite(computed).all() and np.isfinite(expected).all()):
        return float("inf")
    if not computed.size:
        return 0.0
    largest = np.abs(expected).max()
    return float(np.abs(computed - expected).max() / (largest or 1.0))


def share_different(values: object, expected: object) -> float:
    """Return the share of the entries in which two arrays differ; infinite if the shapes differ.

    Args:
        values: computed entries.
        expected: expected entries.
    """
    computed = np.asarray(values)
    exact = np.asarray(expected)
    if computed.shape != exact.shape:
        return float("inf")
    if not computed.size:
        return 0.0
    return float((computed != exact).mean())


def share_not_finite(values: object) -> float:
    """Return the share of the numbers that are not finite."""
    return float((~np.isfinite(np.asarray(values, dtype=np.float64))).mean())
