"""What a scene does not need, and so does not pay for: nodes, libraries, contacts.

Libraries are looked for in a process of its own, since this one has them all; what is counted should be 0.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from studies.stability import lean
from studies.stability.case import Finding, Subject
from studies.stability.glove_scenes import DEFAULT
from studies.stability.graph import view_gcn, width
from studies.stability.learning import few_anchors
from tactile_viewgcn.classifier import save_classifier
from tactile_viewgcn.frames import write_frames
from tactile_viewgcn.glove.objects import THINGS
from tactile_viewgcn.glove.simulation import EFFECTS, Recipe, Simulation
from tactile_viewgcn.nn.view_gcn import LocalGraphConvolution, NonLocalMessagePassing, SelectiveViewSampling
from tactile_viewgcn.viewpoints import viewpoints

ROOT = Path(__file__).parents[2]
LAYERS = LocalGraphConvolution | NonLocalMessagePassing | SelectiveViewSampling
ROUNDS, SETS = 5, 64


def a_graph_of_one_view(subject: Subject) -> Iterator[Finding]:
    """The network for one view has no layers of a graph; what it saves against eight."""
    heads = {views: view_gcn(subject, torch.from_numpy(viewpoints(views))) for views in (1, 8)}
    seconds = {views: [] for views in heads}
    for _ in range(1 + ROUNDS):
        for views, head in heads.items():
            nodes = torch.rand(SETS, views, width(head))
            begin = time.perf_counter()
            with torch.inference_mode():
                head(nodes)
            seconds[views].append(time.perf_counter() - begin)
    one, eight = (1e3 * float(np.median(values[1:])) / SETS for values in seconds.values())
    layers = sum(isinstance(layer, LAYERS) for layer in heads[1].modules())
    yield Finding("layers of a graph", layers, 0, f"{one:.2g} ms a view set against {eight:.2g} of eight views")


def libraries(subject: Subject) -> Iterator[Finding]:
    """An unclustered run without scikit-learn, one without tracking without MLflow, `--help` without torch."""
    write_frames(subject.folder / "frames.h5", few_anchors(subject.table))
    save_classifier(subject.folder / "classifier.pt", subject.classifier, subject.params.model, subject.table)
    found, seconds = _imported("unclustered", str(subject.folder), str(subject.classifier.views))
    yield Finding("scikit-learn in an unclustered run", float("sklearn" in found), 0, f"the run took {seconds:.1f} s")
    yield Finding("MLflow in a run with tracking disabled", float("mlflow" in found), 0)
    found, seconds = _imported("help")
    yield Finding("torch, SciPy, scikit-learn or MLflow in --help", float(len(found)), 0, f"it took {seconds:.1f} s")


def a_hand_without_an_object(_: Subject) -> Iterator[Finding]:
    """A recording of the empty hand in a glove that does not feel bending: there is nothing to solve."""
    seconds = {}
    for name in ("empty_hand", "ball"):
        held = tuple(thing for thing in THINGS if thing.name == name)
        simulation = Simulation(Recipe(held, 1, 44, 2, 0, DEFAULT, effects=frozenset(EFFECTS) - {"bending"}))
        begin, solved = time.perf_counter(), simulation.work
        frames = sum(counts.shape[1] for counts in simulation.blocks())
        seconds[name] = time.perf_counter() - begin
        if name == "empty_hand":
            evaluations = solved.evaluations + (frames != 44)
    said = f"{seconds['empty_hand']:.3f} s against {seconds['ball']:.3f} s of a ball"
    yield Finding("evaluations of the mechanics", evaluations, 0, said)


def _imported(*words: str) -> tuple[set[str], float]:
    """The libraries that a run of `lean.py` in a process of its own has imported by its end, and its seconds."""
    settings = {"MLFLOW_TRACKING_URI": "disabled", "PYTHONPATH": str(ROOT)}
    command, begin = [sys.executable, "-m", lean.__name__, *words], time.perf_counter()
    done = subprocess.run(command, cwd=ROOT, env=os.environ | settings, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    return set(done.stdout.split("imported")[-1].split()), time.perf_counter() - begin


CASES = (a_graph_of_one_view, libraries, a_hand_without_an_object)
