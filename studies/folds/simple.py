"""Simple classifiers of single frames, their probabilities averaged over the systems' own view sets."""

import time
import warnings
from types import SimpleNamespace

import click
import numpy as np
import torch
from sklearn.base import ClassifierMixin
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LogisticRegression
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline
from torch import Tensor

from stages.command import INPUT, OUTPUT, peak_mb, stage
from studies.arms import Arm, recipe_of, write_arm
from tactile_viewgcn.clustering import cluster_table
from tactile_viewgcn.evaluation import all_trials
from tactile_viewgcn.frames import Frames, read_frames, transform
from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.split import TEST, TRAIN
from tactile_viewgcn.viewpoints import viewpoints

NAMES = {
    "trees": "extremely randomised trees",
    "logistic": "logistic regression",
    "knn": "nearest neighbours",
    "lda": "PCA and LDA",
}
COMPONENTS = 50  # of PCA


@stage("seed", "views", "viewpoints", "cluster", "evaluate")
@click.option("--classifier", type=click.Choice(list(NAMES)), required=True)
@click.option("--fold", type=int, default=0, help="Of the split that the frames are of.")
@click.option("--frames", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True, help="An .npz of every answer.")
def simple(params, run, classifier, fold, frames, out):
    """Fit and test a simple classifier on one fold."""
    table, name = read_frames(frames), NAMES[classifier]
    begin = time.perf_counter()
    probabilities = frame_probabilities(table, classifier, params.seed)
    seconds = time.perf_counter() - begin
    references = None
    if params.cluster.assignment == "matched":
        places = viewpoints(params.views, params.viewpoints, params.seed)
        references = cluster_table(table, places, params.cluster, stream(params.seed, "cluster")).references
    joined = SimpleNamespace(views=params.views, head=Averaged(), references=references)
    found = all_trials(joined, torch.from_numpy(probabilities), table, params.cluster, params.evaluate, params.seed)
    index = table.on(TEST)
    anchors = index[table.anchor[index]]
    predicted = {protocol: trials.predicted for protocol, trials in found.items()}
    costs = {"finetune": seconds, "peak_mb": peak_mb()}
    labels, groups = table.label[anchors], table.group[anchors]
    arm = Arm(name, params.seed, fold, 0, recipe_of(params), costs, predicted, labels, groups, table.classes)
    write_arm(out, arm)
    errors = {protocol: 1 - float(arm.right(protocol).mean()) for protocol in predicted}
    print(f"{name}, fold {fold}: " + ", ".join(f"{protocol} {100 * error:.1f} %" for protocol, error in errors.items()))
    return {f"error.{protocol}": error for protocol, error in errors.items()}


class Averaged(ViewSystem):
    """Probabilities (B, k, C) to their mean."""

    takes_fewer, learns = True, False

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        return views.mean(dim=1), []


def frame_probabilities(table: Frames, classifier: str, seed: int) -> np.ndarray:
    """float32 (n, C) of the test side's frames, learnt from the training anchors; counts above rest as log(1 + x)."""
    own = np.flatnonzero(table.anchor & (table.side == TRAIN))
    points = _points(table, own)
    model = untuned(classifier, seed, most=min(len(own) - 1, points.shape[1]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # 500 iterations are all it gets
        fitted = model.fit(points, table.label[own])
    found = np.zeros((len(table.on(TEST)), len(table.classes)), dtype=np.float32)
    found[:, fitted.classes_] = fitted.predict_proba(_points(table, table.on(TEST)))
    return found


def untuned(classifier: str, seed: int, *, most: int) -> ClassifierMixin:
    """The classifier as it comes, with nothing chosen on the data."""
    return {
        "trees": lambda: ExtraTreesClassifier(500, random_state=seed),
        "logistic": lambda: LogisticRegression(max_iter=500),
        "knn": lambda: KNeighborsClassifier(5, metric="cosine"),
        "lda": lambda: make_pipeline(PCA(min(COMPONENTS, most), random_state=seed), LinearDiscriminantAnalysis()),
    }[classifier]()


def _points(table: Frames, index: np.ndarray) -> np.ndarray:
    excess = table.counts[index][:, table.live] - table.rest_mean[table.rest[index]][:, table.live]
    return transform(excess, "log", table.scale)


if __name__ == "__main__":
    simple()
