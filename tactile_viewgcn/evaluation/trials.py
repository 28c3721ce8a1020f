"""Trials on the evaluated side: each clusters it anew and classifies one view set per anchor frame."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.frames.split import SIDES
from tactile_viewgcn.nn.network import view_set_logits
from tactile_viewgcn.params import Cluster, Evaluate
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.counts import Gathered
from tactile_viewgcn.tables.frames import Frames
from tactile_viewgcn.views.clustering import cluster_pools, pool_ids, pool_scores
from tactile_viewgcn.views.sampling import ViewSets

PROTOCOLS = ("object", "recording")
TOP = 3


@dataclass(frozen=True)
class Trials:
    """Predictions of T trials for A anchors under one protocol.

    Attributes:
        predicted: int64 (T, A) most probable class.
        correct: bool (T, A).
        in_top3: bool (T, A) whether the true class is among the three most probable.
        empty: clusters without frames, whose views repeat other frames, summed over the trials.
    """

    predicted: np.ndarray
    correct: np.ndarray
    in_top3: np.ndarray
    empty: int


def all_trials(
    classifier: Classifier, features: Tensor, table: Frames, cluster: Cluster, evaluate: Evaluate, seed: int
) -> dict[str, Trials]:
    """The trials of each protocol in `evaluate.protocols`; the view sets are the same for all classifiers of V views.

    Args:
        classifier: its `head` and `views` are used.
        features: (n, ...) of the evaluated side's frames, as the head takes them.
    """
    index = table.on(SIDES.index(evaluate.side))
    protocols: dict[str, Trials] = {}
    points, label = table.points(index), table.label[index]
    anchors = np.flatnonzero(table.anchor[index])
    with tqdm(total=len(evaluate.protocols) * evaluate.trials, desc="evaluate", unit="trial", disable=None) as bar:
        for number, protocol in enumerate(PROTOCOLS):
            if protocol not in evaluate.protocols:
                continue
            pool = pool_ids(label, table.recording[index], table.side[index], protocol)
            trials = (stream(seed, "trial", number, trial) for trial in range(evaluate.trials))
            protocols[protocol] = run_trials(
                classifier, features, points, label, pool, anchors, cluster, trials=trials, bar=bar
            )
    return protocols


@torch.inference_mode()
def run_trials(
    classifier: Classifier,
    features: Tensor,
    points: np.ndarray | Gathered,
    labels: np.ndarray,
    pool: np.ndarray,
    anchors: np.ndarray,
    cluster: Cluster,
    *,
    trials: Iterable[np.random.Generator],
    bar: tqdm,
) -> Trials:
    """Classify one view set per anchor in each trial, each with its own generator and clustering.

    Args:
        features: (n, C) of the frames; points: (n, d) network input that is clustered; labels, pool: (n,).
        anchors: (A,) indices of the frames that view sets are drawn around.
    """
    views, scores, empty = classifier.views, None, 0
    if cluster.method == "kmeans" and views > 1:
        scores = pool_scores(points, pool, cluster.components)
    top, truth = [], torch.from_numpy(labels[anchors].astype(np.int64))
    for rng in trials:
        clusters = cluster_pools(points, pool, views, cluster, rng, scores)
        sets = ViewSets(clusters, pool, views)
        drawn = torch.from_numpy(sets.draw(anchors, rng, cluster.assignment)).to(features.device)
        logits = view_set_logits(classifier.head, features, drawn)
        order = logits.argsort(dim=-1, descending=True, stable=True)  # ties to the lowest class
        top.append(order[:, :TOP].cpu())
        empty += int(sets.empty.sum())
        bar.update()
    best = torch.stack(top)  # (T, A, 3)
    in_top3 = (best == truth[:, None]).any(dim=-1)
    return Trials(best[..., 0].numpy(), (best[..., 0] == truth).numpy(), in_top3.numpy(), empty)
