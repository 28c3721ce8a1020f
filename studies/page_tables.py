"""The tables of studies in README.md and docs/results.md, made from the results files.

The pages call these functions in blocks of Cog. `python -m studies --pages` writes the blocks and
the figures anew. A test says whether a block is out of date.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

from studies.findings import (
    CLAIMED,
    CLAIMS,
    DESIGNS,
    KERNELS,
    METHODS,
    NOT_MEASURED,
    STAG_SETS,
    Claim,
    Design,
    difference,
    error,
    error_or_not,
    has,
    row,
    runs,
)
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE

RowKey = TypeVar("RowKey", int, str)

SIZES = "data_size_one_world"
RECIPE = "the recipe's own error, %"
PUBLISHED_ERROR = "18.18"  # %, of the paper's network on STAG's `classification`
#: ways to join the frames in the study `graph`: labels by name of the variant
JOINED = {
    "vote": "the mean of the frames' answers",
    "view-graph": "the view-graph",
    "mean": "a mean of the features",
    "maximum": "a maximum of the features",
}
MORE_WITH_8 = "points more with 8"
RANDOM = ", random sets"  # end of the names of variants with random view sets


def show(text: str) -> None:
    """Print a text for a block of Cog, between blank lines, which Markdown needs around a table."""
    print(f"\n{text}\n")


def real_table() -> str:
    """Return the table of STAG's public sets: errors on whole recordings, and seconds of training.

    The seconds are summed over all folds.
    """
    rows = []
    for study, title in _measured_sets().items():
        for variant, label in METHODS.items():
            cells = _comparison_row(
                study, variant, label, reference=KERNELS, reference_label="`kernels`"
            )
            rows.append({"recordings": title} | cells)
    return markdown(rows)


def _comparison_row(
    study: str, variant: str, label: str, *, reference: str, reference_label: str
) -> dict[str, str]:
    """Return a row of a table: error on whole recordings, difference, and seconds of training.

    Args:
        study: name of the folder in studies/.
        variant: its name there.
        label: what the table calls the variant.
        reference: variant that it is compared with.
        reference_label: what the table calls the reference.
    """
    more = ""
    seconds = ""
    if has(study, variant, WHOLE):
        seconds = _training_seconds(study, variant)
        if variant != reference:
            more = difference(study, variant, reference, WHOLE)
    return {
        "method": label,
        "whole recordings, %": error_or_not(study, variant),
        f"points more than {reference_label}": more,
        "seconds of training": seconds,
    }


def _measured_sets() -> dict[str, str]:
    """Return STAG's sets that have been measured: titles by name of the study."""
    sets = {}
    for study, title in STAG_SETS.items():
        if has(study, KERNELS, WHOLE):
            sets[study] = title
    return sets


def short_table() -> str:
    """Return README's table of errors on whole recordings, by method, real recordings first."""
    columns = dict[str, Callable[[str], str]]()
    for study, title in _measured_sets().items():
        columns[f"real: {title}"] = partial(error_or_not, study)
    columns["simulated: 96 training frames of each object, 5 worlds"] = partial(
        error_or_not, "claims"
    )
    return table("method", METHODS, columns)


def size_table() -> str:
    """Return the table of errors on whole recordings by the number of training frames."""
    labels = {frames: str(frames) for frames in (12, 24, 48, 96, 192, 384, 624)}
    columns: dict[str, Callable[[int], str]] = {}
    for variant in ("preset network", KERNELS, "paper"):
        columns[METHODS[variant]] = partial(_error_at_size, variant)
    columns["`network` minus `kernels`"] = _network_minus_kernels
    return table("training frames of an object", labels, columns)


def _at_size(variant: str, frames: int) -> str:
    """Return the name in the study `SIZES` of a variant that is trained on so many frames."""
    return f"{variant} / {frames} frames of an object"


def _error_at_size(variant: str, frames: int) -> str:
    """Return a variant's error by its number of training frames, or that it was not measured."""
    return error_or_not(SIZES, _at_size(variant, frames))


def _network_minus_kernels(frames: int) -> str:
    """Return the paired difference of the two presets at a number of training frames."""
    return difference(SIZES, _at_size("preset network", frames), KERNELS, WHOLE)


