"""The report of a study: its tables and its pictures."""

import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from studies.cells import Answers
from studies.comparison import WEIGHTINGS, Variant, on_fronts, pooled, power, rows_of, sequential_rows, with_seconds
from studies.grid import COLUMNS, Study
from studies.pictures import error_curves, errors_by_cost, errors_by_variant
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import several
from tactile_viewgcn.params import VIRTUAL, load
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.schema import as_change

REHEARSAL = "**A rehearsal on tiny data: it shows that the study runs, and nothing else.**"
EXPLAINED = """Errors are in per cent, means over trials and over a variant's trainings, each from one seed on all
folds of one deal. `per frame` counts every anchor once, `per group` every split group once. In brackets: the 95 %
interval that resamples these groups, conditional on the trainings; where a view set mixes an object's groups, as under
`object` or with two grasps, it is optimistic. `std` is the standard deviation over the trainings, per frame."""
DEALT = """The groups were dealt to the folds in {deals} ways, so that each is tested {deals} times; each is resampled
as one unit."""
COMPARED = """Differences are paired, over the seeds and deals that both were trained on. `p` says how often groups with
their signs flipped differ as much, corrected for all differences of a protocol and a weighting (Holm 1979); before that
it is never below {least:.2g} with {groups}. `over trainings` is Student's 95 % interval of the difference per
frame: the range for other seeds, not for other recordings."""
PAID = """Costs are the least over the trainings, since other work only adds to them: seconds are summed over folds,
milliseconds are of an answer, the memory is that of the stage that needs most."""
SEQUENTIAL = """First a fixed number of frames of each view set; then frames of one recording in random order, one by
one, until the classifier is confident enough. `frames` is their mean number."""


def write_report(
    study: Study, answers: list[Answers], folder: Path, *, rehearsal: bool = False, on_top: tuple[str, ...] = ()
) -> str:
    """Write results.csv, results.md and the pictures into `folder`, and return the text of results.md.

    Raises:
        UserError: variants cannot be compared.
    """
    params = load("params.yaml", answers[0].cell.changes)
    data = "Simulated by the virtual glove" if params.data.source == VIRTUAL else params.data.source
    variants = pooled(answers)
    finished = {part for variant in variants for part in (variant.name, variant.name.partition(" / ")[0])}
    references = [name for name in study.references if name in finished]
    rows = rows_of(variants, references, stream(params.seed, f"study.{study.name}"))
    sequential = sequential_rows(variants)
    longest = max(variants, key=lambda variant: len(variant.trainings))
    tested, deals = longest.tested(longest.trainings), len({deal for _, deal in longest.trainings})
    groups = len(np.unique(tested[1]))
    classes = {str(name) for each in answers for name in each.predictions.classes}
    changed = f" Every cell has {', '.join(f'`{change}`' for change in on_top)}." if on_top else ""
    text = [f"{data}. {study.question}{changed}", *([REHEARSAL] if rehearsal else []), power(rows, groups)]
    sizes = (tested.shape[1], "view set"), (len(classes), "class", "classes"), (params.evaluate.trials, "trial")
    size = ", ".join([*(several(*each) for each in sizes), several(groups, "split group")])
    text.append(f"{size} on the {params.evaluate.side} side. {EXPLAINED}")
    text += [DEALT.format(deals=deals)] * (deals > 1)
    if absent := [] if rehearsal else missing(study, variants, on_top):
        text.append(f"Trainings that have not been run: {', '.join(absent)}.")
    if references:
        text.append(COMPARED.format(groups=several(groups, "group"), least=max(2.0**-groups * 2, 1e-4)))
    parts = [*map(_paragraph, text), *tables(rows, sequential, references, study.columns)]
    if study.picture == "seconds":
        parts += ["The Pareto fronts of the pictures, as they are typed:", front_lines(study, rows, on_top)]
    shown = pd.concat([rows, sequential]).drop(columns={*COLUMNS} - {*study.columns})
    with atomic_write(folder / "results.csv") as part:
        shown.to_csv(part, index=False)
    with atomic_write(folder / "results.md") as part:
        part.write_text("\n\n".join(parts) + "\n")
    title = f"{'Rehearsal. ' if rehearsal else ''}{data}: {study.question}\nBars: 95 % interval over split groups"
    for name, figure in pictures(study, rows[rows["weighting"] == "frame"], sequential, references, title).items():
        with atomic_write(folder / name) as part:
            figure.savefig(part, format="png", dpi=100)
    return (folder / "results.md").read_text()


def pictures(
    study: Study, rows: pd.DataFrame, sequential: pd.DataFrame, references: Sequence[str], title: str
) -> dict[str, Figure]:
    """The study's pictures by the names of their files."""
    if study.picture == "curves":
        return {"results.png": error_curves(rows, title)}
    if study.picture == "seconds":
        costs = {
            "results.png": ("seconds", "seconds of both trainings"),
            "answers.png": ("ms alone", "ms of an answer, alone"),
        }
        return {name: errors_by_cost(rows, *cost, references, title) for name, cost in costs.items()}
    return {"results.png": errors_by_variant(pd.concat([rows, sequential]), title)}


