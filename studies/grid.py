"""The cells of studies/NAME.yaml: each is one training, as changes to params.yaml."""

from collections.abc import Iterator
from dataclasses import field
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import MaxLen, MinLen
from pydantic import StrictStr
from pydantic.dataclasses import dataclass

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import Natural, Seed, default_params, preset_changes
from tactile_viewgcn.provenance import committed_params
from tactile_viewgcn.schema import SECTION, as_change, build, read_yaml

FOLDER = Path("studies")
COLUMNS = {  # costs, and their keys in results/timing.json
    "pretrain s": ("seconds", "pretrain"),
    "finetune s": ("seconds", "finetune"),
    "ms alone": ("latency_ms", "single", "median"),
    "ms in batches": ("latency_ms", "batch", "median"),
    "ms whole": ("latency_ms", "whole", "median"),
    "peak MB": ("peak_mb",),
}
AXES = ("seed", "split.deal", "split.fold")  # keys of params.yaml that a study sets in every cell
Seeds = Annotated[list[Seed], MinLen(1)]
# names, and changes to params.yaml
Variants = Annotated[dict[StrictStr, dict[StrictStr, Any]], MinLen(1)]


@dataclass(frozen=True)
class Cell:
    """One training of a variant and its evaluation; `changes` to the defaults are `key=value`."""

    variant: str
    seed: int
    deal: int  # `split.deal`
    fold: int  # `split.fold`
    changes: tuple[str, ...]

    def __str__(self) -> str:
        return f"{self.variant}, seed {self.seed}, deal {self.deal}, fold {self.fold}"


@dataclass(frozen=True, config=SECTION)
class Study:
    """The content of studies/NAME.yaml."""

    name: str
    question: Annotated[StrictStr, MaxLen(41)]  # what the list of studies prints
    variants: Variants  # the key `preset` among the changes stands for a preset's
    # what the others are compared with; or, with `cross`, its first part
    reference: StrictStr | list[StrictStr] | None
    seeds: Seeds  # every variant is trained from each
    # and on each; all: as many as `split.folds` says
    folds: Literal["all"] | Annotated[list[Natural], MinLen(1)]
    columns: list[Literal[tuple(COLUMNS)]]  # costs in the table
    deals: Seeds = field(default_factory=lambda: [0])  # values of `split.deal`
    set: dict[StrictStr, Any] = field(default_factory=dict)  # changes of every cell
    # further variants; every combination is trained
    cross: list[Variants] = field(default_factory=list)
    # variants that are trained from the first seed alone
    one_seed: list[StrictStr] = field(default_factory=list)
    one_deal: list[StrictStr] = field(default_factory=list)  # on the first deal alone
    # error against seconds, or along numbered names of `cross`
    picture: Literal["seconds", "curves"] | None = None

    @property
    def references(self) -> list[str]:
        return [self.reference] if isinstance(self.reference, str) else self.reference or []

    def cells(self, on_top: tuple[str, ...] = ()) -> list[Cell]:
        """All cells, seed by seed and deal by deal: changes to the committed params.yaml, `on_top` the last ones.

        Raises:
            UserError: `on_top` names one of `AXES`, or git's HEAD has no params.yaml, or a wrong
                one.
        """
        if axis := [key for key in (change.partition("=")[0] for change in on_top) if key in AXES]:
            raise UserError(
                f"--set {axis[0]}: every cell has its own; set it in {FOLDER}/{self.name}.yaml"
            )
        if not (committed := committed_params(Path("params.yaml"))):
            raise UserError(
                "no params.yaml in git's HEAD; expected the root of a clone: cells are DVC experiments"
            )
        default_params(
            values := tuple(map(as_change, committed, committed.values())),
            "params.yaml in git's HEAD",
        )
        shared, folds = (*values, *_changes(self.set)), self.folds
        if folds == "all":
            folds = list(
                range(default_params((*shared, *on_top, "split.fold=0"), self.name).split.folds)
            )
        cells = []
        for seed, deal, (variant, changes), fold in product(
            self.seeds, self.deals, self.crossed(), folds
        ):
            if seed != self.seeds[0] and variant in self.one_seed:
                continue
            if deal != self.deals[0] and variant in self.one_deal:
                continue
            place = (f"{key}={at}" for key, at in zip(AXES, (seed, deal, fold), strict=True))
            whole = (*shared, *changes, *on_top, *place)
            cells.append(Cell(variant=variant, seed=seed, deal=deal, fold=fold, changes=whole))
        return cells

    def crossed(self) -> Iterator[tuple[str, list[str]]]:
        """Name and changes of every combination of `variants` and `cross`."""
        for entries in product(*(axis.items() for axis in [self.variants, *self.cross])):
            yield (
                " / ".join(name for name, _ in entries),
                [one for _, part in entries for one in _changes(part)],
            )


def names() -> list[str]:
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_study(name: str) -> Study:
    """The study of that name.

    Raises:
        UserError: there is none, its keys or types are not those of `Study`, or it refers to an
            unknown variant.
    """
    path = FOLDER / f"{name}.yaml"
    if not path.exists():
        raise UserError(
            f"study is {name!r}; expected one of {', '.join(names())} (in the repository's root)"
        )
    study = build(Study, {**read_yaml(path), "name": name}, str(path))
    variants = [variant for variant, _ in study.crossed()]
    allowed = {
        "reference": [*variants, *study.variants],
        "one_seed": variants,
        "one_deal": variants,
    }
    for key, names_of in allowed.items():
        for each in study.references if key == "reference" else getattr(study, key):
            if each not in names_of:
                raise UserError(f"{path}: {key} is {each!r}; expected one of {', '.join(names_of)}")
    return study


def _changes(part: dict[str, Any]) -> Iterator[str]:
    for key, value in part.items():
        yield from preset_changes(value) if key == "preset" else [as_change(key, value)]
