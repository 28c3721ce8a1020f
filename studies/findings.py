"""Numbers of the studies' results files, as text for tables and figures."""

from dataclasses import dataclass

import pandas as pd

from studies.comparison import UNTRAINED
from studies.grid import FOLDER
from tactile_viewgcn.evaluation.trials import TITLES, WHOLE
from tactile_viewgcn.messages import UserError

NOT_MEASURED = "not measured"
UNTRAINED_MARK = " †"
CLAIMED = "object"  # the protocol under which the paper has its claims
STAG_SETS = {"real_blindfolded_lite": "`blindfolded_lite`", "real_weights_lite": "`weights_lite`"}
#: Folders of variants that were trained later than the other variants of their study, with its
#: reference beside them.
LATER = {("real_weights_lite", "paper"): "real_weights_lite_paper"}
KERNELS = "preset kernels"
METHODS = {
    KERNELS: "preset `kernels`",
    "preset network": "preset `network`",
    "preset best": "preset `best`",
    "paper": "the paper's recipe",
}


@dataclass(frozen=True)
class Design:
    """A study in which the claims are compared: its recordings and the length of its training.

    Attributes:
        label: text at the left of its row in the figure and in the table.
        study: name of the folder in studies/.
        suffix: end of the variants' names in that study.
    """

    label: str
    study: str
    suffix: str = ""

    @property
    def is_real(self) -> bool:
        """Return whether the recordings are real ones."""
        return self.study in STAG_SETS

    @property
    def reference(self) -> str:
        """The name of the paper's recipe in the study."""
        return f"paper{self.suffix}"


@dataclass(frozen=True)
class Claim:
    """One claim of the paper: what it compares its network with.

    Attributes:
        label: text above its rows.
        variant: its name in the studies, without a suffix.
        published: percentage points by which the variant's error was higher on STAG's data; None
            if the paper only says that it was higher.
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
    Design("two long recordings, 1/4 of the epochs, 1 world", "long_recordings_one_world", ", 1/4"),
    Design("two long recordings, 1 world", "long_recordings_one_world"),
    Design("real: blindfolded_lite", "real_blindfolded_lite"),
)


def row(study: str, variant: str, protocol: str) -> "pd.Series[float]":
    """Return the row of a variant in the results file of a study.

    Args:
        study: name of the folder in studies/; `LATER` can name another one for the variant.
        variant: its name there.
        protocol: a key of `trials.TITLES`.

    Raises:
        UserError: there is no such file or row.
    """
    path = FOLDER / LATER.get((study, variant), study) / "results.csv"
    if not path.exists():
        raise UserError(f"{path}: no such file; expected the results of a study")
    rows = pd.read_csv(path, keep_default_na=True)
    matching = rows[(rows["variant"] == variant) & (rows["protocol"] == TITLES[protocol])]
    if matching.empty:
        raise UserError(f"{path}: no row {variant!r}, {TITLES[protocol]!r}")
    return matching.iloc[0]


def has(study: str, variant: str, protocol: str) -> bool:
    """Return whether a study's results file exists and has the row."""
    try:
        row(study, variant, protocol)
    except UserError:
        return False
    return True


def error(study: str, variant: str, protocol: str) -> str:
    """Return an error with its interval over recordings, as in `17.8 (15.8 to 19.8)`.

    A dagger follows if a network is not trained to its end.
    """
    result = row(study, variant, protocol)
    text = f"{result['error']:.1f} ({result['low']:.1f} to {result['high']:.1f})"
    if not result["trained"]:
        text += UNTRAINED_MARK
    return text


def error_or_not(study: str, variant: str) -> str:
    """Return the error on whole recordings, or that it was not measured."""
    if has(study, variant, WHOLE):
        return error(study, variant, WHOLE)
    return NOT_MEASURED


def difference(study: str, variant: str, reference: str, protocol: str) -> str:
    """Return a paired difference with both intervals, as in `8.6 (6.8 to 10.7; 3.5 to 13.8)`.

    The first interval is over split groups, the second over seeds. The second can be missing. A
    dagger follows if one of the two networks is not trained to its end.
    """
    result = row(study, variant, protocol)
    head = f"vs {reference} "
    intervals = [f"{result[f'{head}low']:.1f} to {result[f'{head}high']:.1f}"]
    if pd.notna(result[f"{head}seeds_low"]):
        intervals.append(f"{result[f'{head}seeds_low']:.1f} to {result[f'{head}seeds_high']:.1f}")
    text = f"{result[f'{head}more']:.1f} ({'; '.join(intervals)})"
    if result[f"{head}verdict"] == UNTRAINED:
        text += UNTRAINED_MARK
    return text


def runs(study: str, variant: str) -> str:
    """Return the number of training runs of a variant."""
    return f"{row(study, variant, WHOLE)['runs']:.0f}"
