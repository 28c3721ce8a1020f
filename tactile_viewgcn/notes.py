"""Remarks on a result: programs read their fields, people their text."""

from dataclasses import dataclass
from typing import Any, Literal

from tactile_viewgcn.names import shown


@dataclass(frozen=True)
class Note:
    """A remark on a result.

    Attributes:
        text: a sentence for people; no program parses it.
        level: `info`, a `choice` that `auto` made, or a `warning`.
        topic: the subject in a word or two, such as `baseline`, `filter`, `split`, `leak check`.
        key, value: a key of params.yaml with the chosen value, or the remedy of a warning; else the key is empty.
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
            value = f"{self.value:g}" if isinstance(self.value, float) else str(self.value).replace("'", "")
            return shown(f"{self.key} {value}: {self.text}")
        warning = "warning: " if self.level == "warning" else ""
        return shown(f"{warning}{self.topic and f'{self.topic}: '}{self.text}")


def warnings_of(notes: list[Note]) -> list[Note]:
    """The warnings among notes."""
    return [note for note in notes if note.level == "warning"]


def several(count: int, thing: str, things: str = "") -> str:
    """`1 frame`, `1,701 frames`; `things` is a plural that does not end in s."""
    return f"{count:,} {thing if count == 1 else things or f'{thing}s'}"
