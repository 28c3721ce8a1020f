"""The grid of a study: from studies/NAME.yaml to cells, each a training as changes to params.yaml."""

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, field, fields
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import PRESETS, Seed, load, preset_changes, read_yaml
from tactile_viewgcn.schema import Range, as_change, convert, describe

FOLDER = Path("studies")
COLUMNS = ("pretrain s", "finetune s", "ms alone", "ms in batches", "peak MB")
AXES = ("seed", "split.deal", "split.fold")  # keys of params.yaml that a study sets in every cell
MAY_BE_EMPTY = ("columns", "cross", "one_seed", "one_deal", "quick")
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
    """One training of a variant and its evaluation.

    Attributes:
        deal, fold: `split.deal` and `split.fold`.
        changes: to params.yaml, as `key=value`.
    """

    variant: str
    seed: int
    deal: int
    fold: int
    changes: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.variant}, seed {self.seed}, deal {self.deal}, fold {self.fold}"


@dataclass(frozen=True)
class Study:
    """The content of studies/NAME.yaml; those without a default stand in every file.

    Attributes:
        question: 41 characters at most, for the list of studies.
        variants: {name: {key: value}}, what is compared; the key `preset` stands for the changes of that preset.
        reference: the variants, one or more, that the others are compared with; None: nothing is compared. A name of
            `variants` alone in a study with `cross` stands for that variant in the same place of the crossing.
        seeds, folds: every variant is trained from each, on each; folds `all`: as many as `split.folds` says.
        columns: of `COLUMNS`, the costs that the table shows.
        deals: ways of dealing groups to the folds (`split.deal`); every variant is trained on each fold of each.
        set: changes of every cell.
        cross: further mappings like `variants`: every combination is trained, see `crossed_name`.
        one_seed, one_deal: variants that are trained from the first seed, or on the first deal, alone.
        picture: error, or seconds: error against seconds, or curves: error against the number that the names in
            `cross`, one mapping, begin with.
        confusion: draw confusion matrices and the objects confused most.
        quick: the variants of a rehearsal, which are trained from the first seed on the first deal.
    """

    name: str
    question: str
    variants: dict
    reference: str | list[str] | None
    seeds: list[Seed]
    folds: Literal["all"] | list[Annotated[int, Range(0)]]
    columns: list[str]
    deals: list[Seed] = field(default_factory=lambda: [0])
    set: dict = field(default_factory=dict)
    cross: list[dict] = field(default_factory=list)
    one_seed: list[str] = field(default_factory=list)
    one_deal: list[str] = field(default_factory=list)
    picture: Literal["error", "seconds", "curves"] = "error"
    confusion: bool = False
    quick: list[str] = field(default_factory=list)

    @property
    def references(self) -> list[str]:
        """The variants that the others are compared with."""
        return [self.reference] if isinstance(self.reference, str) else self.reference or []

    def cells(self, *, quick: bool = False, on_top: tuple[str, ...] = ()) -> list[Cell]:
        """Every cell, or those of a rehearsal; seed by seed and deal by deal, so that the first of all is there early.

        Args:
            on_top: `key=value` changes of every cell, after all others.

        Raises:
            UserError: `on_top` names one of `AXES`.
        """
        if axis := [key for key in (change.partition("=")[0] for change in on_top) if key in AXES]:
            raise UserError(f"--set {axis[0]}: every cell has its own; set it in {FOLDER}/{self.name}.yaml")
        shared = [self.set, QUICK] if quick else [self.set]
        folds = self.folds
        if folds == "all":
            folds = range(load("params.yaml", (*_changes(shared), *on_top, "split.fold=0")).split.folds)

        def changes(parts: list[dict[str, Any]], *place: int) -> tuple[str, ...]:
            return *_changes([*shared, *parts]), *on_top, *(f"{key}={at}" for key, at in zip(AXES, place, strict=True))

        return [
            Cell(variant, seed, deal, fold, changes(parts, seed, deal, fold))
            for seed in (self.seeds[:1] if quick else self.seeds)
            for deal in (self.deals[:1] if quick else self.deals)
            for variant, parts in self._crossed()
            if (variant in self.quick if quick else seed == self.seeds[0] or variant not in self.one_seed)
            if deal == self.deals[0] or variant not in self.one_deal
            for fold in folds
        ]

    def _crossed(self) -> Iterator[tuple[str, list[dict[str, Any]]]]:
        for entries in product(*(axis.items() for axis in [self.variants, *self.cross])):
            yield crossed_name(*(name for name, _ in entries)), [changes for _, changes in entries]


