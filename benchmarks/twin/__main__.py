"""The virtual glove beside STAG: what its frames look like, and how STAG's own network errs on them.

Published: error of STAG's network on `classification`, ten runs by a third party (geigerf/utils). It learns
from two recordings of each object; the frames are drawn at random from the third.
"""

import os
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np

from benchmarks.command import Result, benchmark
from benchmarks.twin.statistics import STAG, frame_statistics
from tactile_viewgcn.device import Compute, select_device
from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.glove.recipe import TRAINING_SESSIONS, recipe_from_params
from tactile_viewgcn.glove.writer import simulate
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
TESTED = 4  # sessions of the test side, each with a recording of every object
GRASP_FRAMES, STEADY = 8, 5  # of a grasp
FRAMES = {"third": 451, "stag": 1353}  # to train on, of each object


@click.option("--seed", "seeds", multiple=True, type=int, default=(101, 102, 103), show_default=True, help="Glove's.")
@click.option("--size", type=click.Choice(FRAMES), default="third", show_default=True, help="Of STAG's training side.")
@click.option("--epochs", default=30, show_default=True, help="With one frame; with k frames a k-th of them.")
@benchmark
def twin(params: Params, quick: bool, seeds: tuple[int, ...], size: str, epochs: int) -> Result:
    """Compare the virtual glove with STAG: error of STAG's network for 1, 2, 4 and 8 frames, and statistics of frames.

    --quick trains for one epoch on three objects of one glove.
    """
    frames = FRAMES[size]
    if quick:
        frames, epochs, seeds = 20, 1, seeds[:1]
        params = replace(params, glove=replace(params.glove, objects=["ball", "coin", "mug"]))
    columns = {f"simulated, glove seed {seed}": measure(params, seed, frames, epochs) for seed in seeds}
    published = {f"error with {k} frames, STAG's network, %": f"{error}" for k, error in PUBLISHED.items()} | STAG
    rows = []
    for name in next(iter(columns.values())):
        values = {column: numbers[name] for column, numbers in columns.items()}
        mean = float(np.mean(list(values.values())))
        rows.append({"quantity": name, "STAG": published.get(name, "")} | values | {"simulated, mean": mean})
    text = (
        f"STAG's files beside simulated ones of the virtual glove: {frames} training frames of each object from "
        f"{TRAINING_SESSIONS} recordings, {TESTED} recordings of each object tested; {epochs} epochs with one frame."
    )
    return text, rows, None


def measure(params: Params, seed: int, frames: int, epochs: int) -> dict[str, float]:
    """Errors in % and frame statistics of a glove of that seed, with so many training frames of each object."""
    grasps = -(-frames // (TRAINING_SESSIONS * STEADY))
    sizes = {"seed": seed, "sessions": TRAINING_SESSIONS + TESTED, "grasps": grasps, "grasp_frames": GRASP_FRAMES}
    recipe = recipe_from_params(replace(params.glove, scale="small", **sizes))
    compute = select_device(params.device, params.precision)
    with TemporaryDirectory() as folder:
        simulate(recipe, Path(folder, "recordings"), workers=os.cpu_count() or 1)
        write_recordings(Path(folder, "table"), open_source(Path(folder, "recordings")), "")
        table = preprocess_recordings(Recordings(Path(folder, "table")), params.preprocess, params.split).frames
        network = {
            f"error with {k} frames, STAG's network, %": error_of(
                table, compute, *preset_changes("stag"), f"views={k}", f"finetune.epochs={max(1, epochs // k)}"
            )
            for k in PUBLISHED
        }
        trees = {
            f"error with {k} frames, trees, %": error_of(table, compute, "model.system=trees", f"views={k}")
            for k in PUBLISHED
        }
        return network | trees | frame_statistics(table, stream(seed, "twin"))


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
    return 100 * evaluation.scores["recording"]["error"]["mean"]


if __name__ == "__main__":
    twin()