def claims_table() -> str:
    """Return the table of the paper's claims, a row for each design that tests any of them.

    The differences are to the recipe of the same row. A dagger marks a difference in which a
    network is not trained to its end.
    """
    rows = []
    for design in DESIGNS:
        differences = {claim.label: _claim_in(design, claim) for claim in CLAIMS}
        if set(differences.values()) == {NOT_MEASURED}:
            continue
        recipe = row(design.study, design.reference, CLAIMED)
        cells = {"design": design.label, "seeds": f"{recipe['runs']:.0f}"} | differences
        rows.append(cells | {RECIPE: error(design.study, design.reference, CLAIMED)})
    published = {"design": "published, STAG's data", "seeds": ""}
    for claim in CLAIMS:
        published[claim.label] = "higher" if claim.published is None else f"{claim.published:.2f}"
    rows.append(published | {RECIPE: PUBLISHED_ERROR})
    return markdown(rows)


def _claim_in(design: Design, claim: Claim) -> str:
    """Return a claim's difference to the paper's recipe in a design, or that there is none."""
    variant = f"{claim.variant}{design.suffix}"
    if not has(design.study, variant, CLAIMED):
        return NOT_MEASURED
    return difference(design.study, variant, design.reference, CLAIMED)


def reuse_table() -> str:
    """Return the table of the paper's recipe with `feature_reuse` 1, as in the paper, and 8."""
    labels = {"paper": "1, the paper's", "paper, reuse 8": "8, the default"}
    rows = []
    for protocol in (CLAIMED, "recording", WHOLE):
        cells = {"": TITLES[protocol]}
        for variant, label in labels.items():
            std = row("claims", variant, protocol)["std"]
            cells[label] = f"{error('claims', variant, protocol)}, std {std:.1f}"
        cells[MORE_WITH_8] = difference("claims", "paper, reuse 8", "paper", protocol)
        rows.append(cells)
    seconds = {"": "fine-tuning, s"}
    for variant, label in labels.items():
        seconds[label] = f"{row('claims', variant, CLAIMED)['finetune s']:,.0f}"
    rows.append(seconds | {MORE_WITH_8: ""})
    return markdown(rows)


def worlds_table() -> str:
    """Return the table of errors on whole recordings in five worlds, with seconds of training."""
    labels = METHODS | {"paper, reuse 8": "the recipe with `feature_reuse` 8"}
    for claim in CLAIMS:
        labels[claim.variant] = claim.label
    return _comparison_table("claims", labels, reference="paper", reference_label="the recipe")


def graph_table() -> str:
    """Return the table of ways to join the frames on the backbone of the preset `network`."""
    labels = JOINED | {
        "vote": "`network`: the mean of the frames' answers",
        "view-graph, a fifth of the rate": "the view-graph, with a fifth of the learning rate",
    }
    measured = {name: label for name, label in labels.items() if has("graph", name, WHOLE)}
    return _comparison_table("graph", measured, reference="vote", reference_label="`network`")


def joined_table() -> str:
    """Return the table of differences to the view-graph, on the backbone of `network`."""
    others = {name: label for name, label in JOINED.items() if name != "view-graph"}
    return _differences_by_protocol(others, "", lambda variant: "view-graph")


def random_graph_table() -> str:
    """Return the same table for networks that are trained and tested on random view sets."""
    labels = {
        f"{name}{RANDOM}": label
        for name, label in JOINED.items()
        if has("graph", f"{name}{RANDOM}", WHOLE)
    }
    return _comparison_table(
        "graph", labels, reference=f"vote{RANDOM}", reference_label="the mean of the answers"
    )


def clusters_table() -> str:
    """Return the table of random view sets less clusters, on the backbone of `network`."""
    return _differences_by_protocol(JOINED, RANDOM, lambda variant: variant)


def _differences_by_protocol(
    labels: Mapping[str, str], suffix: str, reference_of: Callable[[str], str]
) -> str:
    """Return a table of differences in the study `graph`, a column for each protocol.

    Args:
        labels: what the table calls the variants, by their names without the suffix.
        suffix: end of the variants' names.
        reference_of: returns the reference of a variant, by its name without the suffix.
    """
    rows = []
    for variant, label in labels.items():
        name = f"{variant}{suffix}"
        if not has("graph", name, WHOLE):
            continue
        cells = {"joined by": label}
        for protocol in (CLAIMED, "recording", WHOLE):
            cells[TITLES[protocol]] = difference("graph", name, reference_of(variant), protocol)
        rows.append(cells)
    return markdown(rows)


