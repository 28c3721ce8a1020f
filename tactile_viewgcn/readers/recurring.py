"""Find words and numbers that recur in the names of files, and so can be persons or days.

A split must not mix persons or days.
"""

import re
from collections import Counter
from collections.abc import Sequence

from tactile_viewgcn.messages import Note, listed, several
from tactile_viewgcn.readers.layout import PART, PIECE, without_copy
from tactile_viewgcn.readers.source import SIDE, setting

#: Words for one of several recordings; a number can follow.
REPEATS = (
    r"(?i:trial|rep|repetition|rec|recording|run|take|try|grasp|grip|sample|file"
    r"|no|nr|num|idx|t|r|n)\d*"
)
#: Words for a person or a day with their number, and dates.
PERSON = (
    r"(?i:(s|sub|subj|subject|p|pers|person|participant|user|volunteer|vp|d|day|session|sess)\d+)"
    r"|\d{4}-?\d\d-?\d\d"
)
#: Names that consist of letters.
NAME = r"[^\W\d_]{2,}"
# more than this share of the pairs of a word and an object must have several files
REPEATED_SHARE = 0.5


def session_notes(
    places: Sequence[str], objects: Sequence[str | None], layout: str, *, has_labels: bool
) -> list[Note]:
    """Return warnings of parts of files' names that can be persons or days.

    The parts of a name stand between marks, and all names have equally many parts. A part can be a
    person or a day if its texts recur: with several objects, and in several files of one object.
    Or it is the whole name, and looks like the name of a person or a day. A part with one file for
    each object is more likely the number of the recording. Nobody can tell from the names whether a
    part is a person, so the warning gives the layout to set if it is.

    Args:
        places: the places of the files, see `place_of`.
        objects: the object of each file.
        layout: the layout of the places, without a SESSION.
        has_labels: whether the objects stand in a labels.csv.
    """
    mark, parts = _parted([without_copy(place.rpartition("/")[2]) for place in places])
    is_in_folder = layout.endswith("/FILE") or has_labels
    begins_with_object = layout.rpartition("/")[2] == f"OBJECT{mark}FILE"
    is_flat = bool(mark) and begins_with_object and not has_labels
    if None in objects or not (is_in_folder or is_flat):
        return []
    named = [part for part, texts in enumerate(parts) if not all(map(_is_hand_or_piece, texts))]
    if not named:
        return []
    objects, parts = _once_each_recording(objects, parts, named)
    recurring = _recurring(objects, parts, named, is_flat=is_flat)
    notes = list[Note]()
    for part in _likely(parts, recurring, is_flat=is_flat):
        words = sorted(set(parts[part]))
        text = f"{several(len(words), 'word')} recur in the names of files of several objects: "
        text += f"{listed(words)}. A split by recording mixes them. If they are persons or days, "
        text += _remedy(parts, part, mark, layout, is_flat=is_flat, has_labels=has_labels)
        notes.append(Note(f"{text}.", "warning", "names"))
    return notes


def _parted(names: list[str]) -> tuple[str, list[list[str]]]:
    """Return the mark that parts all names equally often, and for each part its texts in all names.

    Without such a mark, the parts are letters with a number after them, as in S01T03. If the names
    do not consist of such parts, each name is one part.
    """
    for mark in "_- .":
        counts = {name.count(mark) for name in names}
        if len(counts) == 1 and counts != {0}:
            return mark, _columns([name.split(mark) for name in names])
    words_of_name = [re.findall(r"[A-Za-z]+\d+", name) for name in names]
    are_words = all(
        "".join(words) == name for words, name in zip(words_of_name, names, strict=True)
    )
    if are_words and len({len(words) for words in words_of_name}) == 1:
        return "", _columns(words_of_name)
    return "", [names]


def _columns(rows: list[list[str]]) -> list[list[str]]:
    return [list(column) for column in zip(*rows, strict=True)]


