"""The typed form of params.yaml: frozen objects, every mistake found before any work.

A field's type says what it may hold; `Annotated` adds its range. There are no defaults here: they stand in
params.yaml, once.
"""

import math
from dataclasses import dataclass, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import yaml


@dataclass(frozen=True)
class Range:
    """Allowed numbers: low <= x <= high, without the ends where `open` says so ("low", "high" or "both")."""

    low: float = -math.inf
    high: float = math.inf
    open: str = ""

    def __contains__(self, x: float) -> bool:
        above = x > self.low if self.open in ("low", "both") else x >= self.low
        below = x < self.high if self.open in ("high", "both") else x <= self.high
        return above and below and math.isfinite(x)

    def __str__(self) -> str:
        left = "(" if self.open in ("low", "both") or math.isinf(self.low) else "["
        right = ")" if self.open in ("high", "both") or math.isinf(self.high) else "]"
        return f"in {left}{self.low:.10g}, {self.high:.10g}{right}"


SINGLE = 1e30  # a number that single precision holds with room to spare, as one over it: the trainings compute in it
Count = Annotated[int, Range(1)]
Positive = Annotated[float, Range(1 / SINGLE, SINGLE)]
NotNegative = Annotated[float, Range(0, SINGLE)]
Share = Annotated[float, Range(0, 1, open="high")]
NumberOfViews = Annotated[int, Range(1, 1000)]
Seed = Annotated[int, Range(0, 2**32 - 1)]
# each the file of that name in nn/; the names stand in no module, so that a new one makes no stage run again
System = Literal[tuple((Path(__file__).parent / "nn" / "systems.txt").read_text().split())]


@dataclass(frozen=True)
class Data:
    source: str


@dataclass(frozen=True)
class Preprocess:
    baseline: Literal["empty_hand", "quiet", "none"]
    quiet_share: Annotated[float, Range(0, 1, open="low")]
    zero: Annotated[float, Range(-SINGLE, SINGLE)]
    filter: Literal["flags", "contact"]
    contact_sensors: Count
    contact_sigmas: Positive
    transform: Literal["clip", "log"]
    scale: Positive
    empty_hand_class: bool
    balance_minimum: Count


@dataclass(frozen=True)
class Split:
    by: Literal["source", "recording", "grasp", "session"]
    folds: Annotated[int, Range(2)]
    fold: Annotated[int, Range(0)]
    seed: Seed
    validation: Share


@dataclass(frozen=True)
class Cluster:
    method: Literal["kmeans", "none"]
    scope: Literal["object", "recording"]
    components: Count
    restarts: Count
    assignment: Literal["index", "anchor", "random", "area", "matched"]


@dataclass(frozen=True)
class Augment:
    gain: NotNegative
    drop: Share
    shift: Annotated[int, Range(0, 8)]


@dataclass(frozen=True)
class Pretrain:
    epochs: Annotated[int, Range(0)]
    optimiser: Literal["sgd", "adam", "adamw"]
    lr: Positive
    weight_decay: NotNegative
    momentum: Share
    schedule: Literal["halving", "cosine"]
    halve_every: Count
    halve_early: Annotated[int, Range(0)]
    batch: Annotated[int, Range(2)]
    noise: NotNegative


@dataclass(frozen=True)
class Backbone:
    kind: Literal["resnet", "perceptron"]
    width: Count
    blocks: Count
    dropout: Share
    readout: Literal["average", "grid"]


@dataclass(frozen=True)
class Model:
    system: System
    backbone: Backbone
    neighbours: Count | list[Count]
    selector_neighbours: Count
    selector: Literal["per_view", "joint"]
    selector_hidden: Annotated[int, Range(0)]
    edge_distance: Literal["squared", "plain"]
    view_loss: Literal["sum", "mean"]
    readout: Literal["max", "mean"]
    assignments: Literal["any", "rotations"]
    dropout: Share


@dataclass(frozen=True)
class Finetune:
    epochs: Count
    optimiser: Literal["sgd", "adam", "adamw"]
    lr_backbone: NotNegative
    lr: Positive
    weight_decay: NotNegative
    momentum: Share
    schedule: Literal["constant", "compounding_cosine", "tenth_in_100", "cosine"]
    batch: Annotated[int, Range(2)]
    noise: NotNegative
    draw: Literal["clusters", "random"]
    redraw: Literal["epoch", "never"]
    reuse: Count
    sizes: Literal["full", "random"]
    backbone_dropout: bool


