"""Names of objects, recordings, sessions and paths, which may come from anybody: escaped for terminals, pages and CSV.

They are stored unchanged.
"""

import csv
import unicodedata
from collections.abc import Iterable
from typing import Any, TextIO

EMPTY_HAND = "empty_hand"  # STAG's name of the class that holds nothing
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠")  # beginnings of a formula, after OWASP


def shown(text: object) -> str:
    r"""A text for a terminal, a picture or a page, with control and formatting characters as \x1b, \n or \u202e."""
    text = str(text)
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(letter: str) -> str:
    joins = letter in "\u200c\u200d"  # used in Persian and Hindi
    plain = letter.isprintable() or joins or unicodedata.category(letter) == "Zs"  # spaces, as the one in 47.3 %
    return letter if plain else letter.encode("unicode_escape").decode()


def write_csv(file: TextIO, rows: Iterable[Iterable[Any]]) -> None:
    """Write rows as CSV; a text that a spreadsheet would run as a formula gets an apostrophe before it."""
    csv.writer(file).writerows([_cell(value) for value in row] for row in rows)


def _cell(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value
