"""The exception for mistakes that a user can correct."""

from tactile_viewgcn.names import shown


class UserError(ValueError):
    """Wrong data, parameters or surroundings: the message names what was found, what is expected and the remedy.

    Commands print it in one line and exit with 1; any other exception is a fault and keeps its traceback. Names in the
    message are shown, see `shown`.
    """

    def __init__(self, message: str):
        super().__init__(shown(message))
