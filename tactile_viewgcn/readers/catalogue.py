"""Read and write the catalogue: a table with a row for the file and the names of each recording.

Folders, HDF5 attributes, columns of a table and a labels.csv are all ways to fill its columns. A
person can correct the catalogue, and give it back as the source.

    file      the path of the file, relative to the catalogue's own folder, or absolute
    place     which recording of the file it is; empty if the file is one recording
    object    the object that is held
    session   the person, day or fitting
    recording the name of the recording; rows with the same name and different parts are joined
    part      the part of the sensors, such as left or right
    take      recordings of one object with the same text here are held out together; a recording
              with an empty cell is held out with no other
    split     the published set: train, validation or test; `by frame` if the file gives the set of
              each frame
    frames    the number of frames; it is ignored when the catalogue is read
    left_out  the reason why the row is not read; empty if it is read
"""

import csv
import re
import sys
from io import StringIO
from os.path import relpath
from pathlib import Path, PureWindowsPath

import numpy as np
import pandas as pd

from tactile_viewgcn.messages import FORMULA, UserError, csv_text, listed, shown
from tactile_viewgcn.readers.child import library
from tactile_viewgcn.readers.lines import label_kind
from tactile_viewgcn.readers.source import Form, label_text, side_of

COLUMNS = (
    "file", "place", "object", "session", "recording", "part", "take", "split", "frames", "left_out"
)  # fmt: skip
#: Columns that a catalogue has and a labels.csv does not have.
OWN_COLUMNS = {"place", "left_out"}
BY_FRAME = "by frame"  # in `split`: the file has the set of each frame
MOST_HEADER = 100_000  # letters of a table's first line that are read
FILE_COLUMN = r"file[ _]?(name|path)?s?|path"  # in lower case
SEPARATORS = ",;\t"
#: An escape that `shown` writes, or two backslashes, which stand for one.
ESCAPE = re.compile(r"\\(\\|[nrt]|x[0-9a-f]{2}|u[0-9a-f]{4}|U[0-9a-f]{8})")
ESCAPED_FORMULA = re.compile(f"'+[{re.escape(''.join(FORMULA))}]")


def check_is_new(file: Path) -> None:
    """Refuse to write a catalogue over a file, which can hold a person's corrections.

    Raises:
        UserError: the file exists already, or its name does not end in .csv.
    """
    if file.suffix.lower() != ".csv":
        raise UserError(f"{file}: the name of a catalogue ends in .csv; name it {file.stem}.csv")
    if file.exists() or file.is_symlink():
        what = "this file exists already, and can hold corrections"
        raise UserError(f"{file}: {what}; choose another name")


def catalogue_text(catalogue: pd.DataFrame, folder: Path) -> str:
    """Return a catalogue as CSV, with paths relative to a folder.

    Control characters and backslashes are escaped. An apostrophe stands before a text that a
    spreadsheet would run as a formula. `names_in_text` undoes both.
    """
    rows: list[list[object]] = [list(COLUMNS)]
    for row in catalogue[list(COLUMNS)].itertuples(index=False):
        cells = list(row)
        cells[0] = relpath(cells[0], folder)
        rows.append([_escaped(str(cell)) for cell in cells])
    return csv_text(rows)


def _escaped(text: str) -> str:
    """Return a text with escapes, which `_unescaped` undoes; `csv_text` adds apostrophes."""
    text = "".join(r"\\" if letter == "\\" else shown(letter) for letter in text)
    if ESCAPED_FORMULA.match(text):
        # an apostrophe of the name would otherwise look like the one that `csv_text` adds
        return f"'{text}"
    return text


def _unescaped(text: str) -> str:
    if ESCAPED_FORMULA.match(text):
        text = text[1:]
    return ESCAPE.sub(_letter, text)


def _letter(escape: re.Match[str]) -> str:
    named = {"\\": "\\", "n": "\n", "r": "\r", "t": "\t"}
    if escape[1] in named:
        return named[escape[1]]
    number = int(escape[1][1:], 16)
    if number > sys.maxunicode:  # an escape that a person wrote, and that means no letter
        return escape[0]
    return chr(number)


def names_in_text(file: Path, text: str) -> pd.DataFrame | None:
    """Return the rows of a table that names files and their objects; None for any other table.

    A labels.csv and a catalogue are such tables.

    Returns:
        The texts of all columns in `COLUMNS` that the table has, and a column `line` with the
        number of each row's line.

    Raises:
        UserError: a row has more cells than the header.
    """
    header = text.partition("\n")[0][:MOST_HEADER]
    separator = max(SEPARATORS, key=header.count)
    kinds = _kinds_of_header(next(csv.reader([header], delimiter=separator), []))
    if "file" not in kinds or "object" not in kinds:
        return None
    is_own = set(kinds) >= OWN_COLUMNS
    rows = list[dict[str, object]]()
    reader = csv.reader(StringIO(text), delimiter=separator)
    with library(file):
        lines = [(reader.line_num, cells) for cells in reader]
    for number, cells in lines[1:]:
        if not any(cells):
            continue
        if len(cells) > len(kinds):
            what = f"line {number} has {len(cells)} cells; expected {len(kinds)}"
            raise UserError(f"{file}: {what}, as its first line")
        padded = cells + [""] * (len(kinds) - len(cells))
        row: dict[str, object] = {"line": number}
        for kind, cell in zip(kinds, padded, strict=True):
            if kind and is_own:
                row[kind] = _unescaped(cell)
            elif kind:
                row[kind] = cell
        rows.append(row)
    # object texts, since those of pandas cannot hold every name of a file
    return pd.DataFrame(rows, columns=["line", *filter(None, kinds)], dtype=object)


