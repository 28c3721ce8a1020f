"""Tables of studies and benchmarks, as CSV and as Markdown."""

import csv
from pathlib import Path

from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.params import Data

VIRTUAL = "data/virtual/recordings"  # the `data.source` that data/virtual/dvc.yaml makes
SIMULATED = "Simulated by the virtual glove"


def describe_data(data: Data) -> str:
    """Where the data come from, in the words that stand on a table or picture."""
    return SIMULATED if data.source == VIRTUAL else data.source


def write_table(folder: Path, rows: list[dict], text: str, name: str = "results") -> None:
    """`results.csv` of rows with the same keys, and `results.md` with a text above them; numbers at three digits."""
    write_csv(folder / f"{name}.csv", rows)
    with atomic_write(folder / f"{name}.md") as part:
        part.write_text(f"{text.strip()}\n\n{markdown(rows)}\n")


def write_csv(path: Path, rows: list[dict]) -> None:
    """Rows with the same keys."""
    with atomic_write(path) as part, part.open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def markdown(rows: list[dict]) -> str:
    """Rows with the same keys as a Markdown table, numbers at three digits."""
    lines = [list(rows[0]), ["---"] * len(rows[0]), *([_short(value) for value in row.values()] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
