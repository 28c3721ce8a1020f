"""The text of a study's report: what its numbers mean, and its tables, which fit a terminal of 80 columns."""

from itertools import chain
from textwrap import fill
from typing import Any

from studies.comparison import WEIGHTINGS

EXPLAINED = """Errors are in per cent, means over trials and over a variant's trainings, each from one seed on all
folds of one deal. `per frame` counts every anchor once, `per group` every split group once. In brackets: the 95 %
interval that resamples these groups, conditional on the trainings; under `object`, where a view set mixes an object's
recordings, it is optimistic. `std` is the standard deviation over the trainings, per frame."""
DEALT = """The groups were dealt to the folds in {deals} ways, so that each is tested {deals} times; it is resampled as
one."""
COMPARED = """Differences are paired, over the seeds and deals that both were trained on. `p` says how often groups with
their signs turned differ as much, corrected for all differences of a protocol and a weighting (Holm 1979); before that
it is never below {least:.2g} with {groups} groups."""
OVER_TRAININGS = """The same with the 95 % interval over trainings (Student's t): what other seeds would give, not other
recordings:"""
PAID = """Costs are medians over the trainings: seconds are summed over folds, milliseconds are per view set, the memory
is that of the hungriest stage."""
SEQUENTIAL = """Frames of one recording are taken in random order, one after the other, up to all views or until the
classifier is confident enough; `frames` is their mean number."""


def tables(rows: list[dict[str, Any]], sequential: list[dict[str, Any]], columns: list[str]) -> list[str]:
    """The tables, each after a line that names it.

    Args:
        rows: see `comparison.rows_of`; sequential: see `comparison.sequential_rows`.
        columns: costs to show.
    """
    parts = []
    for protocol in reversed(list(dict.fromkeys(row["protocol"] for row in rows))):  # the user's one first
        variants: dict[str, list[dict[str, Any]]] = {}  # the rows of each, one a weighting
        for row in rows:
            if row["protocol"] == protocol:
                variants.setdefault(row["variant"], []).append(row)
        parts += [f"Error, {protocol} protocol:", _errors(variants)]
        for reference in rows[0]["versus"]:
            if any(each[0]["versus"][reference]["more"] != "" for each in variants.values()):
                parts += [f"Points more than `{reference}`, {protocol} protocol:", _differences(variants, reference)]
                if any(each[0]["versus"][reference]["seeds_low"] != "" for each in variants.values()):
                    parts += [paragraph(OVER_TRAININGS), _over_trainings(variants, reference)]
    if columns:
        once = {row["variant"]: row for row in rows}.values()
        lines = [[row["variant"], *(f"{row[key]:.3g}" for key in columns)] for row in once]
        parts += ["Costs:", paragraph(PAID), table(["variant", *columns], lines)]
    if sequential:
        lines = [[row["variant"], f"{row['frames']:.2f}", _interval(row)] for row in sequential]
        parts += [
            "Frame by frame, recording protocol:",
            paragraph(SEQUENTIAL),
            table(["variant", "frames", "error"], lines),
        ]
    return parts


def paragraph(text: str) -> str:
    """A text in lines of 80 columns."""
    return fill(text, 80, break_on_hyphens=False, break_long_words=False)


def table(header: list[str], lines: list[list[str]]) -> str:
    """A Markdown table with columns of equal width; one without any content is left out."""
    columns = [column for column in zip(header, *lines, strict=True) if any(column[1:])]
    widths = [max(map(len, column)) for column in columns]
    padded = [[text.ljust(width) for text in column] for column, width in zip(columns, widths, strict=True)]
    first, *others = (" | ".join(line).rstrip() for line in zip(*padded, strict=True))
    return "\n".join([first, " | ".join("-" * width for width in widths), *others])


def _errors(variants: dict[str, list[dict[str, Any]]]) -> str:
    """The errors in each weighting, and how the trainings spread."""
    lines = [
        [name, *map(_interval, of), f"{of[0]['std']:.1f}" if of[0]["std"] != "" else "", str(of[0]["trainings"])]
        for name, of in variants.items()
    ]
    return table(["variant", *(f"per {weighting}" for weighting in WEIGHTINGS), "std", "trainings"], lines)


def _differences(variants: dict[str, list[dict[str, Any]]], reference: str) -> str:
    """The differences to a reference in each weighting, of the variants that have one."""
    lines = []
    for name, of in variants.items():
        versus = [row["versus"][reference] for row in of]
        if versus[0]["more"] != "":
            ps = ("<.001" if each["p"] < 0.001 else f"{each['p']:.3f}" for each in versus)
            lines.append(
                [name, *chain.from_iterable(zip((_interval(each, "more") for each in versus), ps, strict=True))]
            )
    return table(["variant", *chain.from_iterable((f"per {weighting}", "p") for weighting in WEIGHTINGS)], lines)


def _over_trainings(variants: dict[str, list[dict[str, Any]]], reference: str) -> str:
    """The differences to a reference per frame, with the interval over trainings."""
    compared = ((name, of[0]["versus"][reference]) for name, of in variants.items())
    lines = [[name, _interval(each, "more", "seeds_")] for name, each in compared if each["seeds_low"] != ""]
    return table(["variant", "per frame"], lines)


def _interval(row: dict[str, Any], key: str = "error", ends: str = "") -> str:
    """A number and its interval, `low` to `high` with `ends` before these names."""
    low, high = (row.get(f"{ends}{end}", "") for end in ("low", "high"))
    return f"{row[key]:.1f}" if low == "" else f"{row[key]:.1f} ({low:.1f} to {high:.1f})"
