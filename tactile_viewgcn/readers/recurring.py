"""Words and numbers that recur in the names of files: are they persons or days, which a split must not mix?"""

import re
from collections import Counter
from collections.abc import Sequence

from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.readers.layout import PART, PIECE, without_copy
from tactile_viewgcn.readers.source import SIDE, setting

#: Words for a recording of several, maybe with its number.
REPEATS = r"(?i:trial|rep|repetition|rec|recording|run|take|try|grasp|grip|sample|file|no|nr|num|idx|t|r|n)\d*"
#: Words for a person or a day with a number; and names of letters alone.
PERSON = r"(?i:(s|sub|subj|subject|p|pers|person|participant|user|volunteer|vp|d|day|session|sess)\d+)|\d{4}-?\d\d-?\d\d"
NAME = r"[^\W\d_]{2,}"
MOSTLY = 0.5  # of the pairs of a word and an object that have several files


def session_notes(
    places: Sequence[str], objects: Sequence[str | None], layout: str, *, has_labels: bool
) -> list[Note]:
    """Warnings of parts of files' names that may be persons or days, with the layout that says so.

    A name's parts stand between marks, equally many in all names. Such a part recurs: with several
    objects, and with several files of one object; or it is the whole name and looks like one of a
    person or a day. What has one file an object is else the number of the recording. Whether a part
    is a person cannot be known; the note asks.

    Args:
        places: of the files, see `place_of`.
        objects: of each file.
        layout: of the places, without a SESSION.
        has_labels: the objects stand in a labels.csv.
    """
    names = [without_copy(place.rpartition("/")[2]) for place in places]
    mark, parts = _parted(names)
    last = len(parts) - 1
    is_in_folder = layout.endswith("/FILE") or has_labels
    is_flat = not has_labels and bool(mark) and layout.rpartition("/")[2] == f"OBJECT{mark}FILE"
    if None in objects or not (is_in_folder or is_flat):
        return []
    of_parts = [part for part in range(len(parts)) if all(map(_is_hand_or_piece, parts[part]))]
    whole = [part for part in range(len(parts)) if part not in of_parts]
    if not whole:
        return []
    # files of one recording once
    rows = dict.fromkeys(zip(objects, *(parts[part] for part in whole), strict=True))
    objects, *columns = zip(*rows, strict=True)
    parts = [[""]] * len(parts)
    for part, column in zip(whole, columns, strict=True):
        parts[part] = list(column)
    recurring = list[int]()
    for part, texts in enumerate(parts):
        others: Sequence[object] = objects
        if is_flat:  # what is called the object holds the part itself
            others = list(zip(*(parts[at] for at in whole if at not in (part, last)), strict=True))
        is_candidate = part in whole and (part < last or not is_flat)
        if is_candidate and others and _recurs(texts, others, is_whole_name=last == 0):
            recurring.append(part)
    recurring = [part for part in recurring if not all(map(_is_no_person, parts[part]))]
    # the numbers begin anew on each side
    if any(all(map(_is_side, parts[part])) for part in whole):
        recurring = [part for part in recurring if not all(text.isdigit() for text in parts[part])]
    if is_flat:  # of two words, one with numbers is rather a person
        likely = [part for part in recurring if all(re.search(r"\d", text) for text in parts[part])]
    else:
        likely = [part for part in recurring if not all(text.isdigit() for text in parts[part])]
    notes = list[Note]()
    for part in likely or recurring:
        found = sorted(set(parts[part]))
        text = f"{several(len(found), 'word')} recur in the names of files of several objects: {listed(found)}. "
        text += "A split by recording mixes them. If they are persons or days, "
        text += _remedy(parts, part, mark, layout, is_flat=is_flat, has_labels=has_labels)
        notes.append(Note(f"{text}.", "warning", "names"))
    return notes


def _parted(names: list[str]) -> tuple[str, list[list[str]]]:
    """The mark that parts all names equally often, and for each part its texts in all names.

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


def _recurs(texts: Sequence[str], objects: Sequence[object], *, is_whole_name: bool) -> bool:
    """Whether each text of a part is with several objects, and mostly with several files of each."""
    files = Counter(zip(texts, objects, strict=True))
    objects_of = Counter(text for text, _ in files)
    if len(objects_of) < 2 or min(objects_of.values()) < 2:
        return False
    if is_whole_name:
        return all(re.fullmatch(f"{PERSON}|{NAME}", text) for text in texts)
    several_files = [count > 1 for count in files.values()]
    return sum(several_files) > MOSTLY * len(several_files)


def _is_hand_or_piece(text: str) -> bool:
    return re.fullmatch(f"{PART}|{PIECE}", text) is not None


def _is_no_person(text: str) -> bool:
    return re.fullmatch(REPEATS, text) is not None or _is_side(text)


def _is_side(text: str) -> bool:
    """Whether a part of a name is a side of a split, such as `train`."""
    return SIDE.fullmatch(text.lower()) is not None


def _remedy(
    parts: list[list[str]], part: int, mark: str, layout: str, *, is_flat: bool, has_labels: bool
) -> str:
    """What to type, so that a part of the names is the session."""
    last = len(parts) - 1
    if has_labels:
        return "add them to labels.csv as a column `session`"
    if not mark and last:
        example = "_".join(texts[0] for texts in parts)
        return f"rename the files with a mark between, as {example}, and {setting('data.layout=OBJECT/SESSION_FILE')}"
    pattern = ""
    if is_flat and part == 0:
        pattern = layout.replace("OBJECT", f"SESSION{mark}OBJECT")
    elif is_flat and part == last - 1:
        pattern = layout.replace("OBJECT", f"OBJECT{mark}SESSION")
    elif not is_flat and last == 0:
        pattern = layout.replace("FILE", "SESSION")
    elif not is_flat and part == 0:
        pattern = layout.replace("FILE", f"SESSION{mark}FILE")
    elif not is_flat and part == last:
        pattern = layout.replace("FILE", f"FILE{mark}SESSION")
    if pattern:
        return setting(f"data.layout={pattern}")
    return "sort the files into folders: SESSION/OBJECT/FILE"
