"""The pairs of a fast path of the pipeline and its plain counterpart, each taken in turn on the same sample."""

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import torch

from studies.speed import plain
from studies.speed.sample import Sample, tensors
from studies.speed.turns import Pair, clocked, in_turn
from tactile_viewgcn.clustering import cluster_pools, pool_ids, pool_scores
from tactile_viewgcn.compute import Compute
from tactile_viewgcn.evaluation import evaluate_table
from tactile_viewgcn.finetuning import finetune_classifier
from tactile_viewgcn.frames import Frames, full_scale
from tactile_viewgcn.nn.backbone import features_of
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recordings import Source, write_recordings
from tactile_viewgcn.split import TEST, TRAIN
from tactile_viewgcn.stag import read_metadata
from tactile_viewgcn.stag_form import write_metadata
from tactile_viewgcn.views import ViewSets, random_parts

ROUNDS, LONG_ROUNDS = 5, 3
EPOCHS = 5  # of fine-tuning
PLAIN_SETS = 60  # view sets that the plain network is timed on
DRAWS = 20  # of all view sets
TRIALS = 10  # of the clustering
INGESTED = 4096  # frames
CPU = torch.device("cpu")


def clusters(one: Sample, side: int, params: SimpleNamespace) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Cluster and pool (n,) of a side's frames, the pools numbered from 0, and their network input (n, d)."""
    index = one.table.on(side)
    pool = np.unique(one.views.pool[index], return_inverse=True)[1].ravel()
    if side == TRAIN and one.views.clustered:
        cluster = one.views.cluster[index].astype(np.int64)
    else:
        cluster = random_parts(pool, params.views, stream(params.seed, "speed.parts"))
    return cluster, pool, one.table.inputs(index)[:, one.table.live]


def finetuning(one: Sample, params: SimpleNamespace, compute: Compute, reuses: list[int]) -> dict[int, Pair]:
    """An epoch of fine-tuning for each `finetune.reuse`; the work is view sets.

    The fast one is a part of several epochs, so that what the first one does once, filling the bank, is shared out.
    """
    frames, labels = tensors(one.few, TRAIN, compute)
    anchors = np.flatnonzero(one.few.anchor[one.few.on(TRAIN)])
    cluster, pool, _ = clusters(one, TRAIN, params)
    rng = stream(params.seed, "speed.sets")
    some = rng.permutation(anchors)[:PLAIN_SETS]
    noise = params.finetune.noise * full_scale(one.few.kind, one.few.scale)

    def fast(reuse: int) -> float:
        how = replace(params.finetune, epochs=EPOCHS, reuse=reuse, sizes="full")
        few = SimpleNamespace(**vars(params) | {"finetune": how})
        return finetune_classifier(one.few, one.views, one.pretrained, few, compute)[1].seconds / EPOCHS

    def plainly() -> float:
        classifier = plain.PlainClassifier(one.classifier)
        sets = plain.draw(some, cluster, pool, params.views, rng)
        epoch = partial(plain.finetune_epoch, classifier, frames, labels, sets, params.finetune, noise)
        return clocked(epoch, compute.device)()

    works = {str(reuse): partial(fast, reuse) for reuse in reuses} | {"plain": plainly}
    taken = in_turn(works, LONG_ROUNDS)
    return {reuse: Pair(taken[str(reuse)], taken["plain"], len(anchors), len(some)) for reuse in reuses}


def evaluation(one: Sample, params: SimpleNamespace, compute: Compute) -> Pair:
    """All trials of all protocols, the plain ones from one trial of each, its network timed on some view sets."""
    what = replace(params.evaluate, stop_at=0.0)

    def fast() -> float:
        return evaluate_table(one.classifier, one.table, params.cluster, what, compute, params.seed).seconds

    classifier = plain.PlainClassifier(one.classifier)
    trials = [partial(plain_trial, one, params, compute, classifier, scope) for scope in what.scope]
    works = {"fast": fast, "plain": lambda: what.trials * sum(trial() for trial in trials)}
    return Pair(**in_turn(works, LONG_ROUNDS, warm=False))  # both networks have run before, to be compared


