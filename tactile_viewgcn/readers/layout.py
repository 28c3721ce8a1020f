"""What the folders and names of files say: the object, the session and the published side of each recording."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tactile_viewgcn.messages import EMPTY_HAND, Note, UserError
from tactile_viewgcn.readers.source import SPLITS, Form, setting

PLACES = "OBJECT/FILE or SESSION/OBJECT/FILE"


@dataclass(frozen=True)
class Layout:
    """A pattern such as SESSION/OBJECT/FILE or OBJECT_FILE of the paths of files below a folder."""

    root: Path
    text: str
    notes: tuple[Note, ...] = ()

    def names(self, file: Path, *, labelled: bool) -> dict[str, str]:
        """The names in a file's path, by `object`, `session` and `split`.

        Raises:
            UserError: the path is of a different pattern, or names no object where it is `labelled`.
        """
        pattern = re.sub("SESSION|SPLIT", lambda part: f"(?P<{part[0].lower()}>[^/]+?)", re.escape(self.text))
        pattern = pattern.replace("OBJECT", "(?P<object>[^/]+)").replace("FILE", "[^/]+")  # tea_box is one name
        if not (match := re.fullmatch(pattern, place_of(file, self.root))):
            raise UserError(f"{file}: expected {self.text}, or an attribute `object` in HDF5")
        if labelled and "object" not in match.groupdict():
            raise UserError(
                f"{self.root}: {file.relative_to(self.root).as_posix()!r} names no object; expected {PLACES}, a table "
                "with a column `object`, or an attribute `object` in HDF5; "
                f"{setting('data.layout=OBJECT_FILE')} for names such as mug_1.csv"
            )
        return match.groupdict()


def place_of(file: Path, path: Path) -> str:
    """The path of a file below a folder, without its ending: the name of its recording; of a file alone its name."""
    place = file.name if file == path else file.relative_to(path).as_posix()
    return re.sub(r"(?i)(\.csv)?\.\w+$", "", place)


def layout_of(path: Path, files: Sequence[Path], form: Form) -> Layout:
    """The layout of the files below a folder, or of one file: the given one, or by `auto` that of most files.

    Folders that are all called as sides are the published split. Of the others the innermost is the object and the one
    above it the session: a file train/monday/mug/1.npy is SPLIT/SESSION/OBJECT/FILE. No layout fits files that lie
    deeper.
    """
    root = path if path.is_dir() else path.parent
    if form.layout != "auto":
        return Layout(root, form.layout)
    places = [file.relative_to(root).parts[:-1] for file in files]
    depth = Counter(map(len, places)).most_common(1)[0][0]
    levels = list(zip(*(place for place in places if len(place) == depth), strict=True))
    are_sides = [{name.lower() for name in level} <= SPLITS.keys() for level in levels]
    count = are_sides.count(False)
    if count > 2:
        return Layout(root, "SESSION/OBJECT/FILE")  # which does not fit them
    roles = iter(["SESSION", "OBJECT"][2 - count :])
    order = ["SPLIT" if is_side else next(roles) for is_side in are_sides]
    text = "/".join([*order, "FILE"])
    if not levels:
        return Layout(root, text)
    note = f"folders are in the order {text}: "
    note += ", ".join(f"{level[0]} is the {role.lower()}" for level, role in zip(levels, order, strict=True))
    if count < 2 or EMPTY_HAND in levels[order.index("OBJECT")]:
        return Layout(root, text, (Note(note, topic="folders"),))
    other = "/".join({"SESSION": "OBJECT", "OBJECT": "SESSION"}.get(role, role) for role in order)
    note += f". If not, {setting(f'data.layout={other}/FILE')}; else data.layout={text}"
    return Layout(root, text, (Note(note, "warning", "folders"),))
