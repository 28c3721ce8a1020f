"""The systems that `model.system` chooses from, one file each; only the chosen file is loaded."""

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_viewgcn.nn.system import ViewSystem


def load_system(name: str) -> ModuleType:
    """Load and return the file of systems/ that `model.system` names, and no other."""
    return import_module(f"tactile_viewgcn.systems.{name}")


def system_class(name: str) -> "type[ViewSystem]":
    """Return the class of a system on the backbone: the only one that its file defines.

    Args:
        name: a value of `model.system`.

    Raises:
        LookupError: the file defines no such class.
    """
    from tactile_viewgcn.nn.system import ViewSystem

    module = load_system(name)
    for value in vars(module).values():
        is_system = isinstance(value, type) and issubclass(value, ViewSystem)
        if is_system and value.__module__ == module.__name__:
            system: type[ViewSystem] = value
            return system
    raise LookupError(f"{module.__name__} defines no system on the backbone")