def front_lines(study: Study, rows: pd.DataFrame, on_top: tuple[str, ...]) -> str:
    """The variants on a front of the pictures, each with the command that trains it, as a block of a shell."""
    rows = rows[rows["weighting"] == "frame"]
    lines = [f"study=({words_of(study.set, on_top)})"]
    for name in on_fronts(rows):
        of_one = with_seconds(rows[rows["variant"] == name])
        figures = [f"{row['protocol']} {row['error']:.1f} %" for _, row in of_one.iterrows()]
        figures += [f"{of_one['seconds'].iloc[0]:.3g} s", f"{of_one['ms alone'].iloc[0]:.2g} ms"]
        lines += [f"# {name}: {', '.join(figures)}"]
        lines += [f'dvc exp run --temp "${{study[@]}}" {words_of(study.changes_of(name))}'.rstrip()]
    return "\n".join(["```bash", *lines, "```"])


def words_of(changes: dict[str, Any], on_top: tuple[str, ...] = ()) -> str:
    """Changes of a study's file, and further ones, as a shell takes them: presets, and options `-S key=value`."""
    presets = [f"$(tactile-viewgcn preset {value})" for key, value in changes.items() if key == "preset"]
    options = [*(as_change(key, value) for key, value in changes.items() if key != "preset"), *on_top]
    return " ".join([*presets, *(f"-S {shlex.quote(option)}" for option in options)])


def missing(study: Study, variants: list[Variant], on_top: tuple[str, ...]) -> list[str]:
    """Variants of the study with the number of their missing trainings, as in `mean 2 of 5`."""
    planned = Counter(name for name, *_ in {(one.variant, one.seed, one.deal) for one in study.cells(on_top=on_top)})
    here = {variant.name: len(variant.trainings) for variant in variants}
    absent = {name: planned[name] - here.get(name, 0) for name, _ in study.crossed()}
    return [f"{name} {count} of {planned[name]}" for name, count in absent.items() if count]


def tables(
    rows: pd.DataFrame, sequential: pd.DataFrame, references: Sequence[str], columns: Sequence[str]
) -> list[str]:
    """The tables as Markdown, each after a line that names it; the last protocol, that of use, comes first."""
    parts = []
    for protocol in reversed(rows["protocol"].unique()):
        frame, group = (
            rows[(rows["protocol"] == protocol) & (rows["weighting"] == weighting)].set_index("variant")
            for weighting in WEIGHTINGS
        )
        errors = {"per frame": _intervals(frame, "error"), "per group": _intervals(group, "error")}
        errors |= {"std": frame["std"].map("{:.1f}".format), "trainings": frame["trainings"]}
        parts += [f"Error, {protocol} protocol:", _markdown(errors)]
        for name in references:
            vs = f"vs {name} "
            differences: dict[str, pd.Series] = {}
            for weighting, part in zip(WEIGHTINGS, (frame, group), strict=True):
                differences |= {f"per {weighting}": _intervals(part, f"{vs}more", vs)}
                differences |= {f"p, {weighting}": part[f"{vs}p"].map("{:.3f}".format).replace("0.000", "<.001")}
            over_trainings = _intervals(frame, f"{vs}more", f"{vs}seeds_")
            differences["over trainings"] = over_trainings.where(frame[f"{vs}seeds_low"].notna(), "")
            compared = frame[f"{vs}more"].notna()
            if compared.any():
                parts += [f"Points more than `{name}`, {protocol} protocol:", _markdown(differences, compared)]
    if columns:
        once = rows.drop_duplicates("variant").set_index("variant")
        parts += ["Costs:", _paragraph(PAID), _markdown({name: once[name].map("{:.3g}".format) for name in columns})]
    if len(sequential):
        by_name = sequential.set_index("variant")
        taken = {"frames": by_name["frames"].map("{:.2f}".format), "error": _intervals(by_name, "error")}
        parts += ["Frame by frame, recording protocol:", _paragraph(SEQUENTIAL), _markdown(taken)]
    return parts


def _intervals(rows: pd.DataFrame, key: str, ends: str = "") -> pd.Series:
    """The column `key` of each row in per cent with its interval, the columns `low` and `high` after `ends`."""

    def text(row: pd.Series) -> str:
        value, low, high = (row[name] / 100 for name in (key, f"{ends}low", f"{ends}high"))
        return percent_interval(value, *((None, None) if np.isnan(low) else (low, high)))

    return rows.apply(text, axis=1)


def _markdown(columns: dict[str, pd.Series], chosen: pd.Series | None = None) -> str:
    """A table of the variants, or of the chosen ones, without blank columns."""
    table = pd.DataFrame(columns).replace("nan", "")
    table = table if chosen is None else table[chosen]
    return table.loc[:, (table != "").any()].reset_index().to_markdown(index=False, disable_numparse=True)


def _paragraph(text: str) -> str:
    return fill(text, 80, break_on_hyphens=False, break_long_words=False)
