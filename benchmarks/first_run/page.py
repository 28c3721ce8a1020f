"""What README.md and docs/pipeline.md say of a first run, from results.csv."""

from pathlib import Path
from textwrap import fill

import pandas as pd

from benchmarks.command import markdown
from benchmarks.first_run.__main__ import ERRORS

FOLDER = Path(__file__).parent
WIDTH = 120  # of a line in the pages


def seconds_sentence() -> str:
    """Return two sentences with the seconds of the installation and of the runs."""
    rows = pd.read_csv(FOLDER / "results.csv")
    (installation,) = rows[rows["step"] == "installation"].to_dict("records")
    one, two = _runs()["seconds"]
    return fill(
        f"On {installation['machine']} the installation took "
        f"{installation['seconds']:.0f} seconds. The first run took {two:.0f} seconds "
        f"with two threads, and {one:.0f} with one.",
        WIDTH,
    )


def threads_table() -> str:
    """Return the errors by number of threads, as Markdown."""
    rows = []
    for run in _runs().to_dict("records"):
        errors = {f"`{name}`": f"{run[name]:.1f}" for name in ERRORS}
        rows.append({"threads": int(run["threads"])} | errors)
    return markdown(rows)


def _runs() -> pd.DataFrame:
    """Return the rows of `dvc repro`, by rising number of threads."""
    rows = pd.read_csv(FOLDER / "results.csv")
    return rows[rows["step"] == "dvc repro"].sort_values("threads")
