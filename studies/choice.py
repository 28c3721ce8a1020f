"""The choice between several settings of a variant, by their errors on validation groups."""

import pandas as pd

from studies.cells import Answers
from studies.comparison import TRAINING, errors_of
from studies.grid import Study, candidate
from tactile_viewgcn.evaluation.trials import TITLES


def choices_of(study: Study, answers: list[Answers]) -> pd.DataFrame:
    """Return the validation errors of all choices, a row for each variant and choice.

    A variant has rows only if all its candidates have finished.

    Args:
        study: a study with choices.
        answers: answers of finished cells of `study.candidates()`, on all folds.

    Returns:
        Columns `variant`, `choice`, `error` and `chosen`. The error is the mean over training runs
            under the primary protocol, in per cent. Every split group counts once. `chosen` marks
            the choice with the lowest error of each variant.
    """
    columns = ["variant", "choice", "error", "chosen"]
    if not answers:
        return pd.DataFrame(columns=columns)
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
        return pd.DataFrame(columns=columns)
    return pd.concat(parts, ignore_index=True)


def names_of(choices: pd.DataFrame) -> dict[str, str]:
    """Return the name of each variant's chosen setting, from the table of `choices_of`."""
    taken = choices[choices["chosen"].astype(bool)]
    return dict(zip(taken["variant"], taken["choice"], strict=True))
