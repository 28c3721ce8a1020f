"""The systems that `model.system` chooses from, a file each, and the code that loads the chosen one alone."""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_viewgcn.nn.system import ViewSystem


def load_system(name: str) -> ModuleType:
    """The file of systems/ that `model.system` names; no other system's code is loaded."""
    return import_module(f"tactile_viewgcn.systems.{name}")


def system_class(name: str) -> "type[ViewSystem]":
    """The class of a system on the backbone."""
    from tactile_viewgcn.nn.system import ViewSystem

    module = load_system(name)
    defined = (
        value
        for value in vars(module).values()
        if getattr(value, "__module__", "") == module.__name__
    )
    return next(
        value for value in defined if isinstance(value, type) and issubclass(value, ViewSystem)
    )