@dataclass(frozen=True)
class Evaluate:
    trials: Count
    stop_at: Share
    scope: list[Literal["object", "recording"]]


@dataclass(frozen=True)
class Effects:
    motion: bool
    weight: bool
    shift: bool
    tremor: bool
    fit: bool
    bending: bool
    saturation: bool
    hysteresis: bool
    crosstalk: bool
    noise: bool
    common_mode: bool
    defects: bool


@dataclass(frozen=True)
class Glove:
    scale: Literal["small", "stag"]
    sessions: Annotated[int, Range(2)]
    grasps: Count
    grasp_frames: Count
    objects: Literal["all"] | list[str | dict]
    seed: Seed
    frame_rate: Positive
    skin_stiffness: Positive
    skin_thickness: Positive
    joint_damping: Positive
    object_damping: Positive
    tolerance: Positive
    effects: Effects


@dataclass(frozen=True)
class Params:
    seed: Seed
    views: NumberOfViews
    viewpoints: Literal["auto", "cube", "circle", "dodecahedron", "sphere", "random"]
    device: Literal["auto", "cpu", "cuda"]
    precision: Literal["auto", "float32", "bfloat16"]
    data: Data
    preprocess: Preprocess
    split: Split
    cluster: Cluster
    augment: Augment
    pretrain: Pretrain
    model: Model
    finetune: Finetune
    evaluate: Evaluate
    glove: Glove


def flat(params: Any, prefix: str = "") -> dict[str, Any]:
    """Every value under its dotted key, for example {"cluster.method": "kmeans"}."""
    found: dict[str, Any] = {}
    for field in fields(params):
        value, key = getattr(params, field.name), prefix + field.name
        found |= flat(value, key + ".") if is_dataclass(value) else {key: value}
    return found


def load(path: str | Path, changes: tuple[str, ...] = ()) -> Params:
    """Read and check params.yaml, with `key=value` changes put on top.

    Raises ValueError that lists every mistake, each with its key, the value found, what is allowed and the
    nearest known name; FileNotFoundError where there is no such file.
    """
    path = Path(path)
    try:
        tree = yaml.safe_load(path.read_text())
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(tree, dict):
        raise ValueError(f"{path}: expected keys and values, found {type(tree).__name__}")
    mistakes = [mistake for change in changes if (mistake := _put(tree, change))]
    params = _build(Params, tree, "", mistakes)
    if not mistakes:
        mistakes = _clashes(params)
    if mistakes:
        raise ValueError(f"{path}: " + "; ".join(mistakes))
    return params


def _put(tree: dict, change: str) -> str | None:
    """Set `a.b=value` in the tree; a sentence where that cannot be done."""
    key, equals, text = change.partition("=")
    if not equals:
        return f"--set {change!r}: expected key=value"
    *sections, name = key.split(".")
    for section in sections:
        tree = tree.setdefault(section, {})
        if not isinstance(tree, dict):
            return f"--set {key}: {section} is no section"
    try:
        tree[name] = yaml.safe_load(text)
    except yaml.YAMLError:
        return f"--set {key}: {text!r} is not YAML"
    return None


def _build(kind: type, tree: dict, prefix: str, mistakes: list[str]) -> Any:
    """An object of `kind` from a mapping; what is wrong is added to `mistakes`, and None returned."""
    hints, count = get_type_hints(kind, include_extras=True), len(mistakes)
    for key in tree.keys() - hints.keys():
        near = get_close_matches(str(key), hints, n=1, cutoff=0.5)
        known = f"did you mean {prefix}{near[0]}?" if near else f"known here: {', '.join(hints)}"
        mistakes.append(f"unknown key {prefix}{key}; {known}")
    values = {}
    for key, hint in hints.items():
        if key not in tree:
            mistakes.append(f"missing key {prefix}{key}; expected {_describe(hint)}")
        elif is_dataclass(hint):
            if isinstance(tree[key], dict):
                values[key] = _build(hint, tree[key], f"{prefix}{key}.", mistakes)
            else:
                mistakes.append(f"{prefix}{key} is {tree[key]!r}; expected a section with keys")
        else:
            try:
                values[key] = _convert(tree[key], hint)
            except (ValueError, TypeError, OverflowError):
                choices = get_args(hint) if get_origin(hint) is Literal else ()
                near = get_close_matches(str(tree[key]), choices, n=1, cutoff=0.6)
                hint_text = _describe(hint) + (f" (did you mean {near[0]}?)" if near else "")
                mistakes.append(f"{prefix}{key} is {tree[key]!r}; expected {hint_text}")
    mistakes[count:] = sorted(mistakes[count:])
    return kind(**values) if len(mistakes) == count else None


