"""The cells of a study: each is one training run, as changes to params.yaml."""

from collections.abc import Iterator, Mapping
from dataclasses import field, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import MaxLen, MinLen
from pydantic import StrictStr
from pydantic.dataclasses import dataclass

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.params import VIRTUAL, Natural, Seed, default_params, preset_changes
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
AXES = ("seed", "split.deal", "split.fold")  # keys that a study sets in every cell
WORLD = "glove.seed"  # equals `seed`, unless the study or --set names it
LONGEST_QUESTION = 47  # characters, so that a line of the list of studies has 80 columns
SEEDS = (101, 102, 103, 104, 105)  # no constant was set and nothing was chosen on these worlds
Seeds = Annotated[list[Seed], MinLen(1)]
# names, and changes to params.yaml
Variants = Annotated[dict[StrictStr, dict[StrictStr, Any]], MinLen(1)]


@dataclass(frozen=True)
class Cell:
    """One training run of a variant and its evaluation.

    Attributes:
        variant: name of the variant.
        seed: value of `seed`.
        deal: value of `split.deal`.
        fold: value of `split.fold`.
        changes: changes to the defaults, `key=value`.
        world: value of `glove.seed`, on which all simulated recordings depend. It is empty if the
            recordings come from files.
    """

    variant: str
    seed: int
    deal: int
    fold: int
    changes: tuple[str, ...]
    world: str = ""

    def __str__(self) -> str:
        return f"{self.variant}, seed {self.seed}, deal {self.deal}, fold {self.fold}"


@dataclass(frozen=True, config=SECTION)
class Study:
    """The content of studies/NAME.yaml.

    Attributes:
        name: name of the file, without `.yaml`.
        question: the question, as the list of studies prints it.
        variants: changes to params.yaml, by name of the variant. The key `preset` stands for all
            changes of a preset.
        reference: names of the variants that the others are compared with. In a study with `cross`
            it can be the first part of their names.
        seeds: seeds; every variant is trained from each of them. A seed is also the simulated
            world, `glove.seed`, so the spread over seeds covers recordings and training runs. If
            `set` has `glove.seed`, all seeds are of one world.
        folds: folds; every variant is trained on each of them. `all` stands for all folds of
            `split.folds`.
        columns: costs in the table.
        deals: values of `split.deal`.
        primary: protocol of the primary outcome. The first table and the detectable difference are
            of this protocol. It is `object` for the paper's claims, as in the paper, and `whole`,
            whole recordings, for the choice of a method.
        set: changes of every cell.
        cross: further variants; every combination is trained.
        choice: changes, by name of the choice. Every variant takes the choice with the lowest error
            on validation groups; see `candidates`. The variants in `fixed` take none.
        fixed: variants without a choice.
        one_seed: variants that are trained from the first seed only.
        one_deal: variants that are trained on the first deal only.
        each: whether the report has a row for each group that was held out. If there are many
            groups, it has a row for each fold instead.
        picture: `seconds` for error against seconds, or `curves` for the error along the numbers in
            the names of `cross`.
    """

    name: str
    question: Annotated[StrictStr, MaxLen(LONGEST_QUESTION)]
    variants: Variants
    reference: StrictStr | list[StrictStr] | None
    folds: Literal["all"] | Annotated[list[Natural], MinLen(1)]
    columns: list[Literal[tuple(COLUMNS)]]  # type: ignore[valid-type]
    seeds: Seeds = field(default_factory=lambda: list(SEEDS))
    deals: Seeds = field(default_factory=lambda: [0])
    primary: Literal["object", "recording", "whole"] = "whole"
    set: dict[StrictStr, Any] = field(default_factory=dict)
    cross: list[Variants] = field(default_factory=list)
    choice: Variants | None = None
    fixed: list[StrictStr] = field(default_factory=list)
    one_seed: list[StrictStr] = field(default_factory=list)
    one_deal: list[StrictStr] = field(default_factory=list)
    each: bool = False
    picture: Literal["seconds", "curves"] | None = None

    @property
    def references(self) -> list[str]:
        """The names under `reference`, possibly none."""
        if isinstance(self.reference, str):
            return [self.reference]
        return self.reference or []

    def candidates(self) -> "Study":
        """Return the study of all variants with all choices, evaluated on validation groups.

        A variant is named after both, as in `mean, rate 5`. The test set is not read.
        """
        variants = {}
        for variant, changes in self.variants.items():
            if variant in self.fixed:
                continue
            for choice, further in (self.choice or {}).items():
                variants[candidate(variant, choice)] = changes | further
        validated = self.set | {"evaluate.side": "validation"}
        return replace(
            self, variants=variants, set=validated, choice=None, fixed=[], reference=None
        )

    def chosen(self, choices: Mapping[str, str]) -> "Study":
        """Return the study of the variants with their chosen settings, evaluated on the test set.

        Args:
            choices: the names of the choices, by variant. A variant without one is left out, unless
                it is in `fixed`.
        """
        variants = {}
        for variant, changes in self.variants.items():
            if variant in self.fixed:
                variants[variant] = changes
            elif variant in choices:
                variants[variant] = changes | (self.choice or {})[choices[variant]]
        return replace(self, variants=variants, choice=None, fixed=[])

    def cells(self, on_top: tuple[str, ...] = ()) -> list[Cell]:
        """Return all cells, deal by deal, variant by variant and seed by seed.

        In this order cells that begin together are of different worlds, so none waits for the
        simulation of another. The changes of a cell begin with the committed params.yaml.

        Args:
            on_top: changes of every cell, `key=value`, after all others.

        Raises:
            UserError: `on_top` names one of `AXES`, or git's HEAD has no params.yaml or a wrong
                one.
        """
        for change in on_top:
            key = change.partition("=")[0]
            if key in AXES:
                raise UserError(
                    f"--set {key}: every cell has its own value; "
                    f"change the values in {FOLDER}/{self.name}.yaml"
                )
        shared = (*_committed_changes(), *_changes(self.set))
        folds = self.folds
        if folds == "all":
            params = default_params((*shared, *on_top, "split.fold=0"), self.name)
            folds = list(range(params.split.folds))
        is_one_world = any(
            change.startswith(f"{WORLD}=") for change in (*_changes(self.set), *on_top)
        )
        cells = []
        for deal, (variant, changes), seed, fold in product(
            self.deals, self.crossed(), self.seeds, folds
        ):
            if seed != self.seeds[0] and variant in self.one_seed:
                continue
            if deal != self.deals[0] and variant in self.one_deal:
                continue
            place = (f"seed={seed}", f"split.deal={deal}", f"split.fold={fold}")
            own_world = [f"{WORLD}={seed}"]
            if is_one_world:
                own_world = []
            whole = (*shared, *own_world, *changes, *on_top, *place)
            cells.append(Cell(variant, seed, deal, fold, whole, world_of(whole)))
        return cells

    def crossed(self) -> Iterator[tuple[str, list[str]]]:
        """Yield name and changes of every combination of `variants` and `cross`."""
        axes = [self.variants, *self.cross]
        for entries in product(*(axis.items() for axis in axes)):
            names_of_parts = [name for name, _ in entries]
            changes: list[str] = []
            for _, part in entries:
                changes += _changes(part)
            yield " / ".join(names_of_parts), changes


