"""Names of the systems that `model.system` chooses from, by what they read; each is the file of that name in nn/."""

from importlib import import_module
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from tactile_viewgcn.nn.system import ViewSystem

OnBackbone = Literal[  # features or feature maps of the pretrained backbone
    "view_gcn",
    "stag",
    "cnn_lstm",
    "conv_lstm",
    "mvcnn",
    "mean",
    "gvcnn",
    "rotationnet",
    "gcn",
    "vote",
]
Member = Literal[
    "trees", "logistic", "knn", "lda", "kernel", "max_logistic", "max_kernel", "max_network"
]  # of an ensemble
OnSensors = Literal[Member, "ensemble"]  # the sensors themselves: nothing is pretrained for them
System = Literal[OnBackbone, OnSensors]


def system_class(name: str) -> "type[ViewSystem]":
    """The class of the system in the file of systems/ that `model.system` names; no other system's code is loaded."""
    from tactile_viewgcn.nn.system import ViewSystem

    module = import_module(f"tactile_viewgcn.systems.{name}")
    defined = (value for value in vars(module).values() if getattr(value, "__module__", "") == module.__name__)
    return next(value for value in defined if isinstance(value, type) and issubclass(value, ViewSystem))
