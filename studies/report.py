"""The report of a study: its tables and its pictures."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
import pandas as pd

from studies.cells import Answers
from studies.comparison import complete, power, rows_of
from studies.grid import COLUMNS, Cell, Study
from studies.losses import FALL, LEFT
from studies.pictures import error_curves, errors_by_seconds
from tactile_viewgcn.evaluation.trials import WHOLE
from tactile_viewgcn.files import new_files
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import several
from tactile_viewgcn.params import VIRTUAL, default_params

EXPLAINED = """Errors are in per cent, means over folds, trials and a variant's trainings, each from one seed on all
folds of one deal; every split group counts once. In brackets: the 95 % interval that resamples these groups,
conditional on the trainings; where a view set mixes an object's groups, as under `object`, it is optimistic. `std` is
the standard deviation over the trainings."""
DEALT = """The groups were dealt to the folds in {deals} ways, so that each is tested {deals} times; each is resampled
as one unit."""
COMPARED = """Differences are paired, over the seeds and deals that both were trained on by one kind of machine. Of the
two intervals of 95 % `over groups` resamples the split groups, and `over trainings` is Student's, the range for other
seeds. The verdict needs both. A variant without common trainings is left out."""
TRAINED = f"""Losses of the training: of the first batch, which guesses, and means of the last epoch but one and of the
last; in some systems a loss is the sum of several. A row with † is not trained to its end, and decides nothing: its
loss at the end is above {LEFT:.0%} of guessing, or fell by more than {FALL:.0%} of it in the last epoch. A system that
is not fine-tuned has those of pretraining; one on the sensors has none, nor has its member `network`."""
PAID = """Costs are those of the cheapest training, since other work only adds to them: seconds are summed over folds,
milliseconds are of an answer, the memory is that of the stage that needs most."""


def write_report(
    study: Study, answers: list[Answers], folder: Path, on_top: tuple[str, ...] = ()
) -> str:
    """Write results.csv, results.md and the picture, if any, into `folder`, and return the text of results.md.

    Every cell has the changes `on_top`.

    Raises:
        UserError: variants cannot be compared.
    """
    cells = study.cells(on_top)
    answers, params = (
        complete(answers, len({cell.fold for cell in cells})),
        default_params(cells[0].changes),
    )
    data = "Simulated by the virtual glove" if params.data.source == VIRTUAL else params.data.source
    variants = {each.cell.variant for each in answers}
    places = variants | {variant.partition(" / ")[0] for variant in variants}
    references = [name for name in study.references if name in places]
    rows = rows_of(answers, references)
    tested = [(each.cell, each.predictions.trials) for each in answers]
    groups = len({group for _, trials in tested for group in trials[WHOLE].groups})
    first, deals = answers[0], len({each.cell.deal for each in answers})
    sizes = []
    for asked, what in (("recording", "view set"), (WHOLE, "whole recording")):
        folds = {
            cell.fold: len(trials[asked].labels)
            for cell, trials in tested
            if cell.deal == first.cell.deal
        }
        sizes.append(several(sum(folds.values()), what))
    sizes.append(several(len(first.predictions.classes), "class", "classes"))
    sizes += [several(params.evaluate.trials, "trial"), several(groups, "split group")]
    changed = f" Every cell has {', '.join(f'`{change}`' for change in on_top)}." if on_top else ""
    text = [f"{data}. {study.question}{changed}", power(rows, groups)]
    text.append(f"{', '.join(sizes)} on the {params.evaluate.side} side. {EXPLAINED}")
    text += [DEALT.format(deals=deals)] * (deals > 1)
    if absent := missing(cells, answers):
        text.append(f"Trainings that have not been run: {', '.join(absent)}.")
    text += [COMPARED] * bool(references)
    parts = [*map(_paragraph, text), *tables(rows, references, study.columns)]
    title = f"{data}: {study.question}\nBars: 95 % interval over split groups"
    with new_files(folder) as part:
        rows.drop(columns={*COLUMNS} - {*study.columns}).to_csv(part / "results.csv", index=False)
        (part / "results.md").write_text("\n\n".join(parts) + "\n")
        if study.picture:
            curves = study.picture == "curves"
            figure = (
                error_curves(rows, title) if curves else errors_by_seconds(rows, references, title)
            )
            figure.savefig(part / "results.png", dpi=100)
    return (folder / "results.md").read_text()


def missing(cells: list[Cell], answers: list[Answers]) -> list[str]:
    """Variants of the study with the number of their missing trainings, as in `mean 2 of 5`."""
    # each training once, in order
    planned = dict.fromkeys((cell.variant, cell.seed, cell.deal) for cell in cells)
    finished = {(each.cell.variant, each.cell.seed, each.cell.deal) for each in answers}
    total = Counter(variant for variant, *_ in planned)
    absent = Counter(training[0] for training in planned if training not in finished)
    return [f"{variant} {count} of {total[variant]}" for variant, count in absent.items()]


def tables(rows: pd.DataFrame, references: Sequence[str], columns: Sequence[str]) -> list[str]:
    """The tables as Markdown, each after a line that names it; the last protocol, that of use, comes first."""
    parts, marked = [], rows["variant"].where(rows["trained"], rows["variant"] + " †")
    rows = rows.assign(variant=marked).set_index("variant")
    for protocol in reversed(rows["protocol"].unique()):
        chosen = rows[rows["protocol"] == protocol]
        errors = {"error": _intervals(chosen, "error"), "std": chosen["std"].map("{:.1f}".format)}
        parts += [f"Error, {protocol}:", _markdown(errors | {"trainings": chosen["trainings"]})]
        for name in references:
            vs = f"vs {name} "
            over_trainings = _intervals(chosen, f"{vs}more", f"{vs}seeds_")
            differences = {
                "over groups": _intervals(chosen, f"{vs}more", vs),
                "over trainings": over_trainings.where(chosen[f"{vs}seeds_low"].notna(), ""),
                "verdict": chosen[f"{vs}verdict"],
            }
            compared = chosen[f"{vs}more"].notna()
            if compared.any():
                parts += [
                    f"Points more than `{name}`, {protocol}:",
                    _markdown(differences, compared),
                ]
    once = rows[~rows.index.duplicated()]
    losses = {name: once[name].map("{:.3f}".format) for name in ("guessing", "before", "end")}
    parts += ["Training:", _paragraph(TRAINED), _markdown(losses | {"machine": once["machine"]})]
    if columns:
        parts += [
            "Costs:",
            _paragraph(PAID),
            _markdown({name: once[name].map("{:.3g}".format) for name in columns}),
        ]
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
    return (
        table.loc[:, (table != "").any()]
        .reset_index()
        .to_markdown(index=False, disable_numparse=True)
    )


def _paragraph(text: str) -> str:
    return fill(text, 80, break_on_hyphens=False, break_long_words=False)
