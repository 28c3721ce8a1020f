"""Extremely randomised trees (Geurts et al. 2006) on single frames."""

from typing import Any

from tactile_viewgcn.nn.frame_estimator import FrameEstimator


class Trees(FrameEstimator):
    """500 trees, fully grown."""

    def estimator(self, seed: int, shape: tuple[int, int]) -> Any:
        from sklearn.ensemble import ExtraTreesClassifier

        return ExtraTreesClassifier(500, random_state=seed)
