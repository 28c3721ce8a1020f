"""Trials on the evaluated side: each clusters it anew and classifies one view set per anchor frame."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from tactile_viewgcn.messages import UserError, several
from tactile_viewgcn.params import Cluster, Evaluate
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.features import every_few
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.tables.counts import Gathered
from tactile_viewgcn.tables.frames import SIDES, Frames
from tactile_viewgcn.views.clustering import cluster_pools, pool_ids, pool_scores
from tactile_viewgcn.views.sampling import ViewSets, anchor_first, joined_pools, powers_of_two

PROTOCOLS = ("object", "recording")
TOP = 3


@dataclass(frozen=True)
class Trials:
    """Predictions of T trials for A anchors under one protocol.

    Attributes:
        predicted: int64 (T, A) most probable class.
        correct: bool (T, A).
        in_top3: bool (T, A) whether the true class is among the three most probable.
        fewer: `correct` by number of views, 1, 2, 4 and so on below V: the anchor and other views of its set at random,
            each time those before and more. Empty where the classifier takes V alone.
        frames: number of frames of an answer: V, or the median of the recordings that are answered `whole`.
        empty: clusters without frames, whose views repeat other frames, summed over the trials.
    """

    predicted: np.ndarray
    correct: np.ndarray
    in_top3: np.ndarray
    empty: int
    fewer: dict[int, np.ndarray] = field(default_factory=dict)
    frames: int = 1
    whole: bool = False


def all_trials(
    classifier: Classifier,
    features: Tensor,
    table: Frames,
    cluster: Cluster,
    evaluate: Evaluate,
    seed: int,
    temperatures: list[float] | None = None,
) -> dict[str, Trials]:
    """The trials of each protocol in `evaluate.protocols`; the view sets are the same for all classifiers of V views.

    Under `recording` a view set is of one recording and split group, or joins `evaluate.grasps` grasps of one object. A
    system on the sensors answers each recording, or grasp, once by all its frames; every anchor has its answer.

    Args:
        classifier: its `logits`, `views` and `takes_fewer` are used.
        features: (n, ...) of the evaluated side's frames, see `Classifier`.
        temperatures: see `run_trials`.
    """
    index = table.on(SIDES.index(evaluate.side))
    points, label, anchors = table.points(index), table.label[index], np.flatnonzero(table.anchor[index])
    protocols: dict[str, Trials] = {}
    for number, protocol in enumerate(PROTOCOLS):
        if protocol not in evaluate.protocols:
            continue
        joined = evaluate.grasps if protocol == "recording" and evaluate.grasps != "all" else 0
        pool = pool_ids(table, index, "grasp" if joined else protocol)
        whole = None
        if protocol == "recording" and isinstance(classifier, SensorClassifier):
            of_pool = (np.flatnonzero(pool == number) for number in range(pool.max() + 1))
            whole = torch.cat([classifier.recording_logits(features[every_few(each)]) for each in of_pool])
        bar = tqdm(range(evaluate.trials), desc=f"evaluate by {protocol}", unit="trial", disable=None)
        protocols[protocol] = run_trials(
            classifier,
            features,
            points,
            label,
            pool,
            anchors,
            cluster,
            (stream(seed, "trial", number, trial) for trial in bar),
            joined=joined or 1,
            temperatures=temperatures,
            whole=whole,
        )
    return protocols


def check_grasps(table: Frames, evaluate: Evaluate) -> None:
    """Raise a UserError where an object has fewer grasps on the evaluated side than `evaluate.grasps` joins."""
    if evaluate.grasps == "all" or "recording" not in evaluate.protocols:
        return
    index = table.on(SIDES.index(evaluate.side))
    first = np.unique(pool_ids(table, index, "grasp"), return_index=True)[1]
    labels, counts = np.unique(table.label[index][first], return_counts=True)
    fewest = int(counts.argmin())
    if counts[fewest] < evaluate.grasps:
        what = several(int(counts[fewest]), unit_of_grasps(table))
        raise UserError(
            f"evaluate.grasps is {evaluate.grasps}, and the {evaluate.side} side has {what} of "
            f"{table.classes[labels[fewest]]}; expected {evaluate.grasps} of every object: lower it, or hold more out"
        )


def unit_of_grasps(table: Frames) -> str:
    """The unit of `evaluate.grasps`: grasp, or recording where grasps are not numbered."""
    return "grasp" if table.grasp.any() else "recording"


@torch.inference_mode()
def run_trials(
    classifier: Classifier,
    features: Tensor,
    points: np.ndarray | Gathered,
    labels: np.ndarray,
    pool: np.ndarray,
    anchors: np.ndarray,
    cluster: Cluster,
    rngs: Iterable[np.random.Generator],
    *,
    joined: int = 1,
    temperatures: list[float] | None = None,
    whole: Tensor | None = None,
) -> Trials:
    """Classify one view set per anchor in each trial, each with its own generator and clustering.

    A calibrated classifier answers each pool of a view set alone, and the answers' logarithms are added, as `predict
    --together` does; a classifier without temperatures takes the frames of all pools as one set. View sets that join
    pools are not classified with fewer views.

    Args:
        features: (n, C) of the frames; points: (n, d) network input that is clustered; labels, pool: (n,).
        anchors: (A,) indices of the frames that view sets are drawn around.
        rngs: a generator for each trial.
        joined: number of pools of one class that a view set joins; each has that many times fewer clusters.
        temperatures: of a calibrated classifier, for 1 to V frames.
        whole: (P, classes) logits of each pool by all its frames; in their place view sets are for fewer frames alone.
    """
    views, empty, length = classifier.views, 0, int(np.median(np.bincount(pool)))
    frames = views if whole is None else length
    clusters = -(-views // joined)
    scores = pool_scores(points, pool) if cluster.method == "kmeans" and clusters > 1 else None
    top, truth = [], torch.from_numpy(labels[anchors].astype(np.int64))
    fewer: dict[int, list[Tensor]] = {}
    sizes = [size for size in powers_of_two(views) if size < frames] if classifier.takes_fewer and joined == 1 else []
    for rng in rngs:
        sets = ViewSets(cluster_pools(points, pool, clusters, cluster, rng, scores), pool, clusters)
        pools = joined_pools(pool, labels, anchors, joined, rng)
        drawn = sets.draw(anchors, rng, cluster.assignment, pools, views)
        if whole is not None:
            logits = whole[torch.from_numpy(pools)].log_softmax(dim=-1).sum(dim=1)
        elif joined > 1 and temperatures is not None:
            logits = _joined_logits(classifier, features, drawn, pool, pools, temperatures)
        else:
            logits = classifier.logits(features, torch.from_numpy(drawn).to(features.device))
        order = logits.argsort(dim=-1, descending=True, stable=True)  # ties to the lowest class
        top.append(order[:, :TOP].cpu())
        columns = anchor_first(drawn, anchors, rng.spawn(1)[0])  # a separate generator, so that no other draw changes
        for size in sizes:
            part = torch.from_numpy(np.take_along_axis(drawn, columns[:, :size], axis=1)).to(features.device)
            fewer.setdefault(size, []).append(classifier.logits(features, part).argmax(dim=-1).cpu() == truth)
        empty += int(sets.empty.sum())
    best = torch.stack(top)  # (T, A, 3)
    in_top3 = (best == truth[:, None]).any(dim=-1)
    correct = {size: torch.stack(trials).numpy() for size, trials in fewer.items()}
    return Trials(
        best[..., 0].numpy(),
        (best[..., 0] == truth).numpy(),
        in_top3.numpy(),
        empty,
        correct,
        frames,
        whole is not None,
    )


def _joined_logits(
    classifier: Classifier,
    features: Tensor,
    drawn: np.ndarray,
    pool: np.ndarray,
    pools: np.ndarray,
    temperatures: list[float],
) -> Tensor:
    """Logits (A, classes) of view sets (A, V): the sum of those of each of its pools (A, G), from its frames alone."""
    parts = [drawn[pool[drawn] == one[:, None]].reshape(len(drawn), -1) for one in pools.T]
    indices = [torch.from_numpy(part).to(features.device) for part in parts]
    alone = [classifier.logits(features, part) / temperatures[part.shape[1] - 1] for part in indices]
    return torch.stack(alone).sum(dim=0)
