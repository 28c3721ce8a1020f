"""The cells of studies/NAME.yaml: each is one training, as changes to params.yaml."""

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from tactile_viewgcn.errors import UserError
from tactile_viewgcn.params import load, preset_changes
from tactile_viewgcn.schema import as_change, read_yaml

FOLDER = Path("studies")
COLUMNS = {  # costs, and their keys in results/timing.json
    "pretrain s": ("seconds", "pretrain"),
    "finetune s": ("seconds", "finetune"),
    "ms alone": ("latency_ms", "single", "median"),
    "ms in batches": ("latency_ms", "batch", "median"),
    "peak MB": ("peak_mb",),
}
AXES = ("seed", "split.deal", "split.fold")  # keys of params.yaml that a study sets in every cell
#: Changes of every rehearsal: three objects and the empty hand of a small glove, trainings of one epoch
QUICK = {
    "glove.objects": ["mug", "tape", "scissors"],
    "glove.sessions": 4,
    "glove.grasps": 1,
    "glove.grasp_frames": 18,
    "model.backbone.width": 8,
    "cluster.restarts": 1,
    "pretrain.epochs": 1,
    "finetune.epochs": 1,
    "evaluate.trials": 2,
}
Seed = Annotated[int, Field(ge=0, lt=2**32)]
Fold = Annotated[int, Field(ge=0)]
Variants = Annotated[dict[str, dict[str, Any]], Field(min_length=1)]  # changes to params.yaml by name


class Cell(BaseModel):
    """One training of a variant and its evaluation; `changes` to params.yaml are `key=value`."""

    model_config = ConfigDict(frozen=True)
    variant: str
    seed: int
    deal: int  # `split.deal`
    fold: int  # `split.fold`
    changes: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.variant}, seed {self.seed}, deal {self.deal}, fold {self.fold}"


class Study(BaseModel):
    """The content of studies/NAME.yaml; docs/studies.md, "Write a study", explains the keys."""

    model_config = ConfigDict(frozen=True, strict=True, extra="forbid")
    name: str
    question: Annotated[str, Field(max_length=41)]  # it has to fit the list of studies
    variants: Variants
    reference: str | list[str] | None
    seeds: Annotated[list[Seed], Field(min_length=1)]
    folds: Literal["all"] | Annotated[list[Fold], Field(min_length=1)]
    columns: list[Literal[tuple(COLUMNS)]]
    deals: Annotated[list[Seed], Field(min_length=1)] = [0]
    set: dict[str, Any] = {}
    cross: list[Variants] = []
    one_seed: list[str] = []
    one_deal: list[str] = []
    picture: Literal["error", "seconds", "curves"] = "error"
    quick: list[str] = []

    @property
    def references(self) -> list[str]:
        return [self.reference] if isinstance(self.reference, str) else self.reference or []

    def cells(self, *, quick: bool = False, on_top: tuple[str, ...] = ()) -> list[Cell]:
        """All cells, or those of a rehearsal, seed by seed and deal by deal; `on_top` are changes after all others.

        Raises:
            UserError: `on_top` names one of `AXES`.
        """
        if axis := [key for key in (change.partition("=")[0] for change in on_top) if key in AXES]:
            raise UserError(f"--set {axis[0]}: every cell has its own; set it in {FOLDER}/{self.name}.yaml")
        shared = (*_changes(self.set), *(_changes(QUICK) if quick else ()))
        folds = self.folds
        if folds == "all":
            folds = list(range(load("params.yaml", (*shared, *on_top, "split.fold=0")).split.folds))
        cells = []
        for seed, deal in product(self.seeds[:1] if quick else self.seeds, self.deals[:1] if quick else self.deals):
            for variant, changes in self.crossed():
                wanted = variant in self.quick if quick else seed == self.seeds[0] or variant not in self.one_seed
                if wanted and (deal == self.deals[0] or variant not in self.one_deal):
                    for fold in folds:
                        place = (f"{key}={at}" for key, at in zip(AXES, (seed, deal, fold), strict=True))
                        whole = (*shared, *changes, *on_top, *place)
                        cells.append(Cell(variant=variant, seed=seed, deal=deal, fold=fold, changes=whole))
        return cells

    def crossed(self) -> Iterator[tuple[str, list[str]]]:
        """Name and changes of every combination of `variants` and `cross`."""
        for entries in product(*(axis.items() for axis in [self.variants, *self.cross])):
            yield " / ".join(name for name, _ in entries), [one for _, part in entries for one in _changes(part)]


def names() -> list[str]:
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_study(name: str) -> Study:
    """The study of that name.

    Raises:
        UserError: there is none, its keys or types are not those of `Study`, or it refers to an unknown variant.
    """
    path = FOLDER / f"{name}.yaml"
    if not path.exists():
        raise UserError(f"study is {name!r}; expected one of {', '.join(names())} (in the repository's root)")
    try:
        study = Study.model_validate({**read_yaml(path), "name": name})
    except ValidationError as error:
        mistakes = (f"{'.'.join(map(str, one['loc']))} is {one['input']!r}: {one['msg']}" for one in error.errors())
        raise UserError(f"{path}: {'; '.join(mistakes)}") from None
    variants = [variant for variant, _ in study.crossed()]
    allowed = {"reference": [*variants, *study.variants], "one_seed": variants, "one_deal": variants, "quick": variants}
    for key, known in allowed.items():
        for each in study.references if key == "reference" else getattr(study, key):
            if each not in known:
                raise UserError(f"{path}: {key} is {each!r}; expected one of {', '.join(known)}")
    places = [place for axis in study.cross for place in axis]
    numbered = len(study.cross) == 1 and all(place.partition(" ")[0].isdecimal() for place in places)
    if study.picture == "curves" and not numbered:
        raise UserError(
            f"{path}: picture is 'curves' and cross has {', '.join(map(repr, places)) or 'no names'}; "
            "expected one mapping in `cross`, whose names begin with a number"
        )
    return study


def _changes(part: dict[str, Any]) -> Iterator[str]:
    for key, value in part.items():
        yield from preset_changes(value) if key == "preset" else [as_change(key, value)]
