"""The choice of one of several settings of a variant, by its errors on validation groups."""

import pandas as pd

from studies.cells import Answers
from studies.comparison import TRAINING, errors_of
from studies.grid import Study, candidate
from tactile_viewgcn.evaluation.trials import TITLES


def choices_of(study: Study, answers: list[Answers]) -> pd.DataFrame:
    """Return the validation errors of all choices of the variants whose candidates have finished.

    Args:
        study: with a choice.
        answers: of finished cells of `study.candidates()`, on all folds.

    Returns:
        columns `variant`, `choice`, `error` and `chosen`. The error is that of the primary
            protocol, in per cent, the mean over training runs, every split group counted once. What
            is chosen has the lowest error of the variant's.
    """
    errors = errors_of(answers)
    errors = errors[errors["protocol"] == TITLES[study.primary]]
    of_runs = errors.groupby(["variant", *TRAINING])["wrong"].mean()
    runs = of_runs.groupby("variant").size()
    means = 100 * of_runs.groupby("variant").mean()
    parts = []
    for variant in study.variants:
        names = {choice: candidate(variant, choice) for choice in study.choice or {}}
        finished = runs.reindex(list(names.values()), fill_value=0)
        if variant in study.fixed or (finished < len(study.seeds)).any():
            continue
        of_variant = means[list(names.values())].to_numpy()
        part = pd.DataFrame({"variant": variant, "choice": list(names), "error": of_variant})
        part["chosen"] = part.index == part["error"].idxmin()
        parts.append(part)
    if not parts:
        return pd.DataFrame(columns=["variant", "choice", "error", "chosen"])
    return pd.concat(parts, ignore_index=True)


def names_of(choices: pd.DataFrame) -> dict[str, str]:
    """Return the name of the choice of each variant, see `choices_of`."""
    taken = choices[choices["chosen"].astype(bool)]
    return dict(zip(taken["variant"], taken["choice"], strict=True))
