"""Old name of `tests.glove_data`."""

from tests.glove_data import *  # noqa: F403