def candidate(variant: str, choice: str) -> str:
    """Return the name of a variant with one of the choices."""
    return f"{variant}, {choice}"


def world_of(changes: tuple[str, ...]) -> str:
    """Return the value of `glove.seed` with these changes; empty if recordings come from files."""
    params = default_params(changes)
    if params.data.source != VIRTUAL:
        return ""
    return str(params.glove.seed)


def names() -> list[str]:
    """Return the names of all studies."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_study(name: str) -> Study:
    """Read and check a study.

    Args:
        name: name of its file in studies/, without `.yaml`.

    Raises:
        UserError: there is no such study, its keys or types are not as in `Study`, or it refers to
            an unknown variant.
    """
    path = FOLDER / f"{name}.yaml"
    if not path.exists():
        raise UserError(
            f"study is {name!r}; expected one of {', '.join(names())}, "
            "and the repository's root as the working folder"
        )
    study: Study = build(Study, {**read_yaml(path), "name": name}, str(path))
    variants = [variant for variant, _ in study.crossed()]
    _check_names(path, "reference", study.references, [*variants, *study.variants])
    _check_names(path, "one_seed", study.one_seed, variants)
    _check_names(path, "fixed", study.fixed, variants)
    if study.choice and study.cross:
        raise UserError(f"{path}: choice and cross; expected only one of them")
    if study.each and len(variants) * len(study.seeds) * len(study.deals) > 1:
        raise UserError(f"{path}: each is true; expected one variant, one seed and one deal")
    _check_names(path, "one_deal", study.one_deal, variants)
    return study


def _check_names(path: Path, key: str, names_in_file: list[str], expected: list[str]) -> None:
    """Raise a UserError if a key of a study's file has a name that is not expected."""
    for name in names_in_file:
        if name not in expected:
            raise UserError(f"{path}: {key} is {name!r}; expected one of {', '.join(expected)}")


def _committed_changes() -> tuple[str, ...]:
    """Return the values of params.yaml in git's HEAD as changes to the defaults.

    Raises:
        UserError: git's HEAD has no params.yaml or a wrong one.
    """
    committed = committed_params(Path("params.yaml"))
    if not committed:
        raise UserError(
            "no params.yaml in git's HEAD; "
            "run this in the root of a clone, since cells are DVC experiments"
        )
    changes = tuple(as_change(key, value) for key, value in committed.items())
    default_params(changes, "params.yaml in git's HEAD")  # checks them
    return changes


def _changes(part: dict[str, Any]) -> list[str]:
    """Return the changes of a variant, or of `set`, as texts `key=value`."""
    changes: list[str] = []
    for key, value in part.items():
        if key == "preset":
            changes += preset_changes(value)
        else:
            changes.append(as_change(key, value))
    return changes