def _convert(value: Any, hint: Any) -> Any:
    """`value` as the type that `hint` names; ValueError or TypeError where it is none."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        number = _convert(value, args[0])
        if number not in args[1]:
            raise ValueError(value)
        return number
    if origin is Literal:
        if not isinstance(value, str) or value not in args:
            raise ValueError(value)
        return value
    if origin is list:
        if not isinstance(value, list) or not value:
            raise TypeError(value)
        items = [_convert(item, args[0]) for item in value]
        if get_origin(args[0]) is Literal and len(set(items)) < len(items):
            raise ValueError(value)
        return items
    if args:  # a union: the first type that fits
        for choice in args:
            try:
                return _convert(value, choice)
            except (ValueError, TypeError, OverflowError):
                continue
        raise ValueError(value)
    if hint is float and isinstance(value, str):
        return float(value)  # PyYAML reads 5e-4, which has no point, as text
    if hint is float and type(value) is int:
        return float(value)
    if type(value) is not hint:
        raise TypeError(value)
    return value


def _describe(hint: Any) -> str:
    """What a type allows, in words."""
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return f"{_describe(args[0])} {args[1]}"
    if origin is Literal:
        return " | ".join(args)
    if origin is list:
        return f"a list of {_describe(args[0])}"
    if args:
        return " or ".join(_describe(arg) for arg in args)
    if is_dataclass(hint):
        return "a section"
    return {int: "an integer", float: "a number", bool: "true or false", str: "a text", dict: "a mapping"}[hint]


def _clashes(params: Params) -> list[str]:
    """Values that are allowed one by one and not together."""
    found = []
    if params.split.fold >= params.split.folds:
        found.append(f"split.fold is {params.split.fold}; expected less than split.folds = {params.split.folds}")
    if params.evaluate.stop_at and not (params.finetune.sizes == "random" and params.split.validation):
        found.append(
            f"evaluate.stop_at is {params.evaluate.stop_at:g}, which needs finetune.sizes random and split.validation "
            "above 0 for its calibration"
        )
    if params.finetune.sizes == "random" and params.model.selector == "joint":
        found.append("model.selector is joint, which needs all views, and finetune.sizes is random: expected per_view")
    if params.cluster.method == "none" and params.cluster.assignment in ("area", "matched"):
        found.append(f"cluster.assignment is {params.cluster.assignment}, which needs clusters; cluster.method is none")
    if params.model.backbone.kind == "perceptron" and params.model.system in ("gvcnn", "conv_lstm"):
        found.append(
            f"model.system is {params.model.system}, which needs feature maps; model.backbone.kind perceptron has none"
        )
    cube = params.viewpoints == "cube" or (params.viewpoints == "auto" and params.views == 8)
    if params.model.system == "rotationnet" and params.model.assignments == "rotations" and not cube:
        found.append(
            "model.assignments is rotations, which needs the cube: expected views 8 and viewpoints cube, "
            "or assignments any"
        )
    if params.finetune.sizes == "random" and params.model.system in ("stag", "wang", "rotationnet"):
        found.append(
            f"model.system is {params.model.system}, which needs all views, and finetune.sizes is random: expected full"
        )
    needed = {"cube": 8, "dodecahedron": 20}.get(params.viewpoints, params.views)
    if params.views != needed:
        found.append(f"viewpoints is {params.viewpoints}, which has {needed} places; views is {params.views}")
    if params.preprocess.baseline == "none" and params.preprocess.filter == "contact":
        found.append(
            "preprocess.filter is contact, which needs rest noise; preprocess.baseline is none: "
            "expected empty_hand or quiet"
        )
    return found
