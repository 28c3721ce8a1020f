"""The grid of a study: from studies/NAME.yaml to cells, each a training as changes to params.yaml."""

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, field, fields
from itertools import product
from pathlib import Path
from typing import Any

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import PRESETS, preset_changes, read_yaml

FOLDER = Path("studies")
PICTURES = ("error", "seconds")
COLUMNS = ("pretrain s", "finetune s", "ms alone", "ms in batches", "peak MB")
#: of every rehearsal: three objects and the empty hand of a small glove, trainings of one epoch
QUICK = {
    "glove.objects": ["mug", "tape", "scissors"],
    "glove.sessions": 3,
    "glove.grasps": 1,
    "glove.grasp_frames": 18,
    "model.backbone.width": 8,
    "cluster.restarts": 1,
    "pretrain.epochs": 1,
    "finetune.epochs": 1,
    "evaluate.trials": 2,
}


@dataclass(frozen=True)
class Cell:
    """One training of a variant from a seed on a fold, and its evaluation; `changes` to params.yaml as `key=value`."""

    variant: str
    seed: int
    fold: int
    changes: tuple[str, ...]


@dataclass(frozen=True)
class Study:
    """The content of studies/NAME.yaml; those without a default stand in every file.

    Attributes:
        question: 41 characters at most, for the list of studies.
        variants: {name: {key: value}}, what is compared; the key `preset` stands for the changes of that preset.
        reference: the variant that the others are compared with; None: nothing is compared.
        seeds, folds: every variant is trained from each, on each.
        columns: of `COLUMNS`, the costs that the table shows.
        set: changes of every cell.
        cross: further mappings like `variants`: every combination is trained, names joined by " / ".
        one_seed: variants that are trained from the first seed alone.
        picture: error, or seconds: error against seconds.
        confusion: draw confusion matrices and the objects confused most.
        quick: the variants of a rehearsal, which are trained from the first seed.
    """

    name: str
    question: str
    variants: dict[str, dict[str, Any]]
    reference: str | None
    seeds: list[int]
    folds: list[int]
    columns: list[str]
    set: dict[str, Any] = field(default_factory=dict)
    cross: list[dict[str, dict[str, Any]]] = field(default_factory=list)
    one_seed: list[str] = field(default_factory=list)
    picture: str = "error"
    confusion: bool = False
    quick: list[str] = field(default_factory=list)

    def cells(self, *, quick: bool = False) -> list[Cell]:
        """Every cell, or those of a rehearsal; seed by seed, so that the first seed of all variants is there early."""
        shared = [self.set, QUICK] if quick else [self.set]
        return [
            Cell(variant, seed, fold, (*_changes([*shared, *parts]), f"seed={seed}", f"split.fold={fold}"))
            for seed in (self.seeds[:1] if quick else self.seeds)
            for variant, parts in self._crossed()
            if (variant in self.quick if quick else seed == self.seeds[0] or variant not in self.one_seed)
            for fold in self.folds
        ]

    def _crossed(self) -> Iterator[tuple[str, list[dict[str, Any]]]]:
        for entries in product(*(axis.items() for axis in [self.variants, *self.cross])):
            yield " / ".join(name for name, _ in entries), [changes for _, changes in entries]


def names() -> list[str]:
    """The studies that there are."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_study(name: str) -> Study:
    """The study of that name.

    Raises:
        UserError: there is none, a key of its file is unknown or missing, or a name in it stands for nothing.
    """
    path = FOLDER / f"{name}.yaml"
    if not path.exists():
        raise UserError(f"study is {name!r}; expected one of {', '.join(names())} (in the repository's root)")
    tree = {"name": name} | read_yaml(path)
    known = {item.name for item in fields(Study)}
    needed = [item.name for item in fields(Study) if item.default is MISSING and item.default_factory is MISSING]
    if unknown := sorted(tree.keys() - known):
        raise UserError(f"{path}: unknown key {unknown[0]}; known here: {', '.join(sorted(known - {'name'}))}")
    if missing := [key for key in needed if key not in tree]:
        raise UserError(f"{path}: key {missing[0]} is missing; expected {', '.join(needed[1:])}")
    for axis in [tree["variants"], *tree.get("cross", [])]:
        if not (axis and isinstance(axis, dict) and all(isinstance(changes, dict) for changes in axis.values())):
            raise UserError(
                f"{path}: a set of variants is {axis!r}; expected changes of each, as in {{a: {{views: 8}}}}"
            )
    study = Study(**tree)
    variants = list(dict.fromkeys(cell.variant for cell in study.cells()))
    for key, given, allowed in (
        ("reference", [study.reference or variants[0]], variants),
        ("one_seed", study.one_seed, variants),
        ("quick", study.quick, variants),
        ("columns", study.columns, COLUMNS),
        ("picture", [study.picture], PICTURES),
    ):
        if strange := [each for each in given if each not in allowed]:
            raise UserError(f"{path}: {key} is {strange[0]!r}; expected one of {', '.join(allowed)}")
    return study


def _changes(parts: list[dict[str, Any]]) -> Iterator[str]:
    for key, value in (item for part in parts for item in part.items()):
        if key != "preset":
            yield f"{key}={_text(value)}"
        elif value in PRESETS:
            yield from preset_changes(value)
        else:
            raise UserError(f"preset is {value!r}; expected one of {', '.join(PRESETS)}")


def _text(value: Any) -> str:
    """A value of YAML in one word, as `dvc exp run --set-param` reads it."""
    if isinstance(value, list):
        return f"[{','.join(map(_text, value))}]"
    return str(value).lower() if isinstance(value, bool) else str(value)
