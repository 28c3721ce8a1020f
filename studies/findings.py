"""What README.md and docs/results.md say of the studies, from their results files.

The pages call these functions in blocks of Cog. `python -m studies --pages` writes the blocks and
the figures anew, and a test says whether a block is out of date.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from studies.comparison import UNTRAINED
from studies.grid import FOLDER
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE
from tactile_viewgcn.messages import UserError

NOT_MEASURED = "not measured"
SIZES = "data_size_one_world"
CLAIMED = "object"  # the protocol under which the paper has its claims
PUBLISHED_ERROR = "18.18"  # %, of the paper's network on STAG's `classification`
STAG_SETS = {"real_blindfolded_lite": "`blindfolded_lite`", "real_weights_lite": "`weights_lite`"}
METHODS = {
    "preset kernels": "preset `kernels`",
    "preset network": "preset `network`",
    "preset best": "preset `best`",
    "paper": "the paper's recipe",
}


@dataclass(frozen=True)
class Design:
    """Recordings and length of training of a comparison.

    Attributes:
        label: at the left of the row.
        study: name of the folder in studies/.
        suffix: of the variants' names in that study.
    """

    label: str
    study: str
    suffix: str = ""

    @property
    def reference(self) -> str:
        """The name of the paper's recipe in the study."""
        return f"paper{self.suffix}"


@dataclass(frozen=True)
class Claim:
    """What the paper compares its network with.

    Attributes:
        label: above the rows.
        variant: its name in the studies, without a suffix.
        published: percentage points by which its error was higher on STAG's data; None where the
            paper only says that it was higher.
    """

    label: str
    variant: str
    published: float | None


# the paper's accuracies: 81.82 %, without clusters 76.19 %, STAG's network 72.38 %
CLAIMS = (
    Claim("random view sets in place of clusters", "random sets", 81.82 - 76.19),
    Claim("STAG's network in place of the view-graph", "STAG's network", 81.82 - 72.38),
    Claim("a maximum in place of the view-graph", "maximum", None),
    Claim("a mean in place of the view-graph", "mean", None),
)
DESIGNS = (
    Design("96 frames, 5 worlds", "claims"),
    Design("the same, feature_reuse 8", "claims", ", reuse 8"),
    Design("624 frames, 5 worlds", "claims_624"),
    Design("long recordings, 5 worlds", "long_recordings"),
    Design("48 frames, 1 world", "claims_48_one_world"),
    Design("624 frames, 1/4 of the epochs, 1 world", "claims_one_world", ", 1/4"),
    Design("624 frames, 1 world", "claims_one_world"),
    Design("two long recordings, 1 world", "long_recordings_one_world"),
    Design("real: blindfolded_lite", "real_blindfolded_lite"),
)


def show(text: str) -> None:
    """Print a text for a block of Cog, between blank lines, which Markdown needs around a table."""
    print(f"\n{text}\n")


def row(study: str, variant: str, protocol: str) -> "pd.Series[float]":
    """Return the row of a variant in the results file of a study.

    Args:
        study: name of the folder in studies/.
        variant: its name there.
        protocol: a key of `trials.TITLES`.

    Raises:
        UserError: there is no such file or row.
    """
    path = FOLDER / study / "results.csv"
    if not path.exists():
        raise UserError(f"{path}: no such file; expected the results of a study")
    rows = pd.read_csv(path, keep_default_na=True)
    found = rows[(rows["variant"] == variant) & (rows["protocol"] == TITLES[protocol])]
    if found.empty:
        raise UserError(f"{path}: no row {variant!r}, {TITLES[protocol]!r}")
    return found.iloc[0]


def has(study: str, variant: str, protocol: str) -> bool:
    """Return whether a study's results file has the row, see `row`."""
    try:
        row(study, variant, protocol)
    except UserError:
        return False
    return True


def error(study: str, variant: str, protocol: str) -> str:
    """Return an error with its interval over recordings, as in `17.8 (15.8 to 19.8)`."""
    found = row(study, variant, protocol)
    return f"{found['error']:.1f} ({found['low']:.1f} to {found['high']:.1f})"


