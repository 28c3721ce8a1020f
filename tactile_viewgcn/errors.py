"""The exception for mistakes that a user can correct, and the line that ends a program."""

import sys

from tactile_viewgcn.names import shown


class UserError(ValueError):
    """Wrong data, parameters or surroundings: the message names what was found, what is expected and the remedy.

    Commands print it in one line and exit with 1; any other exception is a fault of the program and keeps its
    traceback. Control characters in the message are escaped, see `shown`.
    """

    def __init__(self, message: str):
        super().__init__(shown(message))


def user_message(error: Exception) -> str | None:
    """The line for a user who can correct an error; None for a fault of the program, which keeps its traceback."""
    text = shown(" ".join(str(error).split()))
    if isinstance(error, UserError | OSError):
        return text
    if isinstance(error, ModuleNotFoundError) and str(error.name).partition(".")[0] in ("dvc", "mlflow"):
        return f"{text}; pip install 'tactile-viewgcn[pipeline]'"
    torch = sys.modules.get("torch")  # a program without torch does not meet its errors
    memory = isinstance(error, MemoryError) or "DefaultCPUAllocator: can't allocate memory" in text
    if memory or (torch and isinstance(error, torch.OutOfMemoryError)):
        return f"out of memory; lower `batch` or model.backbone.width, or close other programs ({text})"
    return None
