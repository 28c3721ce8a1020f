"""Texts that hold numbers and are no table: what serial monitors and spreadsheets save."""

import re
from io import StringIO
from itertools import islice
from pathlib import Path
from shlex import quote

from tactile_viewgcn.messages import UserError

TOP = 200  # lines that are looked at
#: What lines are that are no cells, and the command of sed that makes cells of them
FORMS = {
    r"\s*\d\d?:\d\d:\d\d\S* *->": (
        "lines begin with a clock and an arrow, as of a serial monitor",
        "s/^.*->//",
    ),
    r"\s*[A-Za-z_]\w*[:=] *[-+]?\d[^:=]*[A-Za-z_]\w*[:=] *[-+]?\d": (
        "cells are a name and a number",
        "s/[A-Za-z_][A-Za-z0-9_]*[:=] *//g",
    ),
    r'\s*"[^"]*[,;\t ][^"]*"\s*\Z': ("each line stands in quotes", 's/"//g'),
    r"\s*[\[(][-+.,;\s\de]*[\])][,;]?\s*\Z": ("each line stands in brackets", "s/[][()]//g"),
    r"\s*(>+|[a-z]*\$) *[-+]?\d": ("lines begin with a prompt", "s/^[^0-9+-]*//"),
}


def check_is_table(file: Path, text: str) -> None:
    """Raise a UserError where the lines of a text are no cells of a table; it has the line to type.

    Lines are of such a form where more than half of those at the top are, and hold two numbers or
    more.
    """
    lines = [line for line in islice(StringIO(text), TOP) if len(re.findall(r"\d+", line)) > 1]
    for form, (what, change) in FORMS.items():
        if sum(re.match(form, line) is not None for line in lines) > len(lines) / 2:
            remedy = f"sed -i.bak -E {quote(change)} {quote(str(file))}"
            raise UserError(f"{file}: {what}; expected a table of numbers; make one: {remedy}")
