"""Cluster the training and validation frames of each object (or recording) into views."""

import click
import numpy as np

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.frames.split import TRAIN, VALIDATION
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import read_frames
from tactile_viewgcn.tables.views import write_views
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.viewpoints import viewpoints


@stage("seed", "views", "viewpoints", "cluster")
@click.option("--frames", type=INPUT, required=True)
@click.option("--out", type=OUTPUT, required=True)
def cluster(params, job, frames, out):
    """Cluster the training and validation frames of each object (or recording) into views."""
    table, count = read_frames(frames), params.views
    rng = stream(params.seed, "cluster")
    views = cluster_frames(table, viewpoints(count, params.viewpoints, params.seed), params.cluster, rng)
    index = table.on(TRAIN, VALIDATION)
    pools, empty = len(np.unique(views.pool[index])), int(views.on(index, rng).empty.sum())
    if views.clustered:
        print(f"cluster: {pools} pools in {count} clusters each")
        job.run.figure("cluster_means.png", lambda: _picture(table, views))
    else:
        print(f"cluster: none; view sets are drawn at random from each of {pools} pools")
    if empty:
        job.note(f"{empty} of {pools * count} views have no frame of their own and repeat one of their pool's")
    write_views(out, views)
    return {"pools": pools, "empty_clusters": empty}


def _picture(table, views):
    from tactile_viewgcn.plots import cluster_means

    return cluster_means(views.means(table), table.live, table.classes)


if __name__ == "__main__":
    cluster()
