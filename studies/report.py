"""The report of a study: its table, its picture, and where they are asked for confusion and confused pairs."""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from studies.cells import Answers
from studies.comparison import confused_pairs, power, rows_of, sequential_rows
from studies.grid import COLUMNS, Study, name_and_place
from studies.markdown import COMPARED, DEALT, EXPLAINED, paragraph, tables
from studies.pictures import error_curves, errors_by_cost, errors_by_variant, side_by_side
from studies.variants import Variant, pooled
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.markdown_tables import describe_data, write_csv, write_table
from tactile_viewgcn.params import load
from tactile_viewgcn.plots import confusions
from tactile_viewgcn.randomness import stream

REHEARSAL = "**A rehearsal on tiny data: it shows that the study runs, and nothing else.**"


def write_report(
    study: Study, answers: list[Answers], folder: Path, *, rehearsal: bool = False, on_top: tuple[str, ...] = ()
) -> str:
    """results.csv, results.md and results.png in `folder`, confusion and pairs where asked for; the text of results.md.

    Raises:
        UserError: variants that cannot be compared.
    """
    params = load("params.yaml", answers[0].cell.changes)
    data, variants = describe_data(params.data), pooled(answers)
    finished = {part for variant in variants for part in (variant.name, name_and_place(variant.name)[0])}
    references = [name for name in study.references if name in finished]
    rows = rows_of(variants, references, stream(params.seed, f"study.{study.name}"))
    sequential = sequential_rows(variants)
    classes = list(dict.fromkeys(str(name) for each in answers for name in each.predictions.classes))
    longest = max(variants, key=lambda variant: len(variant.trainings))
    tested, deals = longest.tested(), len({deal for _, deal in longest.trainings})
    groups = len(np.unique(tested[1]))
    changed = f" Every cell has {', '.join(f'`{change}`' for change in on_top)}." if on_top else ""
    text = [f"{data}. {study.question}{changed}", *([REHEARSAL] if rehearsal else []), power(rows, groups)]
    size = (
        f"{tested.shape[1]:,} view sets, {len(classes)} classes, {params.evaluate.trials} trials, {groups} split groups"
    )
    text.append(f"{size} on the {params.evaluate.side} side. {EXPLAINED}")
    text += [DEALT.format(deals=deals)] * (deals > 1)
    if absent := [] if rehearsal else missing(study, variants, on_top):
        text.append(f"Trainings that have not been run: {', '.join(absent)}.")
    if references:
        text.append(COMPARED.format(groups=groups, least=max(2.0**-groups * 2, 1e-4)))
    parts = [*map(paragraph, text), *tables(rows, sequential, study.columns)]
    write_csv(folder / "results.csv", _flat([*rows, *sequential], study.columns))
    with atomic_write(folder / "results.md") as part:
        part.write_text("\n\n".join(parts) + "\n")
    title = f"{'Rehearsal. ' if rehearsal else ''}{data}: {study.question}\nBars: 95 % interval over split groups"
    draw = {"error": errors_by_variant, "seconds": errors_by_cost, "curves": error_curves}[study.picture]
    _save(draw([row for row in rows if row["weighting"] == "frame"], sequential, title), folder / "results.png")
    if study.confusion:
        _write_confusion(data, variants, classes, references, folder)
    return (folder / "results.md").read_text()


def missing(study: Study, variants: list[Variant], on_top: tuple[str, ...]) -> list[str]:
    """Variants of the study with how many of their trainings are not here, `mean 2 of 5`."""
    cells, here = study.cells(on_top=on_top), {variant.name: len(variant.trainings) for variant in variants}
    planned = Counter(variant for variant, _ in {(cell.variant, (cell.seed, cell.deal)) for cell in cells})
    absent = {name: planned[name] - here.get(name, 0) for name in dict.fromkeys(cell.variant for cell in cells)}
    return [f"{name} {count} of {planned[name]}" for name, count in absent.items() if count]


def _flat(rows: list[dict[str, Any]], columns: list[str]) -> list[dict[str, Any]]:
    """Rows of one table with the same keys: a difference to R as `vs R more`, ..., costs by `columns` alone."""
    flat = []
    for row in rows:
        versus = {f"vs {name} {key}": x for name, each in row.get("versus", {}).items() for key, x in each.items()}
        flat.append(
            {key: x for key, x in row.items() if key != "versus" and key not in {*COLUMNS} - {*columns}} | versus
        )
    keys = dict.fromkeys(key for row in flat for key in row)
    return [dict.fromkeys(keys, "") | row for row in flat]


def _write_confusion(
    data: str, variants: list[Variant], classes: list[str], references: list[str], folder: Path
) -> None:
    """The confusion of the best variant and of the references, and the objects that the best one confuses most."""
    protocol = list(variants[0].answers[0].predictions.predicted)[-1]
    error = {variant.name: 1 - float(variant.correct(protocol).mean()) for variant in variants}
    best = min(variants, key=lambda variant: error[variant.name])
    pairs = confused_pairs(best.confusion(protocol, classes), classes)
    text = f"{data}. The objects that `{best.name}` takes for each other most, {protocol} protocol."
    write_table(folder, pairs, text, name="pairs")
    shown = [best, *(variant for variant in variants if variant.name in references and variant is not best)]
    counts = {f"{each.name}: error {100 * error[each.name]:.1f} %": each.confusion(protocol, classes) for each in shown}
    picture = confusions(counts, classes)
    picture.suptitle(f"{data}, {protocol} protocol")
    _save(picture, folder / "confusion.png")
    title = f"{data}: mean frames of the pairs that {best.name} confuses most"
    _save(side_by_side(pairs, best, title), folder / "pairs.png")


def _save(figure: Figure, path: Path) -> None:
    with atomic_write(path) as part:
        figure.savefig(part, format="png", dpi=100)
