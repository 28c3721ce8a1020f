"""Cluster the training and validation frames of each object, or recording, into views."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from stages.command import run
from stages.job import Job
from tactile_viewgcn.messages import Note, several
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.frames import TRAIN, VALIDATION, Frames, load_table, save_table
from tactile_viewgcn.views.clustering import cluster_frames
from tactile_viewgcn.views.sampling import sets_of
from tactile_viewgcn.views.viewpoints import viewpoints


def cluster(job: Job, needs: Path, frames: Path, out: Path) -> str:
    """Write the clusters, and return the line to print."""
    params = job.params
    table = load_table(frames, Frames)
    clustering = params.cluster
    if not job.needed:
        clustering = replace(clustering, method="none")
    rng = stream(params.seed, "cluster")
    directions = viewpoints(params.views, params.viewpoints, params.seed)
    views = cluster_frames(table, directions, clustering, rng)
    index = table.on(TRAIN, VALIDATION)
    pools = len(np.unique(views.pool[index]))
    empty = int(sets_of(views, index, rng).empty.sum())
    save_table(out, views)
    job.record.counts |= {"pools": pools, "empty_clusters": empty}
    if not job.needed:
        return "cluster: left out, model.system does not need it"
    if empty:
        text = (
            f"{empty} of {several(pools * params.views, 'view')}: the cluster is empty, "
            "so a frame of its pool is repeated"
        )
        job.note(Note(text, topic="clusters"))
    if not views.clustered:
        return f"cluster: none; random view sets come from each of {several(pools, 'pool')}"
    return f"cluster: {several(pools, 'pool')} in {several(params.views, 'cluster')} each"


if __name__ == "__main__":
    run(cluster, "needs", "frames")
