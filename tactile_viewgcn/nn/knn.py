"""Nearest neighbours of single frames."""

from typing import Any

from tactile_viewgcn.nn.frame_estimator import FrameEstimator


class NearestNeighbours(FrameEstimator):
    """Five neighbours, or as many as there are training frames, by the angle between frames."""

    def estimator(self, seed: int, shape: tuple[int, int]) -> Any:
        from sklearn.neighbors import KNeighborsClassifier

        return KNeighborsClassifier(min(5, shape[0]), metric="cosine")
