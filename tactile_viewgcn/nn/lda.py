"""Principal components and linear discriminant analysis of single frames."""

from typing import Any

from tactile_viewgcn.nn.frame_estimator import FrameEstimator

COMPONENTS = 50


class LDA(FrameEstimator):
    """Fifty principal components, or as many as there are, then linear discriminant analysis."""

    def estimator(self, seed: int, shape: tuple[int, int]) -> Any:
        from sklearn.decomposition import PCA
        from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
        from sklearn.pipeline import make_pipeline

        frames, sensors = shape
        components = min(COMPONENTS, frames - 1, sensors)
        return make_pipeline(PCA(components, random_state=seed), LinearDiscriminantAnalysis())
