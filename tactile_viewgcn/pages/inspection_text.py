"""An inspection as text of 80 columns, which ends with the command to use and the reason of each setting."""

import textwrap
from collections.abc import Iterable

from tactile_viewgcn.pages.inspection_facts import Table, command_lines, facts, tables, verdict, warnings
from tactile_viewgcn.pages.source_inspection import Overview

WIDTH = 80
NAME = 24  # letters of an object's or session's name


def inspection_lines(overview: Overview) -> list[str]:
    """The inspection, and what to set."""
    lines = [str(overview.path), *_wrapped(f"{figure} {what}" for figure, what in facts(overview))]
    for table in tables(overview):
        lines += [table.title, *_aligned(table), *_wrapped([table.remark])]
    warned = warnings(overview)
    judged = verdict(overview, warned)
    lines += ["Can they be used?", *_wrapped([" ".join([judged.answer, *judged.reasons]), *warned])]
    if command := command_lines(overview):
        lines.append("Until then, to try out the commands" if judged.kind == "bad" else "To use")
        lines += [*_wrapped(map(str, overview.settings)), "", *command]
    return lines


def _wrapped(texts: Iterable[str]) -> list[str]:
    wrapper = textwrap.TextWrapper(WIDTH, initial_indent="  ", subsequent_indent="    ")
    return [line for text in texts for line in wrapper.wrap(text)]


def _aligned(table: Table) -> list[str]:
    """Header and rows, the first column to the left and the others to the right."""
    rows = [
        [name if len(name) <= NAME else f"{name[: NAME - 1]}…", *cells] for name, *cells in [table.header, *table.rows]
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(
            ["", name.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(cells, widths[1:], strict=True))]
        )
        for name, *cells in rows
    ]
