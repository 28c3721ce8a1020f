"""Texts for people: names from outside made harmless, the exception for a user's mistakes, notes on results.

Names of objects, recordings, sessions and paths may come from anybody. Tables and model files keep
them unchanged.
"""

import csv
import re
import signal
import sys
import unicodedata
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any, Literal

EMPTY_HAND = "empty_hand"  # STAG's name of the class that holds nothing
NEW_SESSION = "a new session (a person, a day, a new fitting)"
MAX_LISTED = 10  # mistakes or names in one message
FORMULA = ("=", "+", "-", "@", "＝", "＋", "－", "＠")  # beginnings of a formula, after OWASP


def shown(text: object) -> str:
    r"""A text for a terminal, a picture or a page, with control and formatting characters as \x1b, \n or \u202e."""
    text = str(text)
    return text if text.isprintable() else "".join(map(_shown, text))


def _shown(letter: str) -> str:
    joins = letter in "\u200c\u200d"  # used in Persian and Hindi
    # spaces, as the one in 47.3 %
    plain = letter.isprintable() or joins or unicodedata.category(letter) == "Zs"
    return letter if plain else letter.encode("unicode_escape").decode()


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Rows as CSV; a text is `shown`, with an apostrophe before it where a spreadsheet would run it."""
    csv.writer(file := StringIO(newline="")).writerows(
        [_cell(value) for value in row] for row in rows
    )
    return file.getvalue()


def _cell(value: Any) -> Any:
    return "'" * value.startswith(FORMULA) + shown(value) if isinstance(value, str) else value


class UserError(ValueError):
    """Wrong data, parameters or surroundings: the message names what was found, what is expected and the remedy.

    Commands print it in one line and exit with 1; any other exception is a fault of the program and
    keeps its traceback. Control characters in the message are escaped, see `shown`.
    """

    def __init__(self, message: str):
        super().__init__(shown(message))


def user_message(error: Exception) -> str | None:
    """The line for a user who can correct an error; None for a fault of the program, which keeps its traceback."""
    text = shown(" ".join(str(error).split()))
    if isinstance(error, UserError | OSError):
        return text
    if isinstance(error, ModuleNotFoundError) and str(error.name).partition(".")[0] in (
        "dvc",
        "mlflow",
    ):
        return f"{text}; pip install 'tactile-viewgcn[pipeline]'"
    torch = sys.modules.get("torch")  # a program without torch does not meet its errors
    memory = isinstance(error, MemoryError) or "DefaultCPUAllocator: can't allocate memory" in text
    if memory or (torch and isinstance(error, torch.OutOfMemoryError)):
        return f"out of memory; lower `batch` or model.backbone.width, or close other programs ({text})"
    return None


@contextmanager
def program(*, debug: bool = False) -> Iterator[None]:
    """Context of a whole program: an error that the user can correct ends it with exit code 1 and one line.

    SIGTERM, which `dvc queue kill` sends, ends it with code 143, as an exception, so that temporary
    files are removed.

    Args:
        debug: such an error keeps its traceback too.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        yield
    except Exception as error:
        message = user_message(error)
        if debug or message is None:
            raise
        # the process ends already, and has to print why
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        print(f"Error: {message}", file=sys.stderr)
        raise SystemExit(1) from None


@dataclass(frozen=True)
class Note:
    """A remark on a result.

    Attributes:
        text: a sentence for people; no program parses it.
        level: `info`, a `choice` that `auto` made, or a `warning`.
        topic: the subject in a word or two, such as `baseline`, `filter`, `split`, `leak check`.
        key, value: a key of params.yaml with the chosen value, or the remedy of a warning; else the
            key is empty.
        stage: the stage that made the note; empty outside the stages.
    """

    text: str
    level: Literal["info", "choice", "warning"] = "info"
    topic: str = ""
    key: str = ""
    value: Any = None
    stage: str = ""

    def __str__(self) -> str:
        """The line for a terminal; that of a choice begins with key and value."""
        if self.level == "choice":
            value = (
                f"{self.value:g}"
                if isinstance(self.value, float)
                else str(self.value).replace("'", "")
            )
            return shown(f"{self.key} {value}: {self.text}")
        warning = "warning: " if self.level == "warning" else ""
        return shown(f"{warning}{self.topic and f'{self.topic}: '}{self.text}")


def warnings_of(notes: list[Note]) -> list[Note]:
    """The warnings among notes."""
    return [note for note in notes if note.level == "warning"]


def several(count: int, thing: str, things: str = "") -> str:
    """`1 frame`, `1,701 frames`; `things` is a plural that does not end in s."""
    return f"{count:,} {thing if count == 1 else things or f'{thing}s'}"


def once_each(texts: Iterable[tuple[Path, str]]) -> list[str]:
    """The texts that come with files; those that are equal but for the file's path and for numbers stand once.

    The first text is the example, and the names of the other files follow it.
    """
    alike = dict[str, list[tuple[Path, str]]]()
    for file, text in texts:
        key = re.sub(r"\d+", "0", text.replace(shown(file), ""))
        alike.setdefault(key, []).append((file, text))
    sentences = list[str]()
    for (_, example), *others in alike.values():
        more = ""
        if others:
            names = [file.name for file, _ in others]
            more = f" (the same in {several(len(names), 'more file')}: {listed(names)})"
        sentences.append(f"{example}{more}")
    return sentences


def listed(texts: list[str], mark: str = ", ") -> str:
    """The first ten texts, and the number of the others."""
    more = [f"and {len(texts) - MAX_LISTED} more"] if len(texts) > MAX_LISTED else []
    return mark.join(texts[:MAX_LISTED] + more)
