"""Draw view sets of a whole recording from its own clusters, as training draws them from pools."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.params import Cluster
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.counts import Counts
from tactile_viewgcn.views.clustering import COMPONENTS, kmeans, principal_components
from tactile_viewgcn.views.sampling import ViewSets


@dataclass(frozen=True)
class RecordingClusters:
    """Draws view sets of whole recordings for a network that was trained on clusters.

    Args:
        params: the section `cluster` of the training run. It says how clusters are made, and which
            viewpoint each of them has.
    """

    params: Cluster

    def view_sets(self, points: Counts, views: int) -> np.ndarray:
        """Return one view set around each frame: the frame, and one frame of each other cluster.

        Each call makes its own generators, so that the answer to a recording does not depend on
        earlier answers. A cluster can have no frames, for example in a recording of fewer frames
        than views. Then any frame of the recording takes its place.

        Args:
            points: (T, S) network input of the recording's frames at the live sensors, in the order
                of time.
            views: V.

        Returns:
            int64 (T, V) indices of frames.
        """
        rng = stream(0, "recording clusters")
        in_order = np.ascontiguousarray(points[:])  # sums depend on the order in memory
        scores = principal_components(in_order, COMPONENTS)
        seed = int(rng.integers(2**31))
        cluster = kmeans(scores, views, restarts=self.params.restarts, seed=seed)
        one_pool = np.zeros(len(cluster), dtype=np.int64)
        frames = np.arange(len(cluster))
        return ViewSets(cluster, one_pool, views).draw(frames, rng, self.params.assignment)
