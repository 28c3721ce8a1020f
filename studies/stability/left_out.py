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

from studies.stability.case import Finding, Subject
from studies.stability.graph import view_gcn
from studies.stability.learning import few_anchors
from tactile_viewgcn.classifier import save_classifier
from tactile_viewgcn.frames import write_frames
from tactile_viewgcn.glove.contact import Layer
from tactile_viewgcn.glove.objects import THINGS
from tactile_viewgcn.glove.simulation import EFFECTS, Recipe, Simulation
from tactile_viewgcn.nn.view_gcn import LocalGraphConvolution, NonLocalMessagePassing, SelectiveViewSampling
from tactile_viewgcn.viewpoints import viewpoints

ROOT = Path(__file__).parents[2]
LAYERS = LocalGraphConvolution | NonLocalMessagePassing | SelectiveViewSampling
LAYER = Layer(stiffness=2.5e7, thickness=4e-3, joint_damping=0.02, object_damping=60.0)
ROUNDS = 5
#: A run of the unclustered pipeline from its frames on: the stages' own commands, and what they have imported.
UNCLUSTERED = """
import sys
import tactile_viewgcn.evaluation
from stages.cluster import cluster
from stages.evaluate import evaluate
tactile_viewgcn.evaluation.SINGLE_REPEATS = tactile_viewgcn.evaluation.BATCH_REPEATS = 1
common = ["--frames", "{folder}/frames.h5", "--params", "{root}/params.yaml", "--set", "cluster.method=none",
          "--set", "evaluate.trials=1", "--set", "evaluate.stop_at=0", "--set", "views={views}",
          "--set", "viewpoints=sphere"]
cluster([*common, "--out", "{folder}/views.h5", "--record", "{folder}/c.json"], standalone_mode=False)
evaluate([*common, "--classifier", "{folder}/few.pt", "--out", "{folder}/out", "--record", "{folder}/e.json"],
         standalone_mode=False)
"""
HELP = """
import sys
from tactile_viewgcn.cli import main
sys.argv = ["tactile-viewgcn", "--help"]
try:
    main()
except SystemExit:
    pass
"""


def a_graph_of_one_view(subject: Subject) -> Iterator[Finding]:
    """The network for one view has no layers of a graph; what it saves against eight."""
    heads = {views: view_gcn(subject, torch.from_numpy(viewpoints(views))) for views in (1, 8)}
    seconds = {views: [] for views in heads}
    for _ in range(1 + ROUNDS):
        for views, head in heads.items():
            nodes = torch.rand(64, views, subject.classifier.given[0])
            begin = time.perf_counter()
            with torch.inference_mode():
                head(nodes)
            seconds[views].append(time.perf_counter() - begin)
    one, eight = (float(np.median(values[1:])) for values in seconds.values())
    layers = sum(isinstance(layer, LAYERS) for layer in heads[1].modules())
    yield Finding(
        "layers of a graph", layers, 0, f"{64e-3 / one:,.0f} thousand view sets a second against {64e-3 / eight:,.0f}"
    )


def libraries(subject: Subject) -> Iterator[Finding]:
    """An unclustered run without scikit-learn, one without tracking without MLflow, `--help` without torch."""
    write_frames(subject.folder / "frames.h5", few_anchors(subject.table))
    save_classifier(subject.folder / "few.pt", subject.classifier, subject.params.model, subject.table)
    run = UNCLUSTERED.format(folder=subject.folder, root=ROOT, views=subject.classifier.views)
    found, seconds = _imported(run, "sklearn", "mlflow")
    yield Finding("scikit-learn imported by an unclustered run", found["sklearn"], 0, f"the run took {seconds:.1f} s")
    yield Finding("MLflow imported by a run with tracking disabled", found["mlflow"], 0)
    found, seconds = _imported(HELP, "torch", "mlflow", "sklearn", "scipy")
    yield Finding(
        "torch, MLflow, scikit-learn or SciPy imported by --help", sum(found.values()), 0, f"it took {seconds:.1f} s"
    )


def a_hand_without_an_object(_: Subject) -> Iterator[Finding]:
    """A recording of the empty hand in a glove that does not feel bending: there is nothing to solve."""
    seconds = {}
    for name in ("empty_hand", "ball"):
        held = tuple(thing for thing in THINGS if thing.name == name)
        simulation = Simulation(Recipe(held, 1, 44, 2, 0, LAYER, effects=frozenset(EFFECTS) - {"bending"}))
        begin, solved = time.perf_counter(), simulation.work
        frames = sum(counts.shape[1] for counts in simulation.blocks())
        seconds[name] = time.perf_counter() - begin
        if name == "empty_hand":
            evaluations = solved.evaluations + (frames != 44)
    said = f"{seconds['empty_hand']:.3f} s against {seconds['ball']:.3f} s of a ball"
    yield Finding("evaluations of the mechanics", evaluations, 0, said)


def _imported(code: str, *libraries: str) -> tuple[dict[str, float], float]:
    """Whether a process that runs the code has imported each library by its end, and its seconds."""
    tell = f"\nprint('imported', *[name for name in {libraries!r} if name in sys.modules])"
    settings = {"MLFLOW_TRACKING_URI": "disabled", "PYTHONPATH": str(ROOT)}
    begin = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", code + tell],
        cwd=ROOT,
        env=os.environ | settings,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    last = done.stdout.strip().splitlines()[-1].split()
    return {name: float(name in last) for name in libraries}, time.perf_counter() - begin


CASES = (a_graph_of_one_view, libraries, a_hand_without_an_object)