def _once_each_recording(
    objects: Sequence[str | None], parts: list[list[str]], named: list[int]
) -> tuple[Sequence[str | None], list[list[str]]]:
    """Return objects and parts in which the files of one recording occur once.

    Args:
        objects: the object of each file.
        parts: for each part of the names its texts in all files.
        named: the parts that are no hand and no piece of a recording. The others become empty.
    """
    columns = [parts[part] for part in named]
    recordings = dict.fromkeys(zip(objects, *columns, strict=True))
    of_recordings = list(zip(*recordings, strict=True))
    merged = [[""] for _ in parts]
    for part, texts in zip(named, of_recordings[1:], strict=True):
        merged[part] = list(texts)
    return of_recordings[0], merged


def _recurring(
    objects: Sequence[str | None], parts: list[list[str]], named: list[int], *, is_flat: bool
) -> list[int]:
    """Return the parts that recur and can be persons.

    Args:
        objects: the object of each recording.
        parts: for each part of the names its texts in all recordings.
        named: the parts that are no hand and no piece of a recording.
        is_flat: whether the objects stand in the names.
    """
    last = len(parts) - 1
    recurring = list[int]()
    for part in named:
        others: Sequence[object] = objects
        if is_flat and part == last:
            continue
        if is_flat:  # the object in the layout holds this part, too
            columns = [parts[other] for other in named if other not in (part, last)]
            others = list(zip(*columns, strict=True))
        if others and _recurs(parts[part], others, is_whole_name=last == 0):
            recurring.append(part)
    recurring = [part for part in recurring if not all(map(_is_no_person, parts[part]))]
    # numbers begin again in each set of a split, so they are no persons
    if any(all(map(_is_set_of_split, parts[part])) for part in named):
        recurring = [part for part in recurring if not _are_digits(parts[part])]
    return recurring


def _likely(parts: list[list[str]], recurring: list[int], *, is_flat: bool) -> list[int]:
    """Return the recurring parts that look like persons, or all of them if none does."""
    if is_flat:  # of two words, the word with numbers is more likely a person
        likely = [part for part in recurring if _have_digits(parts[part])]
    else:
        likely = [part for part in recurring if not _are_digits(parts[part])]
    return likely or recurring


def _recurs(texts: Sequence[str], objects: Sequence[object], *, is_whole_name: bool) -> bool:
    """Return whether each text of a part occurs with several objects, mostly in several files."""
    files = Counter(zip(texts, objects, strict=True))
    objects_of = Counter(text for text, _ in files)
    if len(objects_of) < 2 or min(objects_of.values()) < 2:
        return False
    if is_whole_name:
        return all(re.fullmatch(f"{PERSON}|{NAME}", text) for text in texts)
    repeated = [count > 1 for count in files.values()]
    return sum(repeated) > REPEATED_SHARE * len(repeated)


def _are_digits(texts: list[str]) -> bool:
    return all(text.isdigit() for text in texts)


def _have_digits(texts: list[str]) -> bool:
    return all(re.search(r"\d", text) for text in texts)


def _is_hand_or_piece(text: str) -> bool:
    return re.fullmatch(f"{PART}|{PIECE}", text) is not None


def _is_no_person(text: str) -> bool:
    return re.fullmatch(REPEATS, text) is not None or _is_set_of_split(text)


def _is_set_of_split(text: str) -> bool:
    """Return whether a part of a name is a set of a split, such as `train`."""
    return SIDE.fullmatch(text.lower()) is not None


def _remedy(
    parts: list[list[str]], part: int, mark: str, layout: str, *, is_flat: bool, has_labels: bool
) -> str:
    """Return the remedy that makes a part of the names the session."""
    last = len(parts) - 1
    if has_labels:
        return "add them to labels.csv as a column `session`"
    if not mark and last:
        example = "_".join(texts[0] for texts in parts)
        change = setting("data.layout=OBJECT/SESSION_FILE")
        return f"rename the files with a mark between, as {example}, and {change}"
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
