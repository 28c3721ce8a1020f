"""The report of a study: its tables and its pictures."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd

from studies.cells import Answers
from studies.comparison import ENOUGH_SEEDS, complete, power, rows_of
from studies.grid import COLUMNS, Cell, Study
from studies.losses import FALL, LEFT
from studies.pictures import error_curves, errors_by_seconds
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE
from tactile_viewgcn.files import new_files
from tactile_viewgcn.intervals import percent_interval
from tactile_viewgcn.messages import several
from tactile_viewgcn.params import VIRTUAL, Params, default_params

EXPLAINED = """Error rates are in per cent. They are means over folds, trials and a variant's
training runs. A training run has one seed and one deal, and covers all folds. Every split group
counts once. The brackets hold a 95 % interval, which resamples these groups and keeps the training
runs. The interval is optimistic if a view set mixes an object's groups, as under `object`. `std` is
the standard deviation over the training runs."""
DEALT = """The groups were dealt to the folds in {deals} ways, so each group is tested {deals}
times. All answers of a group are resampled together."""
COMPARED = f"""Differences are paired. They are over the seeds and deals that both variants were
trained on by one kind of machine. There are two intervals of 95 %: `over groups` resamples the
split groups, and `over seeds` is Student's interval for other seeds. The verdict needs both
intervals, and {ENOUGH_SEEDS} seeds or more. A variant without common training runs has no row."""
WORLDS = """A seed is also a simulated world: it has recordings and a training run of its own. The
interval over seeds covers both."""
WORLD = """All recordings are of one simulated world, `glove.seed` {world}. Neither interval covers
other worlds, so there is no verdict."""
TRAINED = f"""`first` is the loss of the first batch, before the first step, when the network is
untrained. `before` and `end` are the means of the last epoch but one and of the last epoch. In some
systems a loss is a sum of several losses. A row with † is not trained to its end, and decides
nothing: its loss at the end is above {LEFT:.0%} of `first`, or fell by more than {FALL:.0%} of
`first` in the last epoch. A system that is not fine-tuned has the losses of pretraining. A system
on the sensors has no losses, and neither has its member `network`."""
CHOSEN = """Error rates on validation groups, in per cent, means over all seeds. Each variant was
tested with the choice in bold, which has its lowest error rate. The test set was not read before.
"""
PAID = """Each cost is the lowest of all training runs, since other work only adds to it. Seconds
are summed over the folds. Milliseconds are for one answer. The memory is the peak of the stage that
needs most."""

MOST_ROWS = 40  # largest number of rows of a table with a row for each held-out group


def write_report(
    study: Study,
    answers: list[Answers],
    folder: Path,
    on_top: tuple[str, ...] = (),
    choices: pd.DataFrame | None = None,
    untested: Sequence[str] = (),
) -> str:
    """Write results.csv, results.md and the picture, if any, and return the text of results.md.

    Args:
        study: the study.
        answers: answers of its finished cells.
        folder: folder to write into.
        on_top: changes that every cell has, `key=value`.
        choices: table of the choices on validation groups, see `choice.choices_of`; None if the
            study has none.
        untested: variants that were not tested, since not all of their choices have been tried.

    Raises:
        UserError: no training run has finished on all folds, or variants cannot be compared.
    """
    cells = study.cells(on_top)
    answers = complete(answers, len({cell.fold for cell in cells}))
    params = default_params(cells[0].changes)
    data = params.data.source
    if data == VIRTUAL:
        data = "Simulated by the virtual glove"
    references = _references(study, answers)
    rows = rows_of(answers, references)
    primary = TITLES[study.primary]
    text = [
        _question(study, data, on_top),
        f"Primary outcome: {primary}. The outcomes of the other tables are secondary.",
        power(rows, primary, _count_groups(answers)),
        f"{_sizes(answers, params)} {EXPLAINED}",
        *_remarks(cells, answers, untested, compared=bool(references)),
    ]
    parts = [*map(_paragraph, text)]
    if study.each:
        parts += ["Each part that was held out, whole recordings:", each_table(answers)]
    parts += tables(rows, references, study.columns, primary)
    if choices is not None:
        parts += [_paragraph(CHOSEN), _choice_table(choices)]
    title = f"{data}: {study.question}\nBars: 95 % interval over split groups"
    other_costs = {*COLUMNS} - {*study.columns}
    with new_files(folder) as part:
        rows.drop(columns=other_costs).to_csv(part / "results.csv", index=False)
        if choices is not None:
            choices.to_csv(part / "choice.csv", index=False)
        (part / "results.md").write_text("\n\n".join(parts) + "\n")
        if study.picture == "curves":
            error_curves(rows, title).savefig(part / "results.png", dpi=100)
        elif study.picture == "seconds":
            errors_by_seconds(rows, references, title).savefig(part / "results.png", dpi=100)
    return (folder / "results.md").read_text()


def _question(study: Study, data: str, on_top: tuple[str, ...]) -> str:
    """Return the first paragraph: the data, the question, and the changes that every cell has."""
    text = f"{data}. {study.question}"
    if on_top:
        changed = ", ".join(f"`{change}`" for change in on_top)
        text += f" Every cell has {changed}."
    return text


def _remarks(
    cells: list[Cell], answers: list[Answers], untested: Sequence[str], *, compared: bool
) -> list[str]:
    """Return paragraphs about deals, missing training runs, differences and worlds, if needed."""
    text = []
    deals = len({answer.cell.deal for answer in answers})
    if deals > 1:
        text.append(DEALT.format(deals=deals))
    absent = missing(cells, answers)
    if absent:
        text.append(f"Missing training runs: {', '.join(absent)}.")
    if untested:
        text.append(
            "Not tested, since not all of their settings have been tried on validation groups: "
            f"{'; '.join(untested)}."
        )
    if compared:
        text.append(COMPARED)
    worlds = {answer.cell.world for answer in answers} - {""}
    if len(worlds) > 1:
        text.append(WORLDS)
    elif worlds:
        text.append(WORLD.format(world=worlds.pop()))
    return text


def _references(study: Study, answers: list[Answers]) -> list[str]:
    """Return the references that have answers, or are the first part of a finished variant."""
    finished = set()
    for answer in answers:
        variant = answer.cell.variant
        finished |= {variant, variant.partition(" / ")[0]}
    return [name for name in study.references if name in finished]


def _count_groups(answers: list[Answers]) -> int:
    """Return the number of split groups that were tested, in all worlds."""
    groups: set[Any] = set()
    for answer in answers:
        numbers = answer.predictions.trials[WHOLE].groups
        groups |= {(answer.cell.world, number) for number in numbers}
    return len(groups)


def _sizes(answers: list[Answers], params: Params) -> str:
    """Return a sentence with the sizes of the set that one training run is tested on."""
    first = answers[0]
    run = (first.cell.deal, first.cell.seed)
    tested = [answer for answer in answers if (answer.cell.deal, answer.cell.seed) == run]
    sizes = []
    for protocol, thing in (("recording", "view set"), (WHOLE, "whole recording")):
        by_fold = {
            answer.cell.fold: len(answer.predictions.trials[protocol].labels) for answer in tested
        }
        sizes.append(several(sum(by_fold.values()), thing))
    sizes.append(several(len(first.predictions.classes), "class", "classes"))
    sizes.append(several(params.evaluate.trials, "trial"))
    sizes.append(several(_count_groups(tested), "split group"))
    return f"A training run has in its {params.evaluate.side} set {', '.join(sizes)}."


def missing(cells: list[Cell], answers: list[Answers]) -> list[str]:
    """Return variants with the number of their missing training runs, as in `mean 2 of 5`.

    Args:
        cells: cells of the study.
        answers: answers of complete training runs.
    """
    # each training run once, in order
    planned = dict.fromkeys((cell.variant, cell.seed, cell.deal) for cell in cells)
    cells_done = [answer.cell for answer in answers]
    finished = {(cell.variant, cell.seed, cell.deal) for cell in cells_done}
    total = Counter(variant for variant, _, _ in planned)
    absent = Counter(run[0] for run in planned if run not in finished)
    return [f"{variant} {count} of {total[variant]}" for variant, count in absent.items()]


def tables(
    rows: pd.DataFrame, references: Sequence[str], columns: Sequence[str], primary: str
) -> list[str]:
    """Return the tables as Markdown, each after a line that names it.

    Args:
        rows: see `comparison.rows_of`.
        references: variants that the others are compared with; each has a table of differences.
        columns: costs in the last table.
        primary: title of the protocol that comes first.
    """
    parts: list[str] = []
    marked = rows["variant"].where(rows["trained"], rows["variant"] + " †")
    rows = rows.assign(variant=marked).set_index("variant")
    others = [protocol for protocol in rows["protocol"].unique() if protocol != primary]
    for protocol in (primary, *reversed(others)):
        of_protocol = rows[rows["protocol"] == protocol]
        errors = {
            "error": _intervals(of_protocol, "error"),
            "std": of_protocol["std"].map("{:.1f}".format),
            "runs": of_protocol["runs"],
        }
        parts += [f"Error, {protocol}:", _markdown(errors)]
        for reference in references:
            parts += _differences(of_protocol, protocol, reference)
    once = rows[~rows.index.duplicated()]
    losses = {name: once[name].map("{:.3f}".format) for name in ("first", "before", "end")}
    parts += ["Training:", _paragraph(TRAINED), _markdown(losses | {"machine": once["machine"]})]
    if columns:
        costs = {name: once[name].map("{:.3g}".format) for name in columns}
        parts += ["Costs:", _paragraph(PAID), _markdown(costs)]
    return parts


def each_table(answers: list[Answers]) -> str:
    """Return the table of wrong whole recordings, a row for each split group that was held out.

    If there are more than MOST_ROWS groups, there is a row for each fold instead.

    Args:
        answers: answers of one training run on all folds.
    """
    parts = []
    for answer in answers:
        whole = answer.predictions.trials[WHOLE]
        columns = {"group": whole.groups, "recording": whole.recordings, "wrong": ~whole.correct[0]}
        parts.append(pd.DataFrame(columns).assign(fold=answer.cell.fold))
    tested = pd.concat(parts)
    keys = ["fold", "group"]
    if tested["group"].nunique() > MOST_ROWS:
        keys = ["fold"]
    rows = tested.groupby(keys).agg(
        first=("recording", "first"), recordings=("recording", "size"), wrong=("wrong", "sum")
    )
    rows["error, %"] = (100 * rows["wrong"] / rows["recordings"]).map("{:.1f}".format)
    rows = rows.rename(columns={"first": "one recording of it"}).reset_index()
    text: str = rows.to_markdown(index=False, disable_numparse=True)
    return text


def _choice_table(choices: pd.DataFrame) -> str:
    """Return the table of validation errors, a column for each choice, the lowest in bold."""
    shown = choices["error"].map("{:.1f}".format)
    shown = shown.where(~choices["chosen"].astype(bool), "**" + shown + "**")
    table = choices.assign(error=shown).pivot(index="variant", columns="choice", values="error")
    table = table.loc[choices["variant"].unique(), choices["choice"].unique()]
    text: str = table.reset_index().to_markdown(index=False, disable_numparse=True)
    return text


def _differences(rows: pd.DataFrame, protocol: str, reference: str) -> list[str]:
    """Return a title and the table of paired differences to a reference; empty without a pair."""
    head = f"vs {reference} "
    is_compared = rows[f"{head}more"].notna()
    if not is_compared.any():
        return []
    over_seeds = _intervals(rows, f"{head}more", f"{head}seeds_")
    differences = {
        "over groups": _intervals(rows, f"{head}more", head),
        "over seeds": over_seeds.where(rows[f"{head}seeds_low"].notna(), ""),
        "verdict": rows[f"{head}verdict"],
    }
    name = f"Points more than `{reference}`, {protocol}:"
    return [name, _markdown(differences, is_compared)]


def _intervals(rows: pd.DataFrame, key: str, ends: str = "") -> "pd.Series[str]":
    """Return the column `key` of each row with its interval, as text.

    The interval is in the columns `low` and `high`, whose names begin with `ends`.
    """

    def text(row: "pd.Series[float]") -> str:
        low = row[f"{ends}low"] / 100
        high = row[f"{ends}high"] / 100
        if np.isnan(low):
            return percent_interval(row[key] / 100, None, None)
        return percent_interval(row[key] / 100, low, high)

    return rows.apply(text, axis=1)


def _markdown(columns: Mapping[str, Any], chosen: "pd.Series[bool] | None" = None) -> str:
    """Return a table of all variants, or of the chosen ones, without blank columns."""
    table = pd.DataFrame(columns).replace("nan", "")
    if chosen is not None:
        table = table[chosen]
    filled = table.loc[:, (table != "").any()].reset_index()
    text: str = filled.to_markdown(index=False, disable_numparse=True)
    return text


def _paragraph(text: str) -> str:
    """Return a text in lines of 80 columns."""
    return fill(text, 80, break_on_hyphens=False, break_long_words=False)
