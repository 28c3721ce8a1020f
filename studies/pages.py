"""Figures and blocks of README.md and the manual, written anew from the results files."""

from pathlib import Path

import pandas as pd

from studies.findings import METHODS
from studies.forest import forest_plot
from studies.grid import FOLDER
from studies.pictures import learning_curve
from tactile_viewgcn.messages import UserError

PAGES = ("README.md", "docs/results.md", "docs/methods.md", "docs/pipeline.md")
FOREST = Path("docs/claims.png")
CURVE = Path("docs/learning_curve.png")
CURVE_STUDY = "data_size_one_world"
CURVES = ("preset network", "preset kernels", "paper")


def write_pages() -> None:
    """Write the figures and the blocks of Cog in `PAGES`.

    Raises:
        UserError: Cog is not installed, or a block needs a result that is missing.
    """
    forest_plot().savefig(FOREST, dpi=110)
    rows = pd.read_csv(FOLDER / CURVE_STUDY / "results.csv")
    labels = {name: METHODS[name].replace("`", "") for name in CURVES}
    learning_curve(rows, labels).savefig(CURVE, dpi=110)
    run_cog("-r", *PAGES)


def run_cog(*options: str) -> int:
    """Run Cog in this process, and return its exit status: 5 if `--check` finds an old block.

    Raises:
        UserError: Cog is not installed.
    """
    try:
        from cogapp import Cog
    except ImportError:
        raise UserError("--pages needs Cog: pip install -e '.[test]'") from None
    status: int = Cog().main(["cog", "-P", *options])  # blocks print
    return status