def _comparison_table(
    study: str, labels: Mapping[str, str], *, reference: str, reference_label: str
) -> str:
    """Return a table with a row for each variant, the lowest error first.

    Args:
        study: name of the folder in studies/.
        labels: what the table calls the variants, by their names there.
        reference: variant that the others are compared with.
        reference_label: what the table calls the reference.
    """
    rows = []
    for variant in sorted(labels, key=lambda variant: row(study, variant, WHOLE)["error"]):
        cells = _comparison_row(
            study, variant, labels[variant], reference=reference, reference_label=reference_label
        )
        rows.append(cells)
    return markdown(rows)


def time_table() -> str:
    """Return the table of errors and seconds of training, the fastest first."""
    study = "error_time"
    labels = {
        KERNELS: "preset `kernels`",
        "svm": "`svm`",
        "network, 1 epoch": "`network` in 1 epoch",
        "network, 2 epochs": "`network` in 2 epochs",
        "network, 4 epochs": "`network` in 4 epochs",
        "preset network": "preset `network`",
        "1/4 of the epochs": "the paper's recipe in 1/4 of its epochs",
        "Tactile-ViewGCN": "the paper's recipe",
    }
    columns = {
        "seeds": partial(runs, study),
        "whole recordings": partial(error, study, protocol=WHOLE),
        "eight frames of a recording": partial(error, study, protocol="recording"),
        "seconds": partial(_training_seconds, study),
    }
    return table("method", labels, columns)


def _training_seconds(study: str, variant: str) -> str:
    """Return the seconds of pretraining and fine-tuning together."""
    result = row(study, variant, WHOLE)
    return f"{result['pretrain s'] + result['finetune s']:,.0f}"


def systems_table() -> str:
    """Return the table of the systems that join views, the lowest error under `object` first."""
    study = "compare"
    systems = {
        "view_gcn": "`view_gcn`, the paper's",
        "vote": "`vote`",
        "conv_lstm": "`conv_lstm`",
        "cnn_lstm": "`cnn_lstm`",
        "mean": "`mean`",
        "gvcnn": "`gvcnn`",
        "mvcnn": "`mvcnn`",
        "rotationnet": "`rotationnet`",
        "gcn": "`gcn`",
        "stag": "`stag`",
        "Wang et al.": "Wang et al.",
    }
    names = sorted(systems, key=lambda name: row(study, name, CLAIMED)["error"])
    labels = {name: systems[name] for name in names}
    columns = {
        "runs": partial(runs, study),
        "`object`": partial(error, study, protocol=CLAIMED),
        "whole recordings": partial(error, study, protocol=WHOLE),
    }
    return table("", labels, columns)


def views_table() -> str:
    """Return the table of errors by the number of views, on whole recordings and under `object`."""
    labels = {views: views for views in ("1 view", "2 views", "4 views", "8 views")}
    columns = dict[str, Callable[[str], str]]()
    for protocol, title in ((WHOLE, "whole recordings"), (CLAIMED, "`object`")):
        for variant, label in (("clusters", "clusters"), ("random sets", "random view sets")):
            columns[f"{title}, {label}"] = partial(_error_of_views, variant, protocol)
    return table("", labels, columns)


def _error_of_views(variant: str, protocol: str, views: str) -> str:
    """Return a variant's error with a number of views."""
    return error("views", f"{variant} / {views}", protocol)


def table(
    corner: str, labels: Mapping[RowKey, str], columns: Mapping[str, Callable[[RowKey], str]]
) -> str:
    """Return a table of Markdown: a row for each label, with a text in each column.

    Args:
        corner: title of the column of labels.
        labels: labels of the rows, by the key that the columns' functions take.
        columns: functions that return the text of a row, by title of the column.
    """
    rows = []
    for key, label in labels.items():
        cells = {corner: label}
        for title, text_of in columns.items():
            cells[title] = text_of(key)
        rows.append(cells)
    return markdown(rows)


def markdown(rows: Sequence[Mapping[str, str]]) -> str:
    """Return a table of Markdown, a row for each dictionary, without padding."""
    titles = list(rows[0])
    lines = [titles, ["---"] * len(titles), *(list(cells.values()) for cells in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
