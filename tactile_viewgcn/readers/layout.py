"""What the paths of files say: the object, the session, the published side, and which files belong together."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from os.path import relpath
from pathlib import Path
from shlex import quote

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, several
from tactile_viewgcn.readers.source import Form, setting, side_of

PLACES = "OBJECT/FILE or SESSION/OBJECT/FILE"
ROLE = re.compile("SESSION|SPLIT|OBJECT|FILE|PART")  # of a text in a layout
#: Words of a file's name by which files of one recording differ: a hand, an axis, a device; or a
#: part of its time.
WORD = r"((?<![a-zA-Z])|(?<=[a-z])(?=[A-Z]))(?i:%s)(?![a-z])"
PART = (
    WORD % r"left|right|lh|rh|[lrxyz]|(device|dev|sensor|glove|imu|emg|accel|acc|gyro|mag|board)\d*"
)
PIECE = WORD % r"(part|window|win|segment|seg|chunk)[ _-]?\d+"
#: The words of an augmented copy, maybe with its number; four digits after them are a year, as in
#: aug2024.
COPY = (
    r"(?<![^\W_])(?i:aug|augmented|noise|noisy|jitter|jittered|scaled|rotated|flipped|mirrored|shifted|warped"
    r"|resampled|copy|orig|original)([ _-]?\d{1,2})?(?![^\W_])"
)

#: Names of folders with one stage of processing of the same recordings.
STAGES = "(un|pre)?(raw|original|filtered|processed|cleaned?|calibrated|smoothed|normali[sz]ed|resampled|scaled)([_ -].*)?"


def place_of(file: Path, folder: Path) -> str:
    """Return the path of a file from a folder, without its ending: the name of its recording."""
    return re.sub(r"(?i)(\.csv)?\.\w+$", "", Path(relpath(file, folder)).as_posix())


def names_in(place: str, layout: str) -> dict[str, str]:
    """The texts of a place by their roles in a layout, in small letters; empty if the place is not of that layout.

    Several sessions are joined by a slash. With a PART there is also the `recording`, the place
    without its text.
    """
    wide, names = ("OBJECT", "FILE"), dict[str, str]()  # tea_box is one name
    pattern = ROLE.sub(lambda role: "([^/]+)" if role[0] in wide else "([^/]+?)", re.escape(layout))
    if not (match := re.fullmatch(pattern, place)):
        return {}
    for at, role in enumerate(map(str.lower, ROLE.findall(layout)), 1):
        names[role] = f"{names[role]}/{match[at]}" if role in names else match[at]
        if role == "part":
            pieces = f"{place[: match.start(at)]}{place[match.end(at) :]}".split("/")
            names["recording"] = "/".join(filter(None, (piece.strip("_- ") for piece in pieces)))
    return names


def raw_names(file: Path) -> dict[str, str]:
    """Return the names of a raw recording of STAG, `[batch]/[recording]/pressuredata.mat`.

    The object is the recording's name without its number: of 003-tea_box it is tea_box.
    """
    session, name = file.parts[-3:-1]
    return {
        "object": re.sub(r"^\d+-", "", name),
        "recording": f"{session}/{name}",
        "session": session,
    }


def names_of(
    file: Path, place: str, layout: str, form: Form, hint: Callable[[], str]
) -> dict[str, str]:
    """See `names_in`.

    Args:
        hint: gives what the file itself may have in place of an object's name, and what to type
            then.

    Raises:
        UserError: a path is not of that layout, or names no object where files are labelled.
    """
    names = names_in(place, layout)
    if names and ("object" in names or not form.labelled):
        return names
    if form.layout != "auto":
        remedy = f"params.yaml may have it from others: {setting('data.layout=auto')}"
        raise UserError(
            f"{file}: expected {layout} (data.layout), or an attribute `object` in HDF5; {remedy}"
        )
    if "OBJECT" in layout:
        expected = f"expected {layout} (data.layout), as most files have it"
        raise UserError(f"{file}: {expected}; move the file, or {setting('data.layout=PATTERN')}")
    expected = (
        f"expected {PLACES}, a table with a column `object`, or an attribute `object` in HDF5"
    )
    folder = layout.rpartition("FILE")[0]  # such as SPLIT/
    remedies = [f"{setting(f'data.layout={folder}OBJECT_FILE')} for names such as mug_1.csv"]
    remedies.append(f"{folder}OBJECT_SESSION_FILE for mug_anna_1.csv")
    remedies.append(f"{folder}OBJECT for mug.csv")
    found = hint()
    if found:
        raise UserError(
            f"{file}: names no object; {found}; else {expected}; or {', '.join(remedies)}"
        )
    raise UserError(f"{file}: names no object; {expected}; {', '.join(remedies)}")


def layout_of(places: Sequence[str], form: Form) -> tuple[str, list[Note]]:
    """The layout of files, such as SESSION/OBJECT/FILE, and a note on it if it is a guess.

    It is the given one, without its object where no file has one and none is asked for, or by
    `auto` that of most files. Folders that are all called as sides are the published split. Of the
    others the innermost is the object, and those above it are the session: a file
    train/monday/mug/1.npy is SPLIT/SESSION/OBJECT/FILE.
    """
    if form.layout != "auto":
        is_alone = not (form.labelled or any(names_in(place, form.layout) for place in places))
        return re.sub(".*OBJECT[^A-Z]*", "", form.layout) if is_alone else form.layout, []
    folders = [place.split("/")[:-1] for place in places]
    depth = Counter(map(len, folders)).most_common(1)[0][0]
    levels = list(zip(*(names for names in folders if len(names) == depth), strict=True))
    are_sides = [None not in map(side_of, level) for level in levels]
    count = are_sides.count(False)
    roles = iter(["SESSION"] * (count - 1) + ["OBJECT"])
    order = ["SPLIT" if is_side else next(roles) for is_side in are_sides]
    text = "/".join([*order, "FILE"])
    if not levels:
        return text, []
    note = f"folders are in the order {text}: "
    note += ", ".join(
        f"{level[0]} is the {role.lower()}" for level, role in zip(levels, order, strict=True)
    )
    if count < 2 or EMPTY_HAND in levels[order.index("OBJECT")]:
        return text, [Note(note, topic="folders")]
    note += f". If not, {setting(f'data.layout={other_order(text)}')}; else data.layout={text}"
    return text, [Note(note, "warning", "folders", "data.layout", text)]


def other_order(layout: str) -> str:
    """The layout with sessions and objects in each other's place."""
    roles = iter(re.findall("SESSION|OBJECT", layout)[::-1])
    return re.sub("SESSION|OBJECT", lambda _: next(roles), layout)