def _kinds_of_header(header: list[str]) -> list[str]:
    """Return for each name of a header its column in `COLUMNS`.

    It is "" if the name means no such column, or if an earlier name means the same column.
    """
    kinds = list[str]()
    for name in header:
        name = name.strip(' "')
        kind = label_kind(name)
        if kind not in ("object", "session"):
            kind = name.lower() if name.lower() in COLUMNS else ""
        if re.fullmatch(FILE_COLUMN, name.lower()):
            kind = "file"
        kinds.append("" if kind in kinds else kind)
    return kinds


def add_labels(labels: dict[str, dict[str, str]], file: Path, rows: pd.DataFrame) -> None:
    """Add the objects and sessions of a labels.csv to labels, by the files' own names.

    Args:
        labels: the labels of each file so far.
        file: the labels.csv, which errors name.
        rows: its rows, see `names_in_text`.

    Raises:
        UserError: two files of the same name have different labels, or the table is a catalogue,
            which says more than labels.
    """
    if set(rows.columns) >= OWN_COLUMNS:
        remedy = "give it as the source, or move it out of the folder"
        raise UserError(f"{file}: a catalogue lies among the recordings; {remedy}")
    kinds = [kind for kind in ("object", "session") if kind in rows]
    for row in rows.to_dict("records"):
        name = PureWindowsPath(row["file"]).stem
        names = {kind: label_text(row[kind]) for kind in kinds}
        if labels.setdefault(name, names) != names:
            raise UserError(f"{file}: {name} has two labels; give each file a name of its own")


def given_rows(file: Path, rows: pd.DataFrame, form: Form) -> pd.DataFrame:
    """Return the checked rows of a catalogue that is the source, with the `path` of each file.

    Args:
        file: the catalogue.
        rows: its rows, from `names_in_text`.
        form: says whether each recording needs an object.

    Raises:
        UserError: lists the mistakes, each with the number of its line.
    """
    rows = rows.copy()
    for kind in ("object", "session"):
        if kind in rows:
            texts = [label_text(cell) for cell in rows[kind]]
            rows[kind] = pd.Series(texts, index=rows.index, dtype=object)
    if "left_out" in rows:
        rows = rows[[not reason.strip() for reason in rows["left_out"]]].copy()
    if rows.empty:
        raise UserError(f"{file}: it names no recording; write a line for each recording")
    if "place" not in rows:
        rows["place"] = ""
    paths = [file.parent / path for path in rows["file"]]
    rows["path"] = pd.Series(paths, index=rows.index, dtype=object)
    mistakes = [*_wrong_cells(rows, form), *_doubled_rows(rows)]
    if mistakes:
        raise UserError(f"{file}: {listed(mistakes, '; ')}")
    return rows


def _wrong_cells(rows: pd.DataFrame, form: Form) -> list[str]:
    mistakes = list[str]()
    for row in rows.to_dict("records"):
        line = f"line {row['line']}"
        if not row["path"].is_file() and not row["path"].is_symlink():
            what = f"no file {row['file']}; paths begin at the catalogue's own folder"
            mistakes.append(f"{line}: {what}")
        if not row["object"] and form.labelled:
            mistakes.append(f"{line}: no object; write one, or delete the line")
        split = row.get("split", "")
        if split and split != BY_FRAME and side_of(split) is None:
            mistakes.append(f"{line}: split is {split!r}; expected train, test or validation")
    return mistakes


def _doubled_rows(rows: pd.DataFrame) -> list[str]:
    """Return the mistakes of rows that belong to one recording and are not its parts."""
    mistakes = list[str]()
    real_paths = [path.resolve() for path in rows["path"]]
    keys = [f"{path}/{place}" for path, place in zip(real_paths, rows["place"], strict=True)]
    for same in _alike(rows, keys):
        if len(same) > 1:
            mistakes.append(f"{_lines(same)} are of the same recording; delete all but one")
    if mistakes or "recording" not in rows:
        return mistakes
    parts = rows["part"] if "part" in rows else pd.Series("", index=rows.index)
    alike = [kind for kind in ("object", "session", "take", "split") if kind in rows]
    named = rows[rows["recording"] != ""]
    for same in _alike(named, list(named["recording"])):
        if len(same) == 1:
            continue
        name = same["recording"].iloc[0]
        of_rows = parts[same.index]
        if (of_rows == "").any() or of_rows.duplicated().any():
            what = f"{_lines(same)} are of recording {name!r}"
            mistakes.append(f"{what}; to join them, write different parts, or else rename them")
        elif (same[alike] != same[alike].iloc[0]).any(axis=None):
            mistakes.append(f"{_lines(same)} are parts of one recording; give them the same names")
        elif (same["place"] != "").any():
            what = f"{_lines(same)} join recordings that share their files with others"
            mistakes.append(f"{what}; save each as its own file")
    return mistakes


def _alike(rows: pd.DataFrame, keys: list[str]) -> list[pd.DataFrame]:
    """Return the rows in groups of equal keys.

    The keys become numbers first, since pandas cannot group all texts.
    """
    numbers, _ = pd.factorize(np.array(keys, dtype=object))
    return [same for _, same in rows.groupby(numbers, sort=False)]


def _lines(rows: pd.DataFrame) -> str:
    return f"lines {listed([str(line) for line in rows['line']])}"
