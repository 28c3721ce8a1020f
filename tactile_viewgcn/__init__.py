"""Recognises the object in a hand from several frames of a tactile glove."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactile_viewgcn.recognition.estimator import TactileClassifier

__all__ = ["TactileClassifier"]


def __getattr__(name: str) -> Any:
    """Return `TactileClassifier`, which is imported at its first use.

    Hence commands that do without it do not load scikit-learn.
    """
    if name == "TactileClassifier":
        from tactile_viewgcn.recognition.estimator import TactileClassifier

        return TactileClassifier
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
