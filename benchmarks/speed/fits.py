"""What `finetune` costs with the preset `best`, as recordings grow in number: choice, calibration, fit and file."""

import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import click
import numpy as np
import torch

from benchmarks.command import Result, benchmark
from benchmarks.speed.recordings import recordings_table
from tactile_viewgcn.device import Compute
from tactile_viewgcn.evaluation.evaluate import latency
from tactile_viewgcn.params import Params, load, preset_changes
from tactile_viewgcn.process import peak_mb, processor, usable_cores
from tactile_viewgcn.recognition.choice import choose_members
from tactile_viewgcn.recognition.fitting import fit_classifier
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.tables.views import Views
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.views.sampling import random_clusters
from tactile_viewgcn.views.viewpoints import viewpoints

COUNTS = ("150x50", "1000x50", "5000x50", "20000x50", "2000x1")
SIZES = [f"{count}x{side}" for side in (16, 32) for count in COUNTS]
TEXT = """# What the choice costs

`finetune` with the preset `best` on recordings x frames x sensors a side, made up, of 28 objects. {machine}, {threads}
of {cores} cores. Seconds: of each candidate's fits in the comparison, of its whole, of the calibration, of the last
fit, and of the file with its novelty; `processor` is that of all of them together. One answer of the classifier that
was taken is from eight frames, or from one where recordings have one."""


@partial(benchmark, folder=Path("benchmarks", "speed", "fits"))
@click.option("--size", "sizes", multiple=True, help="Recordings x frames x sensors a side, such as 150x50x16.")
def fits(params: Params, quick: bool, sizes: tuple[str, ...]) -> Result:
    """Time the parts of `finetune` with the preset `best`, each size in a process of its own, for its memory.

    --quick is the smallest size.
    """
    columns = {}
    for size in sizes or (SIZES[:1] if quick else SIZES):
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            columns[size] = pool.submit(costs, *map(int, size.split("x"))).result()
        click.echo(f"{size}: {columns[size]['together']:.1f} s", err=True)
    parts = dict.fromkeys(part for column in columns.values() for part in column)
    rows = [{"part": part} | {size: column.get(part) for size, column in columns.items()} for part in parts]
    about = {"machine": processor(), "threads": torch.get_num_threads(), "cores": usable_cores()}
    return TEXT.format(**about), rows, None


def costs(recordings: int, frames: int, side: int) -> dict[str, Any]:
    """Seconds by part, the taken candidate, peak memory and milliseconds an answer."""
    views = min(8, frames)
    params = load("params.yaml", [*preset_changes("best"), f"views={views}"])
    table, compute = recordings_table(recordings, frames, side), Compute(torch.device("cpu"), "float32")
    pool = np.zeros(len(table), dtype=np.int64)
    clusters = random_clusters(pool, views, np.random.default_rng(0))
    begin, on_processor = time.perf_counter(), time.process_time()
    members, notes = choose_members(table, views, params.model.candidates, params.seed)
    chosen = time.perf_counter()
    fixed = replace(params, model=replace(params.model, members=members))
    fitted = fit_classifier(table, Views(clusters, pool, viewpoints(views, params.viewpoints, 0)), {}, fixed, compute)
    ready = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        save_classifier(Path(folder) / "classifier.pt", fitted.classifier, fitted.model, table, "float32")
    end = time.perf_counter()
    inputs = FrameInputs(table, np.arange(views), compute, fitted.classifier.transform)
    values = [note.value for note in notes if note.topic == "candidates" and note.value]
    return {" + ".join(value["members"]): value["seconds"] for value in values} | {
        "choice": chosen - begin,
        "calibration": ready - chosen - fitted.progress.seconds,
        "fit": fitted.progress.seconds,
        "file": end - ready,
        "together": end - begin,
        "processor": time.process_time() - on_processor,
        "taken": " + ".join(members),
        "peak MB": peak_mb(),
        "ms an answer": latency(fitted.classifier, inputs, compute)["single"]["median"],
    }