def crossed_name(*names: str) -> str:
    """The variant `A / x` of A in `variants` and x in `cross`."""
    return " / ".join(names)


def name_and_place(variant: str) -> tuple[str, str]:
    """A and x of the variant `A / x`; x is empty without `cross`."""
    name, _, place = variant.partition(" / ")
    return name, place


def names() -> list[str]:
    """The studies that there are."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_study(name: str) -> Study:
    """The study of that name.

    Raises:
        UserError: there is none, a key of its file is unknown or missing, a value is of another type, or a name in it
            stands for nothing.
    """
    path = FOLDER / f"{name}.yaml"
    if not path.exists():
        raise UserError(f"study is {name!r}; expected one of {', '.join(names())} (in the repository's root)")
    tree = {"name": name} | read_yaml(path)
    known = {item.name for item in fields(Study)}
    needed = [item.name for item in fields(Study) if item.default is MISSING and item.default_factory is MISSING]
    if unknown := sorted(tree.keys() - known, key=str):
        raise UserError(f"{path}: unknown key {unknown[0]}; known here: {', '.join(sorted(known - {'name'}))}")
    if missing := [key for key in needed if key not in tree]:
        raise UserError(f"{path}: key {missing[0]} is missing; expected {', '.join(needed[1:])}")
    for key, hint in get_type_hints(Study, include_extras=True).items():
        if key not in tree or (tree[key] == [] and key in MAY_BE_EMPTY):
            continue
        try:
            convert(tree[key], hint)
        except (ValueError, TypeError, OverflowError):
            raise UserError(f"{path}: {key} is {tree[key]!r}; expected {describe(hint)}") from None
    for axis in [tree["variants"], *tree.get("cross", [])]:
        if not (axis and all(isinstance(name, str) and isinstance(changes, dict) for name, changes in axis.items())):
            raise UserError(
                f"{path}: a set of variants is {axis!r}; expected names with changes, as in {{a: {{views: 8}}}}"
            )
    study = Study(**tree)
    crossed = [name for axis in study.cross for name in axis]
    numbered = all(name.partition(" ")[0].isdecimal() for name in crossed)
    if study.picture == "curves" and not (len(study.cross) == 1 and numbered):
        raise UserError(
            f"{path}: picture is 'curves' and cross has {', '.join(map(repr, crossed)) or 'no names'}; "
            "expected one mapping in `cross`, whose names begin with a number"
        )
    variants = list(dict.fromkeys(cell.variant for cell in study.cells()))
    for key, given, allowed in (
        ("reference", study.references, [*variants, *study.variants]),
        ("one_seed", study.one_seed, variants),
        ("one_deal", study.one_deal, variants),
        ("quick", study.quick, variants),
        ("columns", study.columns, COLUMNS),
    ):
        if strange := [each for each in given if each not in allowed]:
            raise UserError(f"{path}: {key} is {strange[0]!r}; expected one of {', '.join(allowed)}")
    return study


def _changes(parts: list[dict[str, Any]]) -> Iterator[str]:
    for key, value in (item for part in parts for item in part.items()):
        if key != "preset":
            yield as_change(key, value)
        elif value in PRESETS:
            yield from preset_changes(value)
        else:
            raise UserError(f"preset is {value!r}; expected one of {', '.join(PRESETS)}")
