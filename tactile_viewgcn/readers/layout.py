"""Read from the paths of files the object, the session, the published set and joined files."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from os.path import relpath
from pathlib import Path
from shlex import quote

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError, listed, several
from tactile_viewgcn.readers.source import Form, setting, side_of

PLACES = "OBJECT/FILE or SESSION/OBJECT/FILE"
ROLE = re.compile("SESSION|SPLIT|OBJECT|FILE|PART")  # the role of a text in a layout
# roles that take as much of a name as they can: tea_box is one object
WIDE_ROLES = ("OBJECT", "FILE")
#: A word by which the names of files of one recording differ; `%` puts it in.
WORD = r"((?<![a-zA-Z])|(?<=[a-z])(?=[A-Z]))(?i:%s)(?![a-z])"
#: A word for a hand, an axis or a device.
PART = (
    WORD % r"left|right|lh|rh|[lrxyz]|(device|dev|sensor|glove|imu|emg|accel|acc|gyro|mag|board)\d*"
)
#: A word for a part of the recording's time.
PIECE = WORD % r"(part|window|win|segment|seg|chunk)[ _-]?\d+"
#: The words for an augmented copy. One or two digits after them are its number; four digits are a
#: year, as in aug2024.
COPY = (
    r"(?<![^\W_])(?i:aug|augmented|noise|noisy|jitter|jittered|scaled|rotated|flipped|mirrored"
    r"|shifted|warped|resampled|copy|orig|original)([ _-]?\d{1,2})?(?![^\W_])"
)
#: Names of folders that hold the same recordings after one stage of processing.
STAGES = (
    "(un|pre)?(raw|original|filtered|processed|cleaned?|calibrated|smoothed|normali[sz]ed"
    "|resampled|scaled)([_ -].*)?"
)


def place_of(file: Path, folder: Path) -> str:
    """Return the name of a file's recording: its path from a folder, without the ending."""
    return re.sub(r"(?i)(\.csv)?\.\w+$", "", Path(relpath(file, folder)).as_posix())


def names_in(place: str, layout: str) -> dict[str, str]:
    """Return the texts of a place by their roles in a layout, such as `object` for OBJECT.

    There are none if the place does not fit the layout. Several sessions are joined by a slash. If
    the layout has a PART, the texts also have the `recording`: the place without the part.
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

    The object is the recording's name without its number: tea_box for 003-tea_box.
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
        file: the file, which errors name.
        place: the place of the file, see `place_of`.
        layout: the layout of the places.
        form: says whether the user gave the layout, and whether each recording needs an object.
        hint: returns where the file itself can name its objects, with the remedy to type.

    Raises:
        UserError: the path does not fit the layout. Or it names no object, although files are
            labelled.
    """
    names = names_in(place, layout)
    if not names and is_beside_recordings(place, layout, form):
        names = names_in(place, f"OBJECT/{layout}")
    if names and ("object" in names or not form.labelled):
        return names
    if form.layout != "auto":
        remedy = f"if the layout is for other recordings, {setting('data.layout=auto')}"
        raise UserError(
            f"{file}: expected {layout} (data.layout), or an attribute `object` in HDF5; {remedy}"
        )
    if "OBJECT" in layout:
        expected = f"expected {layout} (data.layout), as for most files"
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


def is_beside_recordings(place: str, layout: str, form: Form) -> bool:
    """Return whether a file is in a folder empty_hand next to recordings that name no object."""
    folder = place.rpartition("/")[0]
    return not form.labelled and layout == "FILE" and folder == EMPTY_HAND


def layout_of(places: Sequence[str], form: Form) -> tuple[str, list[Note]]:
    """Return the layout of files, such as SESSION/OBJECT/FILE, and a note on it if it is a guess.

    If the form gives a layout, it is this one. Its object is removed if no file has an object and
    none is needed. With `auto`, it is the layout of most files.

    `auto` takes a level of folders for the split if all its folders have names of published sets.
    The innermost of the other levels is the object, and the levels above it are the session. So
    the layout of train/monday/mug/1.npy is SPLIT/SESSION/OBJECT/FILE.

    Args:
        places: the places of the files, see `place_of`.
        form: says whether the user gave the layout, and whether each recording needs an object.
    """
    if form.layout != "auto":
        fits = any(names_in(place, form.layout) for place in places)
        if form.labelled or fits:
            return form.layout, []
        return re.sub(".*OBJECT[^A-Z]*", "", form.layout), []
    folders = [place.split("/")[:-1] for place in places]
    if not form.labelled and [] in folders:  # recordings that name no object
        folders = [names for names in folders if names != [EMPTY_HAND]]
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
    note += f". If that is wrong, {setting(f'data.layout={other_order(layout)}')}. If it is right, "
    note += f"data.layout={layout} says so"
    return layout, [Note(note, "warning", "folders", "data.layout", layout)]


def _roles_of(levels: Sequence[Sequence[str]]) -> list[str]:
    """Return the role of each level of folders; the innermost level but SPLIT is the OBJECT."""
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
    """Return the layout with sessions and objects swapped."""
    roles = iter(re.findall("SESSION|OBJECT", layout)[::-1])
    return re.sub("SESSION|OBJECT", lambda _: next(roles), layout)


def doubles_notes(places: Sequence[str], path: Path) -> list[Note]:
    """Return a warning if folders of two stages of processing hold files with the same names.

    An example is the folders raw and filtered.
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
        text += "are they two forms of the same recordings? Then keep one: move the others away, "
        text += f"and inspect it: tactile-viewgcn inspect {quote(str(inspected))}."
        return [Note(text, "warning", "doubles")]
    return []


def _files_below(folders: Sequence[Sequence[str]], level: int) -> dict[str, set[str]]:
    """Return the places without the folder at a level, by that folder's name in lower case."""
    below = dict[str, set[str]]()
    for names in folders:
        if level < len(names) - 1:
            rest = "/".join([*names[:level], *names[level + 1 :]])
            below.setdefault(names[level].lower(), set()).add(rest)
    return below


def stem_of(place: str) -> str:
    """Return the stem of a place, which the places of recordings that belong together share.

    It is the place without the words of `PART`, `PIECE` and `COPY`. The copies 01_aug1 and aug_2_01
    of 01 have the stem 01. If a name would lose its only number, nothing is removed from it: glove1
    and glove2 can be two grasps.
    """
    folder, mark, name = place.rpartition("/")
    stem = without_copy(re.sub(f"{PART}|{PIECE}", "", name)).lower()
    loses_its_number = re.search(r"\d", name) and not re.search(r"\d", stem)
    if loses_its_number:
        stem = name
    return folder + mark + stem


def without_copy(name: str) -> str:
    """Return a file's name without the words of `COPY` and without the marks next to them."""
    original = re.sub(COPY, "", name)
    if name == original:
        return name
    return original.strip(" _-")


def joining(places: Sequence[str], layout: str) -> str:
    """Return a layout whose PART is a hand, an axis or a device in all places; "" for none.

    Args:
        places: the places of the files, see `place_of`.
        layout: the layout without a PART.
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
