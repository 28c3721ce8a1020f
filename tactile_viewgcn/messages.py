"""Texts for people: harmless names, the exception for a user's mistakes, notes on results.

Names of objects, recordings, sessions and paths can come from anybody. Tables and model files keep
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
from os.path import commonpath, relpath
from pathlib import Path
from typing import Any, Literal

EMPTY_HAND = "empty_hand"  # STAG's name of the class that holds nothing
NEW_SESSION = "a new session (a person, a day, a new fitting)"
MAX_LISTED = 10  # mistakes or names in one message
CPU_MEMORY = "DefaultCPUAllocator: can't allocate memory"  # text of torch's RuntimeError
FORMULA = ("=", "+", "-", "@", "＝", "＋", "－", "＠")  # beginnings of a formula, from OWASP


def shown(text: object) -> str:
    r"""Return a text for a terminal, a picture or a page, without control characters.

    Control and formatting characters are escaped: for example \x1b, \n or \u202e.

    Args:
        text: anything that `str` takes.
    """
    text = str(text)
    if text.isprintable():
        return text
    return "".join(map(_shown, text))


def _shown(letter: str) -> str:
    is_joiner = letter in "\u200c\u200d"  # used in Persian and Hindi
    is_space = unicodedata.category(letter) == "Zs"  # such as the space in 47.3 %
    is_harmless = is_joiner or is_space
    if letter.isprintable() or is_harmless:
        return letter
    return letter.encode("unicode_escape").decode()


def csv_text(rows: Iterable[Iterable[Any]]) -> str:
    """Return rows as CSV, in which a spreadsheet runs no text as a formula.

    Args:
        rows: cells by row. A text is `shown`; if it begins like a formula, an apostrophe comes
            first.
    """
    file = StringIO(newline="")
    writer = csv.writer(file)
    for row in rows:
        writer.writerow(map(_cell, row))
    return file.getvalue()


def _cell(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    if value.startswith(FORMULA):
        return "'" + shown(value)
    return shown(value)


class UserError(ValueError):
    """A mistake in data, parameters or surroundings that the user can correct.

    The message says what was found, what is expected, and what to do. Commands print it in one line
    and exit with 1. Any other exception is a fault of the program and keeps its traceback. Control
    characters in the message are escaped, see `shown`.
    """

    def __init__(self, message: str):
        super().__init__(shown(message))


def user_message(error: Exception) -> str | None:
    """Return the line for a user who can correct an error.

    Args:
        error: any exception.

    Returns:
        The line; None if the error is a fault of the program, which keeps its traceback.
    """
    text = shown(" ".join(str(error).split()))
    if isinstance(error, UserError | OSError):
        return text
    if _is_missing_extra(error):
        return f"{text}; pip install 'tactile-viewgcn[pipeline]'"
    if _is_out_of_memory(error):
        return (
            "out of memory; lower `batch` or model.backbone.width, or close other programs "
            f"({text})"
        )
    return None


def _is_missing_extra(error: Exception) -> bool:
    """Return whether a package of the extra `pipeline` is not installed."""
    if not isinstance(error, ModuleNotFoundError):
        return False
    package = str(error.name).partition(".")[0]
    return package in ("dvc", "mlflow")


def _is_out_of_memory(error: Exception) -> bool:
    """Return whether an exception of Python or torch says that there is not enough memory."""
    if isinstance(error, MemoryError) or CPU_MEMORY in str(error):
        return True
    torch = sys.modules.get("torch")  # a program that did not load torch gets no error of torch
    return torch is not None and isinstance(error, torch.OutOfMemoryError)


@contextmanager
def program(*, debug: bool = False) -> Iterator[None]:
    """Run a whole program, and print an error that the user can correct in one line.

    Such an error ends the program with exit code 1. SIGTERM, which `dvc queue kill` sends, ends it
    with exit code 143; it does so by an exception, so that temporary files are removed.

    Args:
        debug: whether such an error keeps its traceback.

    Raises:
        SystemExit: after an error that the user can correct.
    """
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        yield
    except Exception as error:
        message = user_message(error)
        if debug or message is None:
            raise
        # the process is ending, and has to print the reason first
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
        key, value: a key of params.yaml, and the value that was chosen or that a warning
            recommends. The key is empty if the note is about no parameter.
        stage: the stage that made the note; empty outside the stages.
    """

    text: str
    level: Literal["info", "choice", "warning"] = "info"
    topic: str = ""
    key: str = ""
    value: Any = None
    stage: str = ""

    def __str__(self) -> str:
        """Return the line for a terminal; a choice begins with its key and its value."""
        if self.level == "choice":
            return shown(f"{self.key} {self._value_in_words()}: {self.text}")
        text = self.text
        if self.topic:
            text = f"{self.topic}: {text}"
        if self.level == "warning":
            text = f"warning: {text}"
        return shown(text)

    def _value_in_words(self) -> str:
        if isinstance(self.value, float):
            return f"{self.value:g}"
        return str(self.value).replace("'", "")


def warnings_of(notes: list[Note]) -> list[Note]:
    """Return the warnings among notes."""
    return [note for note in notes if note.level == "warning"]


def several(count: int, thing: str, things: str = "") -> str:
    """Return a number of things in words, such as `1 frame` or `1,701 frames`.

    Args:
        count: the number.
        thing: the singular.
        things: the plural, if it is not the singular with an s.
    """
    if count == 1:
        return f"{count:,} {thing}"
    return f"{count:,} {things or f'{thing}s'}"


def once_each(texts: Iterable[tuple[Path, str]]) -> list[str]:
    """Return texts on files, where similar texts are given only once.

    Texts are similar if they differ only in the file's path and in numbers. The first of them is
    given, and the other files follow it, each by its path from the folder that all have in common.

    Args:
        texts: pairs of a file and a text on it.
    """
    alike = dict[str, list[tuple[Path, str]]]()
    for file, text in texts:
        key = re.sub(r"\d+", "0", text.replace(shown(file), ""))
        alike.setdefault(key, []).append((file, text))
    sentences = list[str]()
    for (first, example), *others in alike.values():
        more = ""
        if others:
            files = [file for file, _ in others]
            common = common_folder([first, *files])
            names = [relpath(file, common) for file in files]
            more = f" (the same in {several(len(names), 'more file')}: {listed(names)})"
        sentences.append(f"{example}{more}")
    return sentences


def common_folder(files: Iterable[Path]) -> Path:
    """Return the folder that holds all files; it is absolute if one of them has such a path."""
    folders = [file.parent for file in files]
    if any(folder.is_absolute() for folder in folders):
        folders = [folder.absolute() for folder in folders]
    return Path(commonpath(folders))


def listed(texts: list[str], mark: str = ", ") -> str:
    """Return the first ten texts in one text, and the number of the other texts.

    Args:
        texts: the texts.
        mark: separates two texts.
    """
    shortened = texts[:MAX_LISTED]
    if len(texts) > MAX_LISTED:
        shortened = [*shortened, f"and {len(texts) - MAX_LISTED} more"]
    return mark.join(shortened)