def doubles_notes(places: Sequence[str], path: Path) -> list[Note]:
    """A warning where folders of two stages of processing, as raw and filtered, hold files of the same names."""
    folders = [place.split("/") for place in places]
    for level in range(max(map(len, folders)) - 1):
        below = dict[str, set[str]]()
        for names in folders:
            if level < len(names) - 1:
                below.setdefault(names[level].lower(), set()).add(
                    "/".join(names[:level] + names[level + 1 :])
                )
        named = [folder for folder in below if re.fullmatch(STAGES, folder)]
        both = set.intersection(*below.values()) if len(below) > 1 else set()
        if named and both:
            text = f"the folders {listed(sorted(below))} hold {several(len(both), 'file')} of the same names, such as "
            text += f"{min(both)}: are they two forms of the same recordings? Then move the others away, "
            text += f"and name one: tactile-viewgcn inspect {quote(str(path / named[0] if not level else path))}"
            return [Note(f"{text}.", "warning", "doubles")]
    return []


def stem_of(place: str) -> str:
    """What places of recordings that belong together have in common: without words of `PART`, `PIECE` and `COPY`.

    Beside 01 the copies 01_aug1 and aug_2_01 have the stem 01. A name that would have no number
    left keeps that of its device or part: glove1 and glove2 may be two grasps.
    """
    folder, mark, name = place.rpartition("/")
    stem = without_copy(re.sub(f"{PART}|{PIECE}", "", name)).lower()
    return folder + mark + (name if re.search(r"\d", name) and not re.search(r"\d", stem) else stem)


def without_copy(name: str) -> str:
    """A file's name without the words of `COPY` and the marks that are then left at its ends."""
    original = re.sub(COPY, "", name)
    return name if original == name else original.strip(" _-")


def joining(places: Sequence[str], layout: str) -> str:
    """The layout whose PART is a hand, an axis or a device in all these places; "" if there is none."""
    beside = [
        layout.replace("FILE", part)
        for mark in "_- "
        for part in (f"FILE{mark}PART", f"PART{mark}FILE")
    ]
    for other in (*beside, "OBJECT/PART", "OBJECT/FILE/PART", "SESSION/OBJECT/FILE/PART"):
        parts = [names_in(place, other).get("part", "no part") for place in places]
        if not any(re.sub(f"{PART}|[ _-]", "", part) for part in parts):
            return other
    return ""
