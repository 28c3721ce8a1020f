"""What the paths of files say: object, session, published set, and which files belong together."""

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
WIDE_ROLES = ("OBJECT", "FILE")  # take as much of a name as they can: tea_box is one object
#: A word of a file's name, by which files of one recording differ.
WORD = r"((?<![a-zA-Z])|(?<=[a-z])(?=[A-Z]))(?i:%s)(?![a-z])"
#: A hand, an axis or a device.
PART = (
    WORD % r"left|right|lh|rh|[lrxyz]|(device|dev|sensor|glove|imu|emg|accel|acc|gyro|mag|board)\d*"
)
#: A part of the recording's time.
PIECE = WORD % r"(part|window|win|segment|seg|chunk)[ _-]?\d+"
#: The words of an augmented copy, maybe with its number; four digits after them are a year, as in
#: aug2024.
COPY = (
    r"(?<![^\W_])(?i:aug|augmented|noise|noisy|jitter|jittered|scaled|rotated|flipped|mirrored"
    r"|shifted|warped|resampled|copy|orig|original)([ _-]?\d{1,2})?(?![^\W_])"
)
#: Names of folders with one stage of processing of the same recordings.
STAGES = (
    "(un|pre)?(raw|original|filtered|processed|cleaned?|calibrated|smoothed|normali[sz]ed"
    "|resampled|scaled)([_ -].*)?"
)


def place_of(file: Path, folder: Path) -> str:
    """Return the path of a file from a folder, without its ending: the name of its recording."""
    return re.sub(r"(?i)(\.csv)?\.\w+$", "", Path(relpath(file, folder)).as_posix())


def names_in(place: str, layout: str) -> dict[str, str]:
    """Return the texts of a place by their roles in a layout, in small letters.

    There are none if the place is not of that layout. Several sessions are joined by a slash. With
    a PART there is also the `recording`, the place without its text.
    """
    pattern = re.escape(layout)
    for role in WIDE_ROLES:
        pattern = pattern.replace(role, "([^/]+)")
    pattern = ROLE.sub("([^/]+?)", pattern)
    match = re.fullmatch(pattern, place)
    names = dict[str, str]()
    if match is None:
        return names
    for group, role in enumerate(ROLE.findall(layout), 1):
        kind = role.lower()
        if kind in names:
            names[kind] += f"/{match[group]}"
        else:
            names[kind] = match[group]
        if role == "PART":
            without_part = place[: match.start(group)] + place[match.end(group) :]
            pieces = [piece.strip("_- ") for piece in without_part.split("/")]
            names["recording"] = "/".join(filter(None, pieces))
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
    """Return the names in a file's path, see `names_in`.

    Args:
        file: which errors name.
        place: of the file, see `place_of`.
        layout: of the places.
        form: says whether the layout was given, and whether each recording needs an object.
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
    expected = f"expected {PLACES}, a table with a column `object`, "
    expected += "or an attribute `object` in HDF5"
    folder = layout.rpartition("FILE")[0]  # such as SPLIT/
    remedies = f"{setting(f'data.layout={folder}OBJECT_FILE')} for names such as mug_1.csv, "
    remedies += f"{folder}OBJECT_SESSION_FILE for mug_anna_1.csv, {folder}OBJECT for mug.csv"
    found = hint()
    if found:
        raise UserError(f"{file}: names no object; {found}; else {expected}; or {remedies}")
    raise UserError(f"{file}: names no object; {expected}; {remedies}")


def layout_of(places: Sequence[str], form: Form) -> tuple[str, list[Note]]:
    """Return the layout of files, such as SESSION/OBJECT/FILE, and a note on it if it is a guess.

    It is the given one, without its object where no file has one and none is needed, or by `auto`
    that of most files. Folders that are all called as published sets are the split. Of the others
    the innermost is the object, and those above it are the session: a file
    train/monday/mug/1.npy is SPLIT/SESSION/OBJECT/FILE.
    """
    if form.layout != "auto":
        fits = any(names_in(place, form.layout) for place in places)
        if form.labelled or fits:
            return form.layout, []
        return re.sub(".*OBJECT[^A-Z]*", "", form.layout), []
    folders = [place.split("/")[:-1] for place in places]
    depth = Counter(map(len, folders)).most_common(1)[0][0]
    levels = list(zip(*(names for names in folders if len(names) == depth), strict=True))
    order = _roles_of(levels)
    layout = "/".join([*order, "FILE"])
    if not levels:
        return layout, []
    examples = [
        f"{level[0]} is the {role.lower()}" for level, role in zip(levels, order, strict=True)
    ]
    note = f"folders are in the order {layout}: {', '.join(examples)}"
    has_session = "SESSION" in order
    if not has_session or EMPTY_HAND in levels[order.index("OBJECT")]:
        return layout, [Note(note, topic="folders")]
    note += f". If not, {setting(f'data.layout={other_order(layout)}')}; else data.layout={layout}"
    return layout, [Note(note, "warning", "folders", "data.layout", layout)]


def _roles_of(levels: Sequence[Sequence[str]]) -> list[str]:
    """Return the role of each level of folders; the innermost that is no SPLIT is the OBJECT."""
    roles = list[str]()
    for level in reversed(levels):
        if None not in [side_of(name) for name in level]:
            roles.append("SPLIT")
        elif "OBJECT" not in roles:
            roles.append("OBJECT")
        else:
            roles.append("SESSION")
    return roles[::-1]


def other_order(layout: str) -> str:
    """Return the layout with sessions and objects in each other's place."""
    roles = iter(re.findall("SESSION|OBJECT", layout)[::-1])
    return re.sub("SESSION|OBJECT", lambda _: next(roles), layout)


