"""What README.md and docs/pipeline.md say of a first run, from results.csv."""

from pathlib import Path

import pandas as pd

from benchmarks.command import markdown
from benchmarks.first_run.__main__ import ERRORS

FOLDER = Path(__file__).parent


def seconds_sentence() -> str:
    """Return a sentence with the seconds of the installation and of the runs."""
    rows = pd.read_csv(FOLDER / "results.csv")
    (installation,) = rows[rows["step"] == "installation"]["seconds"]
    one, two = _runs()["seconds"]
    return (
        f"The installation took {installation:.0f} seconds, the first run {two:.0f} seconds with "
        f"two threads and {one:.0f} with one."
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
