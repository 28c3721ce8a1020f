"""Find numbers with two readings in a text: 1,012 can be a thousand and twelve, or about one."""

import json
import re
from io import StringIO
from pathlib import Path
from shlex import quote

from tactile_viewgcn.messages import UserError

# marks that stand between groups of three digits, and nowhere else in a number
GROUP_MARKS = "\u202f\u00a0\u2009'\u2019"
#: A number with exactly three digits after each mark; `format` puts in the {mark}.
GROUPED = r"(?<![\w.,:])[-+]?[1-9]\d{{0,2}}(?:[{mark}]\d{{3}})+(?![\w.,:])"
#: A number with the {mark} but without such groups, so that the mark must be decimal.
DECIMAL = (
    r"(?<![\w.,:])[-+]?(?:0\d*[{mark}]\d+|\d{{4,}}[{mark}]\d+"
    r"|\d+[{mark}](?:\d{{1,2}}|\d{{4,}}))(?![\d.,:])"
)
GROUPED_BY_BLANKS = r"[-+]?[1-9]\d{0,2}(?: \d{3})+"
#: A cell whose digits stand in groups of three, such as 1'012 or 1 012. A fraction can follow after
#: another mark, as in 1.012,5.
GROUPED_CELL = rf"[-+]?[1-9]\d{{0,2}}([ .,{GROUP_MARKS}])\d{{3}}(?:\1\d{{3}})*(?:(?!\1)[.,]\d+)?"
BLANKS = r"\s+"
WITHOUT_MARKS = "write it without marks between its digits"
QUOTED = r'"\s*[-+]?\d+(?:,\d+)+(?:\.\d*)?\s*"'


def check_numerals(file: Path, text: str, separator: str | None, above: int) -> None:
    """Refuse a text in which a number has two readings.

    If commas separate the cells, a number has two readings if it has a comma inside quotes. In any
    other table, it has two readings if its digits stand in groups of three. An exception is a mark
    that another number shows to be decimal. A point is suspicious only if the same column has whole
    numbers too.

    Args:
        file: the file, which errors name.
        text: the text of the file, without its comments.
        separator: the separator of its cells; None for blanks.
        above: the number of lines above the numbers.

    Raises:
        UserError: names the first such number, and gives a command for each of its readings.
    """
    start = 0
    for _ in range(above):
        start = text.find("\n", start) + 1
    found = None
    if separator == ",":
        found = re.compile(QUOTED).search(text, start)
    else:
        for mark in (",", "."):
            found = found or _with_groups(text, start, separator, mark)
    if not found and any(mark in text for mark in GROUP_MARKS):
        found = re.compile(GROUPED.format(mark=GROUP_MARKS)).search(text, start)
    if found:
        raise UserError(f"{file}: {_two_readings(file, text, found, separator, above)}")


def without_group_marks(file: str, cell: str) -> str:
    """Return the command that takes the marks out of the groups of digits in a file.

    It is "" if the cell has no groups.
    """
    grouped = re.fullmatch(GROUPED_CELL, cell.strip())
    if not grouped:
        return ""
    pattern = rf"(?<=\d){re.escape(grouped[1])}(?=\d\d\d)"
    path = f"p = pathlib.Path({json.dumps(file)})"
    changed = f"re.sub({json.dumps(pattern)}, str(), p.read_text())"
    code = f"import pathlib, re; {path}; p.write_text({changed})"
    return f"python -c {quote(code)}"


def _with_groups(text: str, start: int, separator: str | None, mark: str) -> re.Match[str] | None:
    """Return the first number from `start` whose digits can be groups of three; None without any.

    It is None too if another number shows that the mark is decimal.
    """
    if text.find(mark, start) < 0 or re.compile(DECIMAL.format(mark=mark)).search(text, start):
        return None
    found = re.compile(GROUPED.format(mark=mark)).search(text, start)
    if mark == "." and found and not _is_mixed(text[start:], separator):
        return None
    return found


def _is_mixed(text: str, separator: str | None) -> bool:
    """Return whether a column has both whole numbers of three digits and numbers with a point.

    An example is a column with 987 and 1.012.
    """
    with_point = set[int]()
    whole = set[int]()
    for line in StringIO(text):
        for column, cell in enumerate(line.strip().split(separator)):
            if re.fullmatch(r"[-+]?\d{3}", cell.strip()):
                whole.add(column)
            elif "." in cell:
                with_point.add(column)
    return bool(with_point & whole)


def _two_readings(
    file: Path, text: str, found: re.Match[str], separator: str | None, above: int
) -> str:
    """Return a text with the place of a number, its two readings, and a command for each."""
    number = found[0].strip('" ')
    mark = next(letter for letter in number if letter in f",.{GROUP_MARKS}")
    line = text.count("\n", 0, found.start()) + 1
    before = text[text.rfind("\n", 0, found.start()) + 1 : found.start()]
    between_cells = r"\s+(?=\S)"
    if separator:
        between_cells = re.escape(separator)
    column = len(re.findall(between_cells, before)) + 1
    remedies = list[str]()
    if re.fullmatch(GROUPED.format(mark=mark), number):
        thousands = _rewriting(file, separator, above, "thousands", mark)
        remedies.append(f"if it is {number.replace(mark, '')}: {thousands}")
    if mark in ",." and number.count(mark) == 1:
        whole, _, fraction = number.partition(mark)
        decimal = _rewriting(file, separator, above, "decimal", mark)
        remedies.append(f"if it is {whole}.{fraction}: {decimal}")
    what = f"line {line}, column {column} is {number!r}, which has two readings"
    return f"{what}; {'; '.join(remedies) or WITHOUT_MARKS}"


def _rewriting(file: Path, separator: str | None, above: int, option: str, mark: str) -> str:
    """Return the command that writes a file again with its numbers in plain form.

    The lines above the numbers stay.
    """
    # double quotes, since the shell's single quotes stand around the command
    path = json.dumps(str(file))
    if mark in GROUP_MARKS:  # pandas takes no mark of several bytes
        changed = f"p.read_text().replace({json.dumps(mark)}, str())"
        code = f"import pathlib; p = pathlib.Path({path}); p.write_text({changed})"
        return f"python -c {quote(code)}"
    options = {"sep": separator or BLANKS, option: mark}
    read_as = ", ".join(f"{name}={json.dumps(value)}" for name, value in options.items())
    write_as = f"sep={json.dumps(separator or ' ')}, index=False, header=False"
    opened = "open"
    if file.suffix == ".gz":
        opened = '__import__("gzip").open'
    code = (
        f'import pandas; f = {path}; top = {opened}(f, "rt").readlines()[:{above}]; '
        f"t = pandas.read_csv(f, {read_as}, header=None, skiprows={above}); "
        f'{opened}(f, "wt").writelines([*top, t.to_csv({write_as})])'
    )
    return f"python -c {quote(code)}"