def difference(study: str, variant: str, reference: str, protocol: str) -> str:
    """Return a paired difference with both intervals, as in `8.6 (6.8 to 10.7; 3.5 to 13.8)`.

    The second interval, over seeds, is left out where there is none.
    """
    found = row(study, variant, protocol)
    head = f"vs {reference} "
    intervals = [f"{found[f'{head}low']:.1f} to {found[f'{head}high']:.1f}"]
    if pd.notna(found[f"{head}seeds_low"]):
        intervals.append(f"{found[f'{head}seeds_low']:.1f} to {found[f'{head}seeds_high']:.1f}")
    return f"{found[f'{head}more']:.1f} ({'; '.join(intervals)})"


def differences_table(
    variants: Mapping[str, str],
    designs: Mapping[str, tuple[str, str, str]],
    protocol: str,
) -> str:
    """Return a table of Markdown: a row for each variant, a column for each design.

    A cell has the paired difference to the reference with its intervals. A dagger marks a network
    that is not trained to its end.

    Args:
        variants: labels of the rows, by name of the variant.
        designs: study, reference and suffix of the variants' names, by label of the column.
        protocol: a key of `trials.TITLES`.
    """
    rows = []
    for variant, label in variants.items():
        cells = {"": label}
        for design, (study, reference, suffix) in designs.items():
            name = f"{variant}{suffix}"
            cells[design] = NOT_MEASURED
            if has(study, name, protocol):
                cells[design] = difference(study, name, reference, protocol)
                verdict = row(study, name, protocol)[f"vs {reference} verdict"]
                if verdict == UNTRAINED:
                    cells[design] += " †"
        rows.append(cells)
    return markdown(rows)


def errors_table(
    study: str, variants: Mapping[str, str], columns: Mapping[str, str], costs: Sequence[str] = ()
) -> str:
    """Return a table of Markdown: a row for each variant, its errors with intervals and its costs.

    A dagger marks a network that is not trained to its end.

    Args:
        study: name of the folder in studies/.
        variants: labels of the rows, by name of the variant.
        columns: labels of the columns, by key of `trials.TITLES`.
        costs: names of `grid.COLUMNS`.
    """
    rows = []
    for variant, label in variants.items():
        first = row(study, variant, next(iter(columns)))
        dagger = "" if first["trained"] else " †"
        cells = {"": f"{label}{dagger}", "runs": f"{first['runs']:.0f}"}
        for protocol, title in columns.items():
            cells[title] = error(study, variant, protocol)
        for name in costs:
            cells[name] = f"{first[name]:,.3g}"
        rows.append(cells)
    return markdown(rows)


def real_table() -> str:
    """Return the table of errors on whole recordings of STAG's two public sets, by method."""
    rows = []
    for variant, label in METHODS.items():
        cells = {"method": label}
        for study, title in STAG_SETS.items():
            cells[title] = _error_or_not(study, variant)
        rows.append(cells)
    return markdown(rows)


def short_table() -> str:
    """Return README's table of errors on whole recordings, by method, real recordings first."""
    rows = []
    for variant, label in METHODS.items():
        cells = {"method": label}
        for study, title in STAG_SETS.items():
            cells[f"real: {title}"] = _error_or_not(study, variant)
        for frames in (48, 624):
            name = f"{variant} / {frames} frames of an object"
            cells[f"simulated: {frames} training frames"] = _error_or_not(SIZES, name)
        rows.append(cells)
    return markdown(rows)


def _error_or_not(study: str, variant: str) -> str:
    """Return the error on whole recordings, or that it was not measured."""
    if has(study, variant, WHOLE):
        return error(study, variant, WHOLE)
    return NOT_MEASURED


