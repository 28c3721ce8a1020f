"""What the paper's whole recipe takes on STAG's size, multiplied out from the rates measured here."""

import numpy as np

#: passes and anchors of STAG's `classification`, the paper's numbers; evaluation is ten trials of two protocols
PRETRAINING, FINETUNING, EVALUATION = (30, 36_531), (15, 36_531), (20, 16_119)


def recipe_rows(rows: list[dict]) -> list[dict]:
    """Hours of each part of the recipe and of all of it, from the rows of everything that was measured."""
    plain = [row for row in rows if row["against"] == "plain"]
    (step,) = (row for row in plain if row["what"] == "training step" and row["size"].startswith("batch 32,"))
    (trials,) = (row for row in plain if row["what"] == "evaluation")
    pretraining, evaluation = hours(*PRETRAINING, step), hours(*EVALUATION, trials)
    parts = {"pretraining": pretraining, "evaluation": evaluation}
    for row in plain:
        if row["what"] == "fine-tuning":
            parts[f"fine-tuning, {row['size']}"] = finetuning = hours(*FINETUNING, row)
            parts[f"together, {row['size']}"] = pretraining + finetuning + evaluation
    return [
        {"part": part, "fast hours": fast, "plain hours": slow, "ratio": slow / fast}
        for part, (fast, slow) in parts.items()
    ]


def hours(passes: int, anchors: int, row: dict) -> np.ndarray:
    """Hours (2,), fast and plain, of so many passes over the anchors or their view sets at the rates of a row."""
    return passes * anchors / np.array([row["fast"], row["counterpart"]]) / 3600
