"""Names of the systems that `model.system` chooses from, each a file here, and of the members of `sensors`."""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from tactile_viewgcn.nn.system import ViewSystem

# all but sensors are networks on the pretrained backbone
System = Literal[
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
    "sensors",
]
Member = Literal[  # of sensors; one may be alone
    "trees",
    "logistic",
    "kernel",
    "kernel_log",
    "svm",
    "svm_log",
    "max_logistic",
    "max_kernel",
    "max_kernel_log",
    "max_kernel_cosine",
    "max_svm",
    "max_svm_log",
    "max_network",
    "statistics_trees",
    "statistics_svm",
]


def on_sensors(name: str) -> bool:
    """Whether the system reads the sensors, so that no backbone is pretrained for it."""
    return name == "sensors"


def load_system(name: str) -> ModuleType:
    """The file of systems/ that `model.system` names; no other system's code is loaded."""
    return import_module(f"tactile_viewgcn.systems.{name}")


def system_class(name: str) -> "type[ViewSystem]":
    """The class of a system on the backbone."""
    from tactile_viewgcn.nn.system import ViewSystem

    module = load_system(name)
    defined = (value for value in vars(module).values() if getattr(value, "__module__", "") == module.__name__)
    return next(value for value in defined if isinstance(value, type) and issubclass(value, ViewSystem))
