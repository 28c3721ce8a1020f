"""What one arm of a study says of every view set: the answers of a trained system, and what they cost."""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tactile_viewgcn.files import readable, whole


@dataclass(frozen=True)
class Arm:
    """One training and its trials.

    Attributes:
        name: what is varied.
        seed, fold: of the training, and of the split; repeat: of whatever else was drawn anew, 0 where nothing was.
        recipe: all parameters but the seed.
        costs: weights, seconds, milliseconds and megabytes by name.
        predicted: by protocol, int16 (T, A) the class answered in each trial.
        labels, groups: (A,) true class and split group of the anchors.
        classes: names.
    """

    name: str
    seed: int
    fold: int
    repeat: int
    recipe: str
    costs: dict[str, float]
    predicted: dict[str, np.ndarray]
    labels: np.ndarray
    groups: np.ndarray
    classes: list[str]

    def right(self, protocol: str) -> np.ndarray:
        """(A,) share of the trials in which each anchor's view set is classified rightly."""
        return (self.predicted[protocol] == self.labels).mean(axis=0)


def write_arm(path: Path, arm: Arm) -> None:
    """As an .npz: text and numbers as JSON, arrays as they are."""
    plain = {name: getattr(arm, name) for name in ("name", "seed", "fold", "repeat", "recipe", "costs", "classes")}
    arrays = {f"predicted.{protocol}": values.astype(np.int16) for protocol, values in arm.predicted.items()}
    with whole(path) as part, part.open("wb") as file:
        np.savez_compressed(file, plain=json.dumps(plain), labels=arm.labels, groups=arm.groups, **arrays)


def read_arms(folders: Iterable[Path]) -> list[Arm]:
    """All arms in these folders, in the order of their files' names.

    Raises:
        ValueError: there are none, or a training is there twice.
    """
    arms: dict[tuple, Arm] = {}
    for path in (path for folder in folders for path in sorted(folder.glob("*.npz"))):
        with readable(path), np.load(path) as file:
            predicted = {name.partition(".")[2]: file[name] for name in file.files if name.startswith("predicted.")}
            arrays = {"labels": file["labels"], "groups": file["groups"], "predicted": predicted}
            arm = Arm(**json.loads(str(file["plain"])), **arrays)
        if (key := (arm.name, arm.seed, arm.repeat, arm.fold)) in arms:
            raise ValueError(
                f"{path}: arm {arm.name}, seed {arm.seed}, fold {arm.fold} is there twice: delete one file"
            )
        arms[key] = arm
    if not arms:
        raise ValueError("no trained arms; `dvc repro` of the study's dvc.yaml trains them")
    return list(arms.values())


def recipe_of(params: SimpleNamespace, *, without: tuple[str, ...] = ()) -> str:
    """What all trainings of one arm have in common: every parameter but the seed and those named."""
    return repr(sorted((key, value) for key, value in vars(params).items() if key not in ("seed", *without)))
