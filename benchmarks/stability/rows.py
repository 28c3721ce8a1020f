"""A row of the stability table and what its error is measured with.

A quantity is `right` when its error is no more than its tolerance, `refused` when the project says
in one line that it cannot do that. Otherwise its check fails, and no table is written.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

RIGHT, REFUSED = "right", "refused"


@dataclass(frozen=True)
class Quantity:
    """One quantity of a check."""

    name: str  # what is compared with what
    # see `max_rel_error` and `share_different`, or a count that should be 0; NaN holds for nothing
    error: float
    tolerance: float = 0.0  # the largest error that is right
    remark: str = ""  # what the number does not say
    refused: bool = False  # by the project, as it should

    @property
    def holds(self) -> bool:
        """Whether it is right or refused."""
        return self.refused or self.error <= self.tolerance

    def row(self, part: str, check: str, seconds: float, folder: Path) -> dict:
        """The row of the table; paths in the remark are relative to `folder` or to where one is."""
        return {
            "part": part,
            "check": check,
            "quantity": self.name,
            "error": "" if self.refused else float(self.error),
            "tolerance": "" if self.refused else float(self.tolerance),
            "seconds": seconds,
            "verdict": REFUSED if self.refused else RIGHT,
            "remark": self.remark.replace(f"{folder}/", "").replace(f"{Path.cwd()}/", ""),
        }


def max_rel_error(values: object, exact: object) -> float:
    """Largest difference of two arrays over the largest number of the exact one; absolute where that is all 0.

    Infinite where the shapes differ, or a number is not finite.
    """
    values, exact = (np.asarray(array, dtype=np.float64) for array in (values, exact))
    if values.shape != exact.shape or not (np.isfinite(values).all() and np.isfinite(exact).all()):
        return float("inf")
    if not values.size:
        return 0.0
    return float(np.abs(values - exact).max() / (np.abs(exact).max() or 1.0))


def share_different(values: object, expected: object) -> float:
    """Share of the entries in which two arrays differ; infinite where the shapes differ."""
    values, expected = np.asarray(values), np.asarray(expected)
    if values.shape != expected.shape:
        return float("inf")
    return float((values != expected).mean()) if values.size else 0.0


def share_not_finite(values: object) -> float:
    """Share of the numbers that are not finite."""
    return float((~np.isfinite(np.asarray(values, dtype=np.float64))).mean())
