"""Words that recur in the names of files: are they persons or days, which a split must not mix?"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.readers.layout import PART, PIECE, without_copy
from tactile_viewgcn.readers.source import SIDE, setting

#: Words for a recording of several, maybe with its number.
REPEATS = (
    r"(?i:trial|rep|repetition|rec|recording|run|take|try|grasp|grip|sample|file|no|nr|num|idx"
    r"|t|r|n)\d*"
)
#: Words for a person or a day with a number.
PERSON = (
    r"(?i:(s|sub|subj|subject|p|pers|person|participant|user|volunteer|vp|d|day|session|sess)\d+)"
    r"|\d{4}-?\d\d-?\d\d"
)
NAME = r"[^\W\d_]{2,}"  # of letters only
MOSTLY = 0.5  # of the pairs of a word and an object that have several files


@dataclass(frozen=True)
class _Names:
    """The parts of the names of all files.

    Attributes:
        objects: of each file.
        mark: between the parts; "" where letters and numbers alternate.
        parts: for each part its texts in all names.
        whole: indices of the parts that are no hand and no piece of a recording.
        is_flat: the files' names begin with their objects.
    """

    objects: Sequence[object]
    mark: str
    parts: list[list[str]]
    whole: list[int]
    is_flat: bool

    @property
    def last(self) -> int:
        """Index of the last part."""
        return len(self.parts) - 1


def session_notes(
    places: Sequence[str], objects: Sequence[str | None], layout: str, *, has_labels: bool
) -> list[Note]:
    """Return warnings of parts of files' names that may be persons or days.

    A name's parts stand between marks, equally many in all names. Such a part recurs: with several
    objects, and with several files of one object; or it is the whole name and looks like one of a
    person or a day. A part with one file for each object is the number of the recording. Whether a
    part is a person cannot be known; the note asks.

    Args:
        places: of the files, see `place_of`.
        objects: of each file.
        layout: of the places, without a SESSION.
        has_labels: the objects stand in a labels.csv.
    """
    mark, parts = _parted([without_copy(place.rpartition("/")[2]) for place in places])
    is_in_folder = layout.endswith("/FILE") or has_labels
    flat_layout = f"OBJECT{mark}FILE"
    is_flat = not has_labels and bool(mark) and layout.rpartition("/")[2] == flat_layout
    if None in objects or not (is_in_folder or is_flat):
        return []
    whole = [part for part, texts in enumerate(parts) if not all(map(_is_hand_or_piece, texts))]
    if not whole:
        return []
    names = _once_each(_Names(objects, mark, parts, whole, is_flat))
    notes = list[Note]()
    for part in _likely(names, _recurring(names)):
        words = sorted(set(names.parts[part]))
        text = f"{several(len(words), 'word')} recur in the names of files of several objects: "
        text += f"{listed(words)}. A split by recording mixes them. If they are persons or days, "
        text += f"{_remedy(names, part, layout, has_labels=has_labels)}."
        notes.append(Note(text, "warning", "names"))
    return notes


def _parted(names: list[str]) -> tuple[str, list[list[str]]]:
    """Return the mark that parts all names equally often, and for each part its texts in all names.

    Without a mark the parts are letters with a number after them, as in S01T03; else the names
    themselves.
    """
    for mark in "_- .":
        counts = {name.count(mark) for name in names}
        if len(counts) == 1 and counts != {0}:
            return mark, _columns([name.split(mark) for name in names])
    words = [re.findall(r"[A-Za-z]+\d+", name) for name in names]
    are_all = all("".join(found) == name for found, name in zip(words, names, strict=True))
    if are_all and len({len(found) for found in words}) == 1:
        return "", _columns(words)
    return "", [names]


def _columns(rows: list[list[str]]) -> list[list[str]]:
    return [list(column) for column in zip(*rows, strict=True)]


def _once_each(names: _Names) -> _Names:
    """Return names in which the files of one recording, as of two hands, are there once."""
    columns = [names.parts[part] for part in names.whole]
    rows = dict.fromkeys(zip(names.objects, *columns, strict=True))
    objects, *texts = zip(*rows, strict=True)
    parts = [[""]] * len(names.parts)
    for part, column in zip(names.whole, texts, strict=True):
        parts[part] = [str(text) for text in column]
    return replace(names, objects=objects, parts=parts)


def _recurring(names: _Names) -> list[int]:
    """Return the parts that recur, but for words that are no persons."""
    recurring = list[int]()
    for part in names.whole:
        if names.is_flat and part == names.last:  # the number of the recording
            continue
        others = names.objects
        if names.is_flat:  # the object's name holds the part itself
            others = _other_texts(names, part)
        is_whole_name = names.last == 0
        if others and _recurs(names.parts[part], others, is_whole_name=is_whole_name):
            recurring.append(part)
    return [part for part in recurring if not all(map(_is_no_person, names.parts[part]))]


def _other_texts(names: _Names, part: int) -> Sequence[object]:
    """Return the texts of the parts of each name, without one part and the last one."""
    others = [names.parts[other] for other in names.whole if other not in (part, names.last)]
    return list(zip(*others, strict=True))


def _recurs(texts: Sequence[str], objects: Sequence[object], *, is_whole_name: bool) -> bool:
    """Return whether each text of a part is with several objects, and mostly with several files."""
    files = Counter(zip(texts, objects, strict=True))
    objects_of = Counter(text for text, _ in files)
    if len(objects_of) < 2 or min(objects_of.values()) < 2:
        return False
    if is_whole_name:
        return all(re.fullmatch(f"{PERSON}|{NAME}", text) for text in texts)
    have_several = [count > 1 for count in files.values()]
    return sum(have_several) > MOSTLY * len(have_several)


def _likely(names: _Names, recurring: list[int]) -> list[int]:
    """Return those of the recurring parts that are likely persons; all where none is.

    Of two words, one with numbers is rather a person. In folders of objects, numbers without
    letters are rather recordings.
    """
    has_sides = any(all(map(_is_side, names.parts[part])) for part in names.whole)
    if has_sides:  # the numbers begin anew in each published set
        recurring = [part for part in recurring if not _are_numbers(names.parts[part])]
    if names.is_flat:
        likely = [part for part in recurring if _have_digits(names.parts[part])]
    else:
        likely = [part for part in recurring if not _are_numbers(names.parts[part])]
    return likely or recurring


def _are_numbers(texts: Sequence[str]) -> bool:
    return all(text.isdigit() for text in texts)


def _have_digits(texts: Sequence[str]) -> bool:
    return all(re.search(r"\d", text) for text in texts)


def _is_hand_or_piece(text: str) -> bool:
    return re.fullmatch(f"{PART}|{PIECE}", text) is not None


def _is_no_person(text: str) -> bool:
    return re.fullmatch(REPEATS, text) is not None or _is_side(text)


def _is_side(text: str) -> bool:
    """Return whether a part of a name is a published set, such as `train`."""
    return SIDE.fullmatch(text.lower()) is not None


def _remedy(names: _Names, part: int, layout: str, *, has_labels: bool) -> str:
    """Return what to type, so that a part of the names is the session."""
    if has_labels:
        return "add them to labels.csv as a column `session`"
    if not names.mark and names.last:
        example = "_".join(texts[0] for texts in names.parts)
        remedy = setting("data.layout=OBJECT/SESSION_FILE")
        return f"rename the files with a mark between, as {example}, and {remedy}"
    pattern = _layout_with_session(names, part, layout)
    if pattern:
        return setting(f"data.layout={pattern}")
    return "sort the files into folders: SESSION/OBJECT/FILE"


def _layout_with_session(names: _Names, part: int, layout: str) -> str:
    """Return a layout in which a part of the names is the session; "" where none can say it."""
    mark = names.mark
    if names.is_flat:
        if part == 0:
            return layout.replace("OBJECT", f"SESSION{mark}OBJECT")
        if part == names.last - 1:
            return layout.replace("OBJECT", f"OBJECT{mark}SESSION")
        return ""
    if names.last == 0:
        return layout.replace("FILE", "SESSION")
    if part == 0:
        return layout.replace("FILE", f"SESSION{mark}FILE")
    if part == names.last:
        return layout.replace("FILE", f"FILE{mark}SESSION")
    return ""
