"""The catalogue: a table with a row for each recording, where it lies and what its names are.

Folders, attributes of HDF5, columns of a table and a labels.csv are ways to fill its columns. A
person may correct it, and give it back as the source.

    file      path of the file, relative to the catalogue's own folder, or absolute
    place     which recording of the file; empty where the file is one recording
    object    what is held
    session   person, day or fitting
    recording name of the recording; rows with one name and unlike parts are joined
    part      of the sensors, as left and right
    take      recordings of one object with one text here are held out together; empty: with no
              other
    split     published set: train, validation or test; `by frame` where the file says it
    frames    their number, for reading only
    left_out  why the row is not read; empty where it is
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
#: Columns that only a catalogue has, and no labels.csv.
OWN_COLUMNS = {"place", "left_out"}
BY_FRAME = "by frame"  # in `split`: each frame has its own, in the file
MOST_HEADER = 100_000  # letters of a table's first line
FILE_COLUMN = r"file[ _]?(name|path)?s?|path"  # in small letters
SEPARATORS = ",;\t"
#: An escape of `shown`, or two backslashes for one.
ESCAPE = re.compile(r"\\(\\|[nrt]|x[0-9a-f]{2}|u[0-9a-f]{4}|U[0-9a-f]{8})")
ESCAPED_FORMULA = re.compile(f"'+[{re.escape(''.join(FORMULA))}]")


def check_is_new(file: Path) -> None:
    """Refuse to write a catalogue where a file is, which may hold a person's corrections.

    Raises:
        UserError: there is a file, or the name does not end in .csv.
    """
    if file.suffix.lower() != ".csv":
        raise UserError(f"{file}: a catalogue is read again by its ending; name it {file.stem}.csv")
    if file.exists() or file.is_symlink():
        what = "there is a file of that name, which may hold corrections"
        raise UserError(f"{file}: {what}; name another one")


def catalogue_text(catalogue: pd.DataFrame, folder: Path) -> str:
    """Return a catalogue as CSV, whose paths are relative to a folder.

    Control characters and backslashes are escaped, and an apostrophe stands before what a
    spreadsheet would run as a formula; `names_in_text` takes both back.
    """
    rows: list[list[object]] = [list(COLUMNS)]
    for row in catalogue[list(COLUMNS)].itertuples(index=False):
        cells = list(row)
        cells[0] = relpath(cells[0], folder)
        rows.append([_escaped(str(cell)) for cell in cells])
    return csv_text(rows)


def _escaped(text: str) -> str:
    """Return a text whose escapes can be taken back; `csv_text` adds a formula's apostrophe."""
    text = "".join(r"\\" if letter == "\\" else shown(letter) for letter in text)
    if ESCAPED_FORMULA.match(text):
        # an apostrophe of the name would else be taken for that of `csv_text`
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
    if number > sys.maxunicode:  # no letter: an escape that a person has written
        return escape[0]
    return chr(number)


def names_in_text(file: Path, text: str) -> pd.DataFrame | None:
    """Return the rows of a table that names files and their objects; None for other tables.

    A labels.csv is such a table, and a catalogue.

    Returns:
        Texts, by those of `COLUMNS` that the table has, and `line`, where each row stands.

    Raises:
        UserError: begins with `file`; a row has more cells than the header.
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
    # texts of pandas cannot hold every name of a file
    return pd.DataFrame(rows, columns=["line", *filter(None, kinds)], dtype=object)


def _kinds_of_header(header: list[str]) -> list[str]:
    """Return which of `COLUMNS` each name of a header is; "" for another, and for a second one."""
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

    Raises:
        UserError: begins with `file`; two files of one name have unlike labels, or the table is a
            catalogue, which says more than labels.
    """
    if set(rows.columns) >= OWN_COLUMNS:
        remedy = "give it as the source, or move it out of the folder"
        raise UserError(f"{file}: a catalogue among the recordings; {remedy}")
    kinds = [kind for kind in ("object", "session") if kind in rows]
    for row in rows.to_dict("records"):
        name = PureWindowsPath(row["file"]).stem
        names = {kind: label_text(row[kind]) for kind in kinds}
        if labels.setdefault(name, names) != names:
            raise UserError(
                f"{file}: {name} has two labels; expected a name of its own for each file"
            )


def given_rows(file: Path, rows: pd.DataFrame, form: Form) -> pd.DataFrame:
    """Return the rows of a catalogue that is the source, checked, with the `path` of each file.

    Args:
        file: the catalogue.
        rows: from `names_in_text`.
        form: says whether each recording needs an object.

    Raises:
        UserError: lists what is wrong, each with the number of its line.
    """
    rows = rows.copy()
    for kind in ("object", "session"):
        if kind in rows:
            texts = [label_text(cell) for cell in rows[kind]]
            rows[kind] = pd.Series(texts, index=rows.index, dtype=object)
    if "left_out" in rows:
        rows = rows[[not reason.strip() for reason in rows["left_out"]]].copy()
    if rows.empty:
        raise UserError(f"{file}: names no recording; expected a line for each")
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
            mistakes.append(f"{line}: no object; write it, or delete the line")
        split = row.get("split", "")
        if split and split != BY_FRAME and side_of(split) is None:
            mistakes.append(f"{line}: split is {split!r}; expected train, test or validation")
    return mistakes


def _doubled_rows(rows: pd.DataFrame) -> list[str]:
    """Return which rows are of one recording, though they are not its parts."""
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
            mistakes.append(f"{what}; to join them, write unlike parts, else rename them")
        elif (same[alike] != same[alike].iloc[0]).any(axis=None):
            mistakes.append(f"{_lines(same)} are parts of one recording; write their names alike")
        elif (same["place"] != "").any():
            what = f"{_lines(same)} join recordings that share their files with others"
            mistakes.append(f"{what}; save each as its own file")
    return mistakes


def _alike(rows: pd.DataFrame, keys: list[str]) -> list[pd.DataFrame]:
    """Return the rows in groups of equal keys; by numbers, since pandas cannot group all texts."""
    numbers, _ = pd.factorize(np.array(keys, dtype=object))
    return [same for _, same in rows.groupby(numbers, sort=False)]


def _lines(rows: pd.DataFrame) -> str:
    return f"lines {listed([str(line) for line in rows['line']])}"