def doubles_notes(places: Sequence[str], path: Path) -> list[Note]:
    """Return a warning where folders of two stages of processing hold files of the same names.

    Such folders are raw and filtered.
    """
    folders = [place.split("/") for place in places]
    for level in range(max(map(len, folders)) - 1):
        below = _files_below(folders, level)
        stages = [folder for folder in below if re.fullmatch(STAGES, folder)]
        both = set.intersection(*below.values()) if len(below) > 1 else set()
        if not stages or not both:
            continue
        inspected = path
        if level == 0:
            inspected = path / stages[0]
        text = f"the folders {listed(sorted(below))} hold {several(len(both), 'file')} "
        text += f"of the same names, such as {min(both)}: "
        text += "are they two forms of the same recordings? Then move the others away, "
        text += f"and name one: tactile-viewgcn inspect {quote(str(inspected))}."
        return [Note(text, "warning", "doubles")]
    return []


def _files_below(folders: Sequence[Sequence[str]], level: int) -> dict[str, set[str]]:
    """Return the places without the folder at a level, by that folder's name in small letters."""
    below = dict[str, set[str]]()
    for names in folders:
        if level < len(names) - 1:
            rest = "/".join([*names[:level], *names[level + 1 :]])
            below.setdefault(names[level].lower(), set()).add(rest)
    return below


def stem_of(place: str) -> str:
    """Return what places of recordings that belong together have in common.

    It is the place without words of `PART`, `PIECE` and `COPY`. Beside 01 the copies 01_aug1 and
    aug_2_01 have the stem 01. A name that would have no number left keeps that of its device or
    part: glove1 and glove2 may be two grasps.
    """
    folder, mark, name = place.rpartition("/")
    stem = without_copy(re.sub(f"{PART}|{PIECE}", "", name)).lower()
    loses_its_number = re.search(r"\d", name) and not re.search(r"\d", stem)
    if loses_its_number:
        stem = name
    return folder + mark + stem


def without_copy(name: str) -> str:
    """Return a file's name without the words of `COPY` and the marks that are then at its ends."""
    original = re.sub(COPY, "", name)
    if name == original:
        return name
    return original.strip(" _-")


def joining(places: Sequence[str], layout: str) -> str:
    """Return the layout whose PART is a hand, an axis or a device in all these places.

    It is "" if there is none.
    """
    layouts = list[str]()
    for mark in "_- ":
        for part in (f"FILE{mark}PART", f"PART{mark}FILE"):
            layouts.append(layout.replace("FILE", part))
    layouts += ["OBJECT/PART", "OBJECT/FILE/PART", "SESSION/OBJECT/FILE/PART"]
    for other in layouts:
        parts = [names_in(place, other).get("part", "no part") for place in places]
        if not any(re.sub(f"{PART}|[ _-]", "", part) for part in parts):
            return other
    return ""
