"""What every reader gives: names that the table can keep."""

from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.readers.source import Source


@pytest.mark.parametrize(
    ("objects", "expected"),
    [
        (["mug", "pen", "mug"], "glove: two objects are named 'mug'; expected each name once"),
        (["mug", "p\0n"], r"glove: the name of object 'p\\x00n' is no text"),
        (["mug", "p\udcffn"], r"glove: the name of object 'p\\udcffn' is no text"),
        (["mug", "p" * 100_000], "glove: the name of object 'p+' is no text"),
    ],
)
def test_names_are_texts_and_those_of_objects_differ(objects, expected):
    with pytest.raises(UserError, match=expected):
        Source(Path("glove"), objects, ["1"], ["monday"], (2, 2), np.dtype("int16"), 0, iter(()))


def test_recordings_of_two_objects_may_have_one_name():
    Source(Path("glove"), ["mug", "pen"], ["1", "1"], ["monday"], (2, 2), np.dtype("int16"), 0, iter(()))
