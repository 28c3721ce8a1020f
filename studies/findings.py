"""What README.md and docs/results.md say of the studies, from their results files.

The pages call these functions in blocks of Cog. `python -m studies --pages` writes the blocks and the
figures anew, and a test says whether a block is out of date.
"""

from pathlib import Path

import pandas as pd

from studies.comparison import FEW_SEEDS, HIGHER, LOWER, ONE_WORLD, OPEN, UNTRAINED
from studies.grid import FOLDER
from tactile_viewgcn.evaluation.trials import TITLES
from tactile_viewgcn.messages import UserError

VERDICTS = (HIGHER, LOWER, OPEN, FEW_SEEDS, ONE_WORLD, UNTRAINED)


def row(study: str, variant: str, protocol: str) -> "pd.Series[float]":
    """Return the row of a variant in the results file of a study.

    Args:
        study: name of the folder in studies/.
        variant: its name there.
        protocol: a key of `trials.TITLES`.

    Raises:
        UserError: there is no such file or row.
    """
    path = FOLDER / study / "results.csv"
    if not path.exists():
        raise UserError(f"{path}: no such file; expected the results of a study")
    rows = pd.read_csv(path, keep_default_na=True)
    found = rows[(rows["variant"] == variant) & (rows["protocol"] == TITLES[protocol])]
    if found.empty:
        raise UserError(f"{path}: no row {variant!r}, {TITLES[protocol]!r}")
    return found.iloc[0]


def has(study: str, variant: str, protocol: str) -> bool:
    """Return whether a study's results file has the row, see `row`."""
    try:
        row(study, variant, protocol)
    except UserError:
        return False
    return True


def error(study: str, variant: str, protocol: str) -> str:
    """Return an error with its interval over recordings, as in `17.8 (15.8 to 19.8)`."""
    found = row(study, variant, protocol)
    return f"{found['error']:.1f} ({found['low']:.1f} to {found['high']:.1f})"


def difference(study: str, variant: str, reference: str, protocol: str) -> str:
    """Return a paired difference with both intervals, as in `8.6 (6.8 to 10.7; 3.5 to 13.8)`.

    The second interval, over seeds, is left out where there is none.
    """
    found = row(study, variant, protocol)
    head = f"vs {reference} "
    intervals = [f"{found[f'{head}low']:.1f} to {found[f'{head}high']:.1f}"]
    if pd.notna(found[f"{head}seeds_low"]):
        intervals.append(f"{found[f'{head}seeds_low']:.1f} to {found[f'{head}seeds_high']:.1f}")
    return f"{found[f'{head}more']:.1f} ({'; '.join(intervals)})"


def verdict_of(study: str, variant: str, reference: str, protocol: str) -> str:
    """Return the verdict of a paired difference, see `comparison.verdict`."""
    return str(row(study, variant, protocol)[f"vs {reference} verdict"])


def markdown(rows: list[dict[str, str]]) -> str:
    """Return a table of Markdown, a row for each dictionary, without padding."""
    names = list(rows[0])
    lines = [names, ["---"] * len(names), *(list(one.values()) for one in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
