"""What the choice of preset `best` costs: its error minus that of the candidate that is lowest on that test side."""

import time
from dataclasses import replace
from itertools import product
from pathlib import Path

import click
import pandas as pd

from benchmarks.choice import data_sets
from benchmarks.choice.regret import candidate_rows, measure, regret_rows
from benchmarks.command import Result, benchmark, markdown
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import Params

FOLD = ["data set", "train groups", "deal", "fold"]
TEXT = """# Regret of the choice

Every candidate is fitted to the training side and answers view sets of each test recording; the choice is made on the
training side alone. Regret: the error of what it took minus that of the candidate that is lowest on that test side.
Hindsight: the same of one candidate in all folds, the best of them. Intervals are Student's over deals of the folds, in
the last row over data sets. Training groups an object: {groups}. blindfolded_lite and weights_lite are
STAG's (Sundaram et al. 2019), digits are scikit-learn's, the others are simulated or drawn.

{regret}

Each candidate:"""


@benchmark
@click.option("--data", "names", multiple=True, help="A data set, as often as wanted.  [default: all]")
@click.option("--deals", default=5, show_default=True, help="Shuffles of the groups to the folds, from 1.")
@click.option("--folds", type=click.Choice(["one", "all"]), default="one", show_default=True, help="Of each deal.")
@click.option("--train-groups", type=click.IntRange(1), help="Training groups an object, at most.  [default: all]")
@click.option("--minutes", default=60.0, show_default=True, help="After them no further fold is begun.")
@click.option("--kept", type=click.Path(path_type=Path), default="data/choice", show_default=True)
def choice(
    params: Params,
    quick: bool,
    names: tuple[str, ...],
    deals: int,
    folds: str,
    train_groups: int | None,
    minutes: float,
    kept: Path,
) -> Result:
    """Measure the regret on each data set and deal of the folds, deal by deal.

    What is finished stays in fits.csv of the folder --kept, beside simulated recordings, and is not measured again:
    delete the folder after a change of code or params.yaml. --quick is one deal of the two quickest data sets.
    """
    known, begin, groups = data_sets.names(), time.monotonic(), train_groups or "all"
    if unknown := sorted(set(names) - set(known)):
        raise UserError(f"--data is {unknown[0]}; expected {' | '.join(known)}")
    names, deals = (known[:2], 1) if quick else (names or known, deals)
    kept.mkdir(parents=True, exist_ok=True)
    path = kept / "fits.csv"
    done = set(pd.read_csv(path, dtype=str)[FOLD].itertuples(index=False, name=None)) if path.exists() else set()
    for deal, name in product(range(1, deals + 1), names):
        by, count = data_sets.SPLIT.get(name, data_sets.BY_RECORDING)
        for fold in range(count if folds == "all" else 1):
            cell = (name, str(groups), str(deal), str(fold))
            if cell in done or time.monotonic() - begin > 60 * minutes:
                continue
            click.echo(f"{name}, deal {deal}, fold {fold}", err=True)
            split = replace(params.split, by=by, folds=count, fold=fold, deal=deal, train_groups=groups)
            table = preprocess_recordings(data_sets.read(name, params, kept), params.preprocess, split).frames
            views = 1 if name in data_sets.SINGLE else params.views
            rows = measure(table, views, params.model.candidates, params.seed)
            of_fold = pd.DataFrame([dict(zip(FOLD, cell, strict=True)) | row for row in rows])
            of_fold.to_csv(path, mode="a", header=not path.exists(), index=False)
    fits = pd.read_csv(path, dtype={"train groups": str})
    fits = fits[(fits["train groups"] == str(groups)) & fits["data set"].isin(names)]
    return TEXT.format(groups=groups, regret=markdown(regret_rows(fits))), candidate_rows(fits), None


if __name__ == "__main__":
    choice()
