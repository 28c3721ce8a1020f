"""The virtual glove beside STAG: what its frames look like, and how STAG's own network errs on them.

Published: error of STAG's network on `classification`, ten runs by a third party (geigerf/utils). It learns
from two recordings of each object; the frames are drawn at random from the third.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from joblib import Parallel, cpu_count, delayed

from benchmarks.command import Result, benchmark
from benchmarks.twin.statistics import STAG, frame_statistics
from tactile_viewgcn.device import Compute, select_device
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.glove.recipe import TRAINING_SESSIONS, recipe_from_params
from tactile_viewgcn.glove.simulation import simulate
from tactile_viewgcn.params import Params, load, preset_changes
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.tables.recordings import Recordings, write_recordings
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints

PUBLISHED = {1: 62.2, 2: 48.3, 4: 33.0, 8: 26.2}  # error in %, by number of frames
EPOCHS = {1: 4, 2: 4, 4: 3, 8: 2}  # by number of frames, at a third of STAG's size
TESTED = 1  # session of the test side, with a recording of every object
GRASP_FRAMES, STEADY = 20, 11  # of a grasp
FRAMES = {"third": 451, "stag": 1353}  # to train on, of each object
NETWORK, TREES = "error with {} frames, STAG's network, %", "error with {} frames, trees, %"


@click.option("--seed", "seeds", multiple=True, type=int, default=(101, 102, 103), show_default=True, help="Glove's.")
@click.option("--size", type=click.Choice(FRAMES), default="third", show_default=True, help="Of STAG's training side.")
@benchmark
def twin(params: Params, quick: bool, seeds: tuple[int, ...], size: str) -> Result:
    """Compare the virtual glove with STAG: error of STAG's network for 1, 2, 4 and 8 frames, and statistics of frames.

    --quick trains for one epoch on three objects of one glove.
    """
    frames, share = FRAMES[size], FRAMES["third"] / FRAMES[size]
    if quick:
        frames, share, seeds = 20, 0.0, seeds[:1]
        params = replace(params, glove=replace(params.glove, objects=["ball", "coin", "mug"]))
    with TemporaryDirectory() as folder:
        recordings = {seed: simulated(params, seed, frames, Path(folder, str(seed))) for seed in seeds}
        epochs = {k: max(1, round(share * count)) for k, count in EPOCHS.items()}
        tasks = [(seed, k) for k in sorted(PUBLISHED, reverse=True) for seed in seeds]  # the longest first
        cells = Parallel(n_jobs=cpu_count())(
            delayed(errors)(recordings[seed], params, seed, k, epochs[k]) for seed, k in tasks
        )
        columns: dict[int, dict[str, float]] = {seed: {} for seed in seeds}
        for (seed, _), cell in zip(tasks, cells, strict=True):
            columns[seed] |= cell
        for seed in seeds:
            columns[seed] |= frame_statistics(table_of(recordings[seed], params), stream(seed, "twin"))
    curve = {kind.format(k): f"{error}" for kind in (NETWORK, TREES) for k, error in PUBLISHED.items()}
    rows = []
    for name, stag in (curve | STAG).items():
        values = {f"glove seed {seed}": columns[seed][name] for seed in seeds}
        mean = float(np.mean(list(values.values())))
        difference = mean - float(stag) if name in curve else ""
        rows.append({"quantity": name, "STAG": stag} | values | {"mean": mean, "mean - STAG": difference})
    trained = ", ".join(f"{count} with {k}" for k, count in epochs.items())
    text = (
        f"STAG beside simulated recordings. {frames:,} training frames of each object from {TRAINING_SESSIONS} "
        f"recordings, {TESTED} recording of each object tested, frames drawn at random. Epochs by frames: {trained}; "
        "no noise is added in training. STAG's errors are of its own network, for trees too."
    )
    return text, rows, None


def simulated(params: Params, seed: int, frames: int, folder: Path) -> Path:
    """Folder of recordings of a glove of that seed with so many training frames of each object."""
    grasps = -(-frames // (TRAINING_SESSIONS * STEADY))
    sizes = {"seed": seed, "sessions": TRAINING_SESSIONS + TESTED, "grasps": grasps, "grasp_frames": GRASP_FRAMES}
    recipe = recipe_from_params(replace(params.glove, scale="small", **sizes))
    simulate(recipe, folder / "recordings", workers=cpu_count())
    write_recordings(folder / "table", open_source(folder / "recordings"), "")
    return folder


def table_of(folder: Path, params: Params) -> Frames:
    """Frames above the empty hand's, as the paper has them."""
    return preprocess_recordings(Recordings(folder / "table"), params.preprocess, params.split).frames


def errors(folder: Path, params: Params, seed: int, frames: int, epochs: int) -> dict[str, float]:
    """Errors in % of STAG's network and of trees, with so many frames of a recording."""
    table, compute = table_of(folder, params), select_device(params.device, params.precision)
    network = (*preset_changes("stag"), f"finetune.epochs={epochs}", "finetune.noise=0")
    trees = ("model.system=sensors", "model.members=[trees]", "pretrain.epochs=0")
    numbers = {
        NETWORK.format(frames): error_of(table, compute, f"views={frames}", *network),
        TREES.format(frames): error_of(table, compute, f"views={frames}", *trees),
    }
    click.echo(f"glove seed {seed}: " + ", ".join(f"{name} {error:.1f}" for name, error in numbers.items()), err=True)
    return numbers


def error_of(table: Frames, compute: Compute, *changes: str) -> float:
    """Error in % on test recordings, with frames drawn at random from each, of params.yaml with changes."""
    params = load("params.yaml", ("cluster.method=none", "evaluate.protocols=[recording]", *changes))
    views = cluster_frames(
        table, viewpoints(params.views, params.viewpoints, params.seed), params.cluster, stream(params.seed, "cluster")
    )
    backbone, classifier, _ = pretrain_backbone(table, params, compute)
    pretrained = {"backbone": backbone.state_dict(), "classifier": classifier.state_dict()}
    fitted = fit_classifier(table, views, pretrained, params, compute)
    evaluation = evaluate_table(
        fitted.classifier, table, params.cluster, params.evaluate, compute, params.seed, timed=False
    )
    return 100 * evaluation.metrics["recording"]["error"]["mean"]


if __name__ == "__main__":
    twin()
