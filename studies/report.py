"""The report of a study: its table, its picture, and where they are asked for confusion and confused pairs."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from studies.cells import Answers
from studies.comparison import Variant, confused_pairs, pooled, power, rows_of, sequential_rows
from studies.grid import COLUMNS, Study
from studies.pictures import errors_by_cost, errors_by_variant, side_by_side
from tactile_viewgcn.files import atomic_write
from tactile_viewgcn.params import load
from tactile_viewgcn.plots import confusions
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.tables import describe_data, write_table

EXPLAINED = """{sets:,} view sets, {classes} classes, {trials} trials, {groups} split groups on the {side} side. `error`
in per cent is the mean over trainings and trials; `low` and `high` are the 95 % interval that resamples these groups,
conditional on the trainings; under `object`, where a view set mixes an object's recordings, it is optimistic. `std` is
the standard deviation over the trainings of a variant."""
COMPARED = """`more` is the paired difference in points to `{reference}` over the seeds that both were trained from;
`p` says how often groups with their signs turned differ as much, corrected for the number of rows of a protocol (Holm
1979). With {groups} groups it is never below {least:.2g} before that."""
PAID = """Costs are medians over the trainings: seconds are summed over folds, milliseconds are per view set, the memory
is that of the hungriest stage."""
SEQUENTIAL = """Rows with `frames` take frames of one recording in random order, one after the other, up to all views or
until the classifier is confident enough; `frames` is their mean number."""
REHEARSAL = "**A rehearsal on tiny data: it shows that the study runs, and nothing else.**"


def write_report(study: Study, answers: list[Answers], folder: Path, *, rehearsal: bool = False) -> str:
    """results.csv, results.md and results.png in `folder`, confusion and pairs where asked for; the table's text.

    Raises:
        UserError: variants that cannot be compared.
    """
    params = load("params.yaml", answers[0].cell.changes)
    data, variants = describe_data(params.data), pooled(answers)
    reference = study.reference if study.reference in [variant.name for variant in variants] else None
    rows = rows_of(variants, reference, stream(params.seed, f"study.{study.name}"))
    sequential = sequential_rows(variants)
    classes = list(dict.fromkeys(str(name) for each in answers for name in each.predictions.classes))
    tested = variants[0].tested
    groups = len(np.unique(tested[1]))
    size = {"sets": tested.shape[1], "classes": len(classes), "groups": groups, "side": params.evaluate.side}
    text = [f"{data}. {study.question}", *([REHEARSAL] if rehearsal else []), power(rows, groups)]
    text.append(EXPLAINED.format(trials=params.evaluate.trials, **size))
    if reference:
        text.append(COMPARED.format(reference=reference, groups=groups, least=max(2.0**-groups * 2, 1e-4)))
    text += [PAID] * bool(study.columns) + [SEQUENTIAL] * bool(sequential)
    rows = [dict.fromkeys([*rows[0], "frames"], "") | row for row in [*rows, *sequential]]
    hidden = set(COLUMNS) - set(study.columns) | (set() if sequential else {"frames"})
    write_table(folder, [{key: row[key] for key in row if key not in hidden} for row in rows], "\n\n".join(text))
    title = f"{'Rehearsal. ' if rehearsal else ''}{data}: {study.question}\nBars: 95 % interval over split groups"
    draw = errors_by_cost if study.picture == "seconds" else errors_by_variant
    _save(draw(rows, title), folder / "results.png")
    if study.confusion:
        _write_confusion(data, variants, classes, reference, folder)
    return (folder / "results.md").read_text()


def _write_confusion(
    data: str, variants: list[Variant], classes: list[str], reference: str | None, folder: Path
) -> None:
    """The confusion of the best variant and of the reference, and the objects that the best one confuses most."""
    protocol = list(variants[0].answers[0].predictions.predicted)[-1]
    best = min(variants, key=lambda variant: variant.error(protocol))
    pairs = confused_pairs(best.confusion(protocol, classes), classes)
    text = f"{data}. The objects that `{best.name}` takes for each other most, {protocol} protocol."
    write_table(folder, pairs, text, name="pairs")
    shown = [best, *(variant for variant in variants if variant.name == reference and variant is not best)]
    counts = {
        f"{each.name}: error {100 * each.error(protocol):.1f} %": each.confusion(protocol, classes) for each in shown
    }
    picture = confusions(counts, classes)
    picture.suptitle(f"{data}, {protocol} protocol")
    _save(picture, folder / "confusion.png")
    title = f"{data}: mean frames of the pairs that {best.name} confuses most"
    _save(side_by_side(pairs, best, title), folder / "pairs.png")


def _save(figure: Figure, path: Path) -> None:
    with atomic_write(path) as part:
        figure.savefig(part, format="png", dpi=100)
