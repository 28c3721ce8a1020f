"""Cluster the training and validation frames of each object (or recording) into views."""

import click
import numpy as np

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.clustering import cluster_pools, pool_ids
from tactile_viewgcn.frames import read_frames
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.split import TEST, TRAIN
from tactile_viewgcn.viewpoints import viewpoints
from tactile_viewgcn.views import NO_CLUSTER, Views, ViewSets, write_views


@stage("seed", "views", "viewpoints", "cluster")
@click.option("--frames", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True)
def cluster(params, run, frames, out):
    """Cluster the training and validation frames of each object (or recording) into views."""
    table, count = read_frames(frames), params.views
    places = viewpoints(count, params.viewpoints)
    pool = pool_ids(table.label, table.recording, table.side, params.cluster.scope)
    views = Views(np.full(len(table), NO_CLUSTER, dtype=np.int16), pool, places)
    sizes = np.unique(pool[table.side != TEST], return_counts=True)[1]
    if params.cluster.method == "none":
        empty = int(np.maximum(0, count - sizes).sum())
        print(f"cluster: none; view sets are drawn at random from each of {len(sizes)} pools")
    else:
        empty = _cluster(params, table, views)
        print(f"cluster: {len(sizes)} pools in {count} clusters each")
        run.figure("cluster_means.png", lambda: _picture(table, views))
    if empty:
        print(f"  {empty} of {len(sizes) * count} views have no frame of their own and repeat one of their pool's")
    write_views(out, views)
    return {"pools": len(sizes), "empty_clusters": empty}


def _cluster(params, table, views) -> int:
    """Fill in the clusters of all frames but the test side's; the number of clusters without frames."""
    index = np.flatnonzero(table.side != TEST)
    pool = np.unique(views.pool[index], return_inverse=True)[1].ravel()
    points = table.inputs(index)[:, table.live]
    found = cluster_pools(points, pool, params.views, params.cluster, stream(params.seed, "cluster"))
    views.cluster[index] = found
    return int(ViewSets(found, pool, params.views).empty.sum())


def _picture(table, views):
    from tactile_viewgcn.plots import cluster_means

    means = np.zeros((len(table.classes), len(views.viewpoints), *table.live.shape))
    for label, column in np.ndindex(means.shape[:2]):
        index = np.flatnonzero((table.label == label) & (table.side == TRAIN) & (views.cluster == column))
        if len(index):
            means[label, column] = table.inputs(index).mean(axis=0)
    return cluster_means(means, table.live, table.classes)


if __name__ == "__main__":
    cluster()
