"""View sets of a whole recording from its own clusters, as a training draws them from the clusters of its pools."""

from dataclasses import dataclass

import numpy as np

from tactile_viewgcn.params import Cluster
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables.counts import Counts
from tactile_viewgcn.views.clustering import COMPONENTS, kmeans, principal_components
from tactile_viewgcn.views.sampling import ViewSets


@dataclass(frozen=True)
class RecordingClusters:
    """Draws the view sets by which a network answers a whole recording, if it was trained on clusters.

    Args:
        params: how the clusters of the training were made, and at which viewpoint each stands.
    """

    params: Cluster

    def view_sets(self, points: Counts, views: int) -> np.ndarray:
        """Return one view set around each frame: the frame, and one frame of each other cluster of the recording.

        Each call has generators of its own, so that a recording has one answer whatever is answered
        before it. Of a cluster without frames, as where there are fewer frames than views, any
        frame of the recording stands.

        Args:
            points: (T, S) network input of the recording's frames at the live sensors, in the order
                of time.
            views: V.

        Returns:
            int64 (T, V) indices of frames.
        """
        rng = stream(0, "recording clusters")
        scores = principal_components(points[:], COMPONENTS)
        seed = int(rng.integers(2**31))
        cluster = kmeans(scores, views, restarts=self.params.restarts, seed=seed)
        one_pool = np.zeros(len(cluster), dtype=np.int64)
        frames = np.arange(len(cluster))
        return ViewSets(cluster, one_pool, views).draw(frames, rng, self.params.assignment)