def claims_table() -> str:
    """Return the table of the paper's claims, a column for each design that has been measured."""
    designs = {}
    for design in DESIGNS:
        if has(design.study, design.reference, CLAIMED):
            designs[design.label] = (design.study, design.reference, design.suffix)
    variants = {claim.variant: claim.label for claim in CLAIMS}
    table = differences_table(variants, designs, CLAIMED)
    errors = ["the recipe's own error, %"]
    for study, reference, _ in designs.values():
        errors.append(error(study, reference, CLAIMED))
    published = ["published"]
    for claim in CLAIMS:
        published.append("higher" if claim.published is None else f"{claim.published:.2f}")
    published.append(PUBLISHED_ERROR)
    lines = [*table.splitlines(), f"| {' | '.join(errors)} |"]
    heads = [published[0], "---", *published[1:]]
    return "\n".join(f"{line} {head} |" for line, head in zip(lines, heads, strict=True))


def reuse_table() -> str:
    """Return the table of the paper's recipe with `feature_reuse` 1, as in the paper, and 8."""
    labels = {"paper": "1, the paper's", "paper, reuse 8": "8, the default"}
    lines = []
    for protocol in (CLAIMED, "recording", WHOLE):
        cells = {"": TITLES[protocol]}
        for variant, label in labels.items():
            std = row("claims", variant, protocol)["std"]
            cells[label] = f"{error('claims', variant, protocol)}, std {std:.1f}"
        cells["8 less 1"] = difference("claims", "paper, reuse 8", "paper", protocol)
        lines.append(cells)
    seconds = {"": "fine-tuning, s"}
    for variant, label in labels.items():
        seconds[label] = f"{row('claims', variant, CLAIMED)['finetune s']:,.0f}"
    lines.append(seconds | {"8 less 1": ""})
    return markdown(lines)


def size_table() -> str:
    """Return the table of errors on whole recordings by the number of training frames."""
    study = SIZES
    rows = []
    for frames in (12, 24, 48, 96, 192, 384, 624):
        cells = {"training frames of an object": str(frames)}
        for variant in ("preset network", "preset kernels", "paper"):
            name = f"{variant} / {frames} frames of an object"
            cells[METHODS[variant]] = error(study, name, WHOLE)
        name = f"preset network / {frames} frames of an object"
        cells["`network` minus `kernels`"] = difference(study, name, "preset kernels", WHOLE)
        rows.append(cells)
    return markdown(rows)


def time_table() -> str:
    """Return the table of errors and seconds of training, the fastest first."""
    rows = []
    for variant, label in {
        "preset kernels": "preset `kernels`",
        "svm": "`svm`",
        "network, 1 epoch": "`network` in 1 epoch",
        "network, 2 epochs": "`network` in 2 epochs",
        "network, 4 epochs": "`network` in 4 epochs",
        "preset network": "preset `network`",
        "1/4 of the epochs": "the paper's recipe in 1/4 of its epochs",
        "Tactile-ViewGCN": "the paper's recipe",
    }.items():
        found = row("error_time", variant, WHOLE)
        rows.append(
            {
                "method": label,
                "seeds": f"{found['runs']:.0f}",
                "whole recordings": error("error_time", variant, WHOLE),
                "eight frames of a recording": error("error_time", variant, "recording"),
                "seconds": f"{found['pretrain s'] + found['finetune s']:,.0f}",
            }
        )
    return markdown(rows)


def systems_table() -> str:
    """Return the table of the systems that join views, the lowest error under `object` first."""
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
    ordered = sorted(systems, key=lambda name: row("compare", name, CLAIMED)["error"])
    labels = {name: systems[name] for name in ordered}
    return errors_table("compare", labels, {CLAIMED: "`object`", WHOLE: "whole recordings"})


def views_table() -> str:
    """Return the table of errors by the number of views."""
    rows = []
    for views in ("1 view", "2 views", "4 views", "8 views"):
        cells = {"": views}
        for name, title in (("clusters", "clusters"), ("random sets", "random view sets")):
            variant = f"{name} / {views}"
            cells[title] = error("views", variant, CLAIMED)
            if not row("views", variant, CLAIMED)["trained"]:
                cells[title] += " †"
        rows.append(cells)
    return markdown(rows)


def markdown(rows: list[dict[str, str]]) -> str:
    """Return a table of Markdown, a row for each dictionary, without padding."""
    names = list(rows[0])
    lines = [names, ["---"] * len(names), *(list(one.values()) for one in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
