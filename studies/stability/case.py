"""What a case is: something stiff or extreme, done with the pipeline's own functions, against a reference.

A case is a function of a `Subject` that yields a `Finding` for every quantity it looks at; its name and its module are
what the table calls it. `run` times it and gives the verdicts: `right`, `refused`, where the project says in one line
that it cannot do that, and `WRONG`. A warning or any other exception in a case is WRONG too.
"""

import re
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from tqdm import tqdm

from tactile_viewgcn.classifier import Classifier
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.frames import Frames

RIGHT, REFUSED, WRONG = "right", "refused", "WRONG"


@dataclass(frozen=True)
class Subject:
    """What the cases are run on.

    Attributes:
        classifier: trained, in evaluation mode and float32; a case that changes it takes a copy.
        table: the frames it was trained and is tested on.
        params: what the stage is given of params.yaml.
        compute: the device, and the precision of the pipeline's own evaluation.
        folder: an empty one, for files that cases write.
    """

    classifier: Classifier
    table: Frames
    params: SimpleNamespace
    compute: Compute
    folder: Path


@dataclass(frozen=True)
class Finding:
    """One quantity of a case: how far it is from its reference, and what is still right.

    Attributes:
        quantity: what is compared with what.
        error: see `apart` and `differing`; a measure that is to stay below its tolerance. Not a number is wrong.
        tolerance: the largest error that is right.
        remark: what the number does not say.
        refused: the project refused, as it should.
    """

    quantity: str
    error: float
    tolerance: float
    remark: str = ""
    refused: bool = False

    @property
    def verdict(self) -> str:
        if self.refused:
            return REFUSED
        return RIGHT if self.error <= self.tolerance else WRONG


Case = Callable[[Subject], Iterator[Finding]]


def apart(found: object, exact: object) -> float:
    """Largest difference of two arrays, over the largest number of the exact one, or absolute where that is all 0.

    Infinite where a shape is another, or a number is not finite.
    """
    found, exact = (np.asarray(values, dtype=np.float64) for values in (found, exact))
    if found.shape != exact.shape or not (np.isfinite(found).all() and np.isfinite(exact).all()):
        return float("inf")
    if not found.size:
        return 0.0
    return float(np.abs(found - exact).max() / (np.abs(exact).max() or 1.0))


def differing(found: object, expected: object) -> float:
    """Share of the entries in which two arrays differ; infinite where a shape is another."""
    found, expected = np.asarray(found), np.asarray(expected)
    if found.shape != expected.shape:
        return float("inf")
    return float((found != expected).mean()) if found.size else 0.0


def finite(values: object) -> float:
    """0 where all numbers are finite, else the share of those that are not."""
    return float((~np.isfinite(np.asarray(values, dtype=np.float64))).mean())


def refusal(what: str, call: Callable[[], object], pattern: str) -> Finding:
    """That a call ends in a ValueError of one line that the pattern is found in; WRONG where it does not."""
    try:
        call()
    except ValueError as error:
        said = str(error)
        return Finding(what, np.nan, np.nan, said, refused="\n" not in said and bool(re.search(pattern, said)))
    return Finding(what, np.nan, np.nan, "was not refused")


def run(cases: Iterable[Case], subject: Subject) -> list[dict]:
    """A row of the table for every quantity of every case; `seconds` are those that it took."""
    rows = []
    for case in tqdm(list(cases), desc="stability", unit="case", disable=None):
        named = {"part": case.__module__.rpartition(".")[2], "case": case.__name__.replace("_", " ")}
        begin = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                for found in case(subject):
                    rows.append(named | _row(found, time.perf_counter() - begin, subject.folder))
                    begin = time.perf_counter()
        except Exception as error:
            lost = Finding("an outcome", np.nan, 0.0, f"{type(error).__name__}: {' '.join(str(error).split())}")
            rows.append(named | _row(lost, time.perf_counter() - begin, subject.folder))
    return rows


def _row(found: Finding, seconds: float, folder: Path) -> dict:
    return {
        "quantity": found.quantity,
        "error": "" if found.refused else found.error,
        "tolerance": "" if found.refused else found.tolerance,
        "seconds": seconds,
        "verdict": found.verdict,
        "remark": found.remark.replace(f"{folder}/", "").replace(f"{Path.cwd()}/", ""),
    }
