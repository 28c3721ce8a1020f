"""The exception for mistakes that a user can correct."""


class UserError(ValueError):
    """Wrong data, parameters or surroundings: the message names what was found, what is expected and the remedy.

    Commands print it in one line and exit with 1; any other exception is a fault and keeps its traceback.
    """
