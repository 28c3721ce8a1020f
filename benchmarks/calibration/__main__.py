"""How close the virtual glove comes to what is known of STAG's frames, on seeds that nothing was tuned on."""

import csv
import os
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np

from benchmarks.calibration.frame_statistics import Excess, all_statistics, load_map, read_excess
from benchmarks.calibration.picture import DRAWN, frames_on_hand
from benchmarks.command import Result, benchmark
from tactile_viewgcn.glove.objects import select_objects
from tactile_viewgcn.glove.recipe import VERSION, Recipe, recipe_from_params
from tactile_viewgcn.glove.writer import simulate
from tactile_viewgcn.params import Params

SEEDS = (2000, 2001, 2002)  # the constants were set on 1000 to 1003; the default data is of seed 0
SAMPLE = {"sessions": 1, "repeats": 4, "frames": 32, "grasps": 1}  # of the size of STAG's blindfolded set
#: Statistics of STAG's blindfolded and weights sets (Sundaram et al., Nature 569, 698-702 (2019)), from and to.
TARGETS = Path(__file__).with_name("targets.csv")


@benchmark
@click.option("--beside", type=click.Path(path_type=Path), multiple=True, help="A real source, for another column.")
def calibration(params: Params, quick: bool, beside: tuple[Path, ...]) -> Result:
    """Compare simulated frames with what is known of STAG's.

    Takes about two minutes on two cores; --quick is one seed, three objects and a coarse tolerance.
    """
    recipe, seeds = recipe_from_params(params.glove), SEEDS
    if quick:
        recipe, seeds = replace(recipe, objects=select_objects(list(DRAWN[:-1])), tolerance=0.2), SEEDS[:1]
    samples = [sample(replace(recipe, seed=seed, **SAMPLE)) for seed in seeds]
    real = {str(path): read_excess(path) for path in beside}
    text = f"Virtual glove version {VERSION}, seeds {', '.join(map(str, seeds))}: simulated data."
    for path, excess in real.items():
        text += f" Mean loads of the sensors correlate with those of {path} by {correlation(samples, excess):.2f}."
    rows = compare([all_statistics(one) for one in samples], {path: all_statistics(one) for path, one in real.items()})
    return text, rows, frames_on_hand(samples[0])


def sample(recipe: Recipe) -> Excess:
    """Simulated frames with the baseline subtracted."""
    with TemporaryDirectory() as folder:
        recordings = Path(folder, "recordings")
        simulate(recipe, recordings, workers=os.cpu_count() or 1)
        return read_excess(recordings)


def compare(simulated: list[dict[str, float]], real: dict[str, dict[str, float]]) -> list[dict]:
    """A row for each target: mean and range over the seeds, and how far the mean is outside of the target."""
    rows = []
    for name, *target in csv.reader(TARGETS.read_text().splitlines()[1:]):
        low, high = map(float, target)
        values = [statistics[name] for statistics in simulated]
        mean = float(np.mean(values))
        row = {"statistic": name, "STAG": f"{low:g}" if low == high else f"{low:g} to {high:g}", "simulated": mean}
        row |= {"lowest": min(values), "highest": max(values), "deviation": mean - float(np.clip(mean, low, high))}
        rows.append(row | {path: statistics[name] for path, statistics in real.items()})
    return rows


def correlation(samples: list[Excess], other: Excess) -> float:
    """Correlation of the sensors' mean loads with those of another source, mean over the samples."""
    loads = [load_map(excess)[other.sensors] for excess in (other, *samples)]
    return float(np.corrcoef(loads)[0, 1:].mean())


if __name__ == "__main__":
    calibration()
