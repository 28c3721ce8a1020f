"""Recognise texts with numbers that are no table, as serial monitors and spreadsheets save them."""

import re
from io import StringIO
from itertools import islice
from pathlib import Path
from shlex import quote

from tactile_viewgcn.messages import UserError

TOP = 200  # lines that are checked
#: A pattern of lines that are no cells: what they look like, and the sed command that makes cells
FORMS = {
    r"\s*\d\d?:\d\d:\d\d\S* *->": (
        "lines begin with a clock time and an arrow, as from a serial monitor",
        "s/^.*->//",
    ),
    r"\s*[A-Za-z_]\w*[:=] *[-+]?\d[^:=]*[A-Za-z_]\w*[:=] *[-+]?\d": (
        "each cell is a name and a number",
        "s/[A-Za-z_][A-Za-z0-9_]*[:=] *//g",
    ),
    r'\s*"[^"]*[,;\t ][^"]*"\s*\Z': ("each line stands in quotes", 's/"//g'),
    r"\s*[\[(][-+.,;\s\de]*[\])][,;]?\s*\Z": ("each line stands in brackets", "s/[][()]//g"),
    r"\s*(>+|[a-z]*\$) *[-+]?\d": ("lines begin with a prompt", "s/^[^0-9+-]*//"),
}


def check_is_table(file: Path, text: str) -> None:
    """Refuse a text whose lines are no cells of a table.

    Only lines with at least two numbers are checked, at the top of the text. More than half of them
    must match one of `FORMS`.

    Raises:
        UserError: gives the command that makes a table of the text.
    """
    lines = [line for line in islice(StringIO(text), TOP) if len(re.findall(r"\d+", line)) > 1]
    for form, (what, change) in FORMS.items():
        if sum(re.match(form, line) is not None for line in lines) > len(lines) / 2:
            remedy = f"sed -i.bak -E {quote(change)} {quote(str(file))}"
            raise UserError(f"{file}: {what}; to make a table of numbers: {remedy}")
