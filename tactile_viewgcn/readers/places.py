"""What the folders and the name of a file say of its recording: object, session and side of the published split."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError
from tactile_viewgcn.readers.source import SPLITS, Form, setting

PLACES = "OBJECT/FILE, SESSION/OBJECT/FILE or OBJECT/SESSION/FILE"
#: A folder of a session is named by a number, a day, or one of these words with or without a number.
SESSION = re.compile(
    r"[\W\d_]+(t[\W\d_]+z?)?|(mon|tues?|wed(nes)?|thu(rs)?|fri|sat(ur)?|sun)(day)?|[spdrt][\W_]*\d+"
    r"|(session|sess|ses|day|date|week|visit|run|rec|recording|trial|take|subject|subj|sub|participant|person|user)"
    r"([\W\d_].*)?",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Layout:
    """A pattern such as SESSION/OBJECT/FILE or OBJECT_FILE of the paths of files below a folder."""

    root: Path
    text: str

    def names(self, file: Path, *, labelled: bool) -> dict[str, str]:
        """The names in a file's path, by `object`, `session` and `split`.

        Raises:
            UserError: the path is of a different pattern, or names no object where it is `labelled`.
        """
        recording = place_of(file, self.root)
        pattern = re.sub("SESSION|SPLIT", lambda part: f"(?P<{part[0].lower()}>[^/]+?)", re.escape(self.text))
        pattern = pattern.replace("OBJECT", "(?P<object>[^/]+)").replace("FILE", "[^/]+")  # tea_box is one name
        if not (match := re.fullmatch(pattern, recording)):
            expected = f"expected {self.text} as for most files; in all, {PLACES}"
            raise UserError(f"{file}: {expected}, or an attribute `object` in HDF5")
        if labelled and "object" not in match.groupdict():
            raise UserError(
                f"{self.root}: {file.relative_to(self.root).as_posix()!r} names no object; expected {PLACES}, a table "
                "with a column `object`, or an attribute `object` in HDF5; "
                f"{setting('data.layout=OBJECT_FILE')} for names such as mug_1.csv"
            )
        return match.groupdict()

    def note(self, file: Path) -> list[Note]:
        """What the folders of a file are taken for."""
        names = self.names(file, labelled=False)
        order = ", ".join(f"{name} is the {role}" for role, name in names.items())
        return [Note(f"folders are in the order {self.text}: {order}", topic="folders")] if names else []


def place_of(file: Path, path: Path) -> str:
    """The path of a file below a folder, without its ending: the name of its recording; of a file alone its name."""
    place = file.name if file == path else file.relative_to(path).as_posix()
    return re.sub(r"(?i)(\.csv)?\.\w+$", "", place)


def layout_of(path: Path, files: Sequence[Path], form: Form) -> Layout:
    """The layout of the files below a folder, or of one file: the given one, or by `auto` that of most files.

    Folders that only sessions are named as hold objects, unless recordings need not be labelled.

    Raises:
        UserError: most files lie deeper than two folders and that of the published split, or either of two folders may
            name the objects.
    """
    root = path if path.is_dir() else path.parent
    if form.layout != "auto":
        return Layout(root, form.layout)
    places = [file.relative_to(root).parts[:-1] for file in files]
    depth = Counter(map(len, places)).most_common(1)[0][0]
    roles = _roles([place for place in places if len(place) == depth], root)
    if not form.labelled and roles == ["OBJECT"] and all(SESSION.fullmatch(place[0]) for place in places if place):
        roles = ["SESSION"]
    if len(roles) < depth:
        raise UserError(f"{root}: {'/'.join(files[0].relative_to(root).parts)!r} names no object; expected {PLACES}")
    return Layout(root, "/".join([*roles, "FILE"]))


def _roles(places: list[tuple[str, ...]], root: Path) -> list[str]:
    """What the folders above each file name, from the outermost: OBJECT, SESSION or SPLIT; none of too many.

    Folders that are all named as a side are the split. Of two others the inner ones are the objects, unless the outer
    ones are more likely to be: there is a folder of the empty hand, their names are not those of sessions, only they
    have several names, or no inner name is in two of them.

    Args:
        places: names of the folders above each file, equally many.

    Raises:
        UserError: neither of two folders is more likely.
    """
    levels = list(zip(*places, strict=True))
    sides = [{name.lower() for name in level} <= SPLITS.keys() for level in levels]
    others = [level for level, is_side in zip(levels, sides, strict=True) if not is_side]
    if len(others) > 2:
        return []
    outer, inner = (
        ["SPLIT" if is_side else next(names) for is_side in sides]
        for names in (iter(["OBJECT", "SESSION"]), iter(["SESSION", "OBJECT"]))
    )
    likely = [(EMPTY_HAND in level, not all(map(SESSION.fullmatch, level)), len(set(level)) > 1) for level in others]
    if len(likely) < 2 or likely[0] > likely[1]:
        return outer
    if likely[0] < likely[1] or not all(likely[0][1:]):
        return inner
    if len(set(zip(*others, strict=True))) == len(set(others[1])):
        return outer
    first, second = (f"data.layout={'/'.join(order)}/FILE" for order in (outer, inner))
    raise UserError(
        f"{root}: either folder of {'/'.join(places[0])!r} may name the object; {setting(first)} or {second!r}"
    )
