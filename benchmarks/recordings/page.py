"""The table of docs/methods.md: errors on public recordings, from results.csv and sets.csv."""

from pathlib import Path

import pandas as pd

from benchmarks.command import markdown
from benchmarks.recordings.__main__ import ERROR, OURS, SIMPLE
from tactile_viewgcn.messages import UserError

FOLDER = Path(__file__).parent


def recordings_table() -> str:
    """Return the table as Markdown: a row for each set, the largest gain first."""
    rows = []
    for row in _errors().sort_values("more").itertuples():
        rows.append(
            {
                "recordings of": row.content,
                "source": _link(row.source),
                "sensors, recordings, objects": f"{row.channels}, {row.recordings}, {row.classes}",
                "held out": row.held_out,
                "`best`": f"{row.ours:.1f}",
                "lowest of three": f"{row.simple:.1f}",
            }
        )
    return markdown(rows)


def summary_sentence() -> str:
    """Return a sentence with the number of sets and how often `best` has the lower error.

    A set that is read again in another way (column `again` of sets.csv) is counted once.
    """
    errors = _errors()
    errors = errors[errors["again"].isna()]
    lower = int((errors["more"] < 0).sum())
    higher = int((errors["more"] > 0).sum())
    equal = len(errors) - lower - higher
    return (
        f"Of {len(errors)} sets, `best` has the lower error on {lower}, the same on {equal} and "
        f"the higher one on {higher}. The mean errors are {errors['ours'].mean():.1f} and "
        f"{errors['simple'].mean():.1f} %."
    )


def _errors() -> pd.DataFrame:
    """Return sets.csv with the errors in %: ours, simple (the lowest of three), and more."""
    errors = pd.read_csv(FOLDER / "results.csv", index_col="set")
    sets = pd.read_csv(FOLDER / "sets.csv", index_col="set")
    if set(sets.index) != set(errors.index):
        raise UserError(f"{FOLDER}: sets.csv and results.csv name different sets")
    table = sets.join(errors, validate="one_to_one")
    table["ours"] = table[ERROR.format(OURS)]
    table["simple"] = table[[ERROR.format(name) for name in SIMPLE]].min(axis=1)
    table["more"] = table["ours"] - table["simple"]
    return table


def _link(source: str) -> str:
    """Return a link to a repository OWNER/NAME, or the name of a package as it is."""
    if "/" not in source:
        return source
    return f"[{source.partition('/')[2]}](https://github.com/{source})"
