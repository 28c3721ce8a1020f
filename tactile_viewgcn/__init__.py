"""Recognising what a hand holds from several frames of a tactile glove, with a view-graph network."""

from typing import Any

__all__ = ["TactileClassifier"]


def __getattr__(name: str) -> Any:
    """`TactileClassifier`, imported when it is asked for: a command that does not use it loads no scikit-learn."""
    if name == "TactileClassifier":
        from tactile_viewgcn.recognition.estimator import TactileClassifier

        return TactileClassifier
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