def plain_trial(
    one: Sample, params: SimpleNamespace, compute: Compute, classifier: plain.PlainClassifier, scope: str
) -> float:
    """Seconds of one trial: clusters, view sets, logits of each."""
    table, index, rng = one.table, one.table.on(TEST), stream(params.seed, "speed.trial")
    frames, anchors = tensors(table, TEST, compute)[0], np.flatnonzero(table.anchor[index])
    points = table.inputs(index)[:, table.live]
    begin = time.perf_counter()
    pool = pool_ids(table.label[index], table.recording[index], table.side[index], scope)
    cluster = cluster_pools(points, pool, params.views, params.cluster, rng)
    sets = plain.draw(anchors, cluster, pool, params.views, rng)
    before = time.perf_counter() - begin
    some = rng.permutation(sets)[:PLAIN_SETS]
    passing = clocked(partial(plain.logits, classifier, frames, some), compute.device)
    return before + passing() * len(sets) / len(some)


def features(one: Sample, compute: Compute) -> Pair:
    """The features of the test side's frames; the work is frames."""
    frames = tensors(one.table, TEST, compute)[0]
    backbone = one.classifier.to(compute.device, memory_format=torch.channels_last).backbone
    inputs, slow = compute.frames(frames.squeeze(1)), plain.PlainBackbone(backbone).eval()

    @torch.no_grad()
    def plainly() -> None:
        for part in frames.split(plain.SETS * one.classifier.views):
            slow(part)

    def fast() -> None:
        with compute.autocast():
            features_of(backbone, inputs)

    works = {"fast": clocked(fast, compute.device), "plain": clocked(plainly, compute.device)}
    return Pair(**in_turn(works, ROUNDS), fast_work=len(frames), plain_work=len(frames))


def drawing(one: Sample, params: SimpleNamespace) -> Pair:
    """View sets around all training anchors; the work is view sets."""
    cluster, pool, _ = clusters(one, TRAIN, params)
    anchors = np.flatnonzero(one.table.anchor[one.table.on(TRAIN)])
    rng = stream(params.seed, "speed.sets")

    def fast() -> np.ndarray:
        return ViewSets(cluster, pool, params.views).draw(anchors, rng)

    def plainly() -> np.ndarray:
        return plain.draw(anchors, cluster, pool, params.views, rng)

    works = {"fast": clocked(fast, CPU, DRAWS), "plain": clocked(plainly, CPU)}
    return Pair(**in_turn(works, ROUNDS), fast_work=len(anchors), plain_work=len(anchors))


def clustering(one: Sample, params: SimpleNamespace) -> Pair:
    """Ten clusterings of the training side, the principal components found once or anew in each."""
    _, pool, points = clusters(one, TRAIN, params)
    rng = stream(params.seed, "speed.clusters")

    def fast() -> None:
        scores = pool_scores(points, pool, params.cluster.components)
        for _ in range(TRIALS):
            cluster_pools(points, pool, params.views, params.cluster, rng, scores)

    def plainly() -> None:
        for _ in range(TRIALS):
            cluster_pools(points, pool, params.views, params.cluster, rng)

    return Pair(**in_turn({"fast": clocked(fast, CPU), "plain": clocked(plainly, CPU)}, LONG_ROUNDS))


def ingest(table: Frames) -> Pair:
    """A metadata.mat of frames like the table's, from the file to the table of recordings; the work is frames."""
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "metadata.mat", Path(folder) / "recordings.h5"
        write_metadata(path, source_of(table, INGESTED))
        works = {
            "fast": clocked(lambda: write_recordings(out, read_metadata(path), ""), CPU),
            "plain": clocked(lambda: plain.ingest(path, out), CPU),
        }
        return Pair(**in_turn(works, LONG_ROUNDS), fast_work=INGESTED, plain_work=INGESTED)


def source_of(table: Frames, count: int) -> Source:
    """The table's frames, over and over up to that number, as a source with STAG's columns."""
    index = np.arange(count) % len(table)
    columns = {
        "pressure": np.round(table.counts[index]).astype(np.int16),
        "object": table.label[index],
        "recording": table.recording[index],
        "session": table.session[index],
        "frame": np.arange(count),
        "time": table.time[index],
        "split": (table.side[index] == TEST).astype(np.int8),
        "valid": np.ones(count, dtype=bool),
        "balanced": table.anchor[index],
    }

    def blocks() -> Iterator[dict[str, np.ndarray]]:
        yield columns

    names = table.classes, table.recordings, table.sessions
    return Source(Path("frames"), *names, table.counts.shape[1:], np.dtype(np.int16), blocks())
