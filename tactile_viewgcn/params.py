"""The typed form of params.yaml and its presets: frozen objects, every mistake found before any work.

A field's type says what it may hold, see `schema`. There are no defaults here: they stand in params.yaml, once.
"""

from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml

from tactile_viewgcn.conflicts import conflicts
from tactile_viewgcn.errors import UserError
from tactile_viewgcn.schema import EndingIn, Range, as_change, build, set_value
from tactile_viewgcn.systems import Member, System

PRESETS = ("released", "stag", "wang", "stable", "fast", "network", "best")
DEFAULTS = Path(str(files("tactile_viewgcn"))) / "params.yaml"  # a link to the repository's, a copy in a wheel
VIRTUAL = "data/virtual/recordings"  # the `data.source` that data/virtual/dvc.yaml makes
MAX_NUMBER = 1e30  # it and its inverse are far inside single precision, in which the trainings compute

LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # in C where there is one: ten times as fast
Count = Annotated[int, Range(1)]
Positive = Annotated[float, Range(1 / MAX_NUMBER, MAX_NUMBER)]
NotNegative = Annotated[float, Range(0, MAX_NUMBER)]
Share = Annotated[float, Range(0, 1, open="high")]
NumberOfViews = Annotated[int, Range(1, 1000)]
Seed = Annotated[int, Range(0, 2**32 - 1)]
Schedule = Literal["constant", "step", "cosine", "compounding_cosine", "exponential"]  # see training/optim.py


@dataclass(frozen=True)
class Data:
    source: str


@dataclass(frozen=True)
class PreprocessSection:
    baseline: Literal["auto", "empty_hand", "grasp", "quiet", "none"]  # auto: see frames/automatic.py
    quiet_share: Annotated[float, Range(0, 1, open="low")]
    zero: Annotated[float, Range(-MAX_NUMBER, MAX_NUMBER)]
    filter: Literal["auto", "flags", "contact", "none"]
    contact_sensors: Literal["auto"] | Count
    contact_sigmas: Positive
    transform: Literal["clip", "log"]
    scale: Literal["auto"] | Positive
    empty_hand_class: bool
    balance_minimum: Count


@dataclass(frozen=True)
class Preprocess:
    """The same, every `auto` decided."""

    baseline: str
    quiet_share: float
    zero: float
    filter: str
    contact_sensors: int
    contact_sigmas: float
    transform: str
    scale: float
    empty_hand_class: bool
    balance_minimum: int


@dataclass(frozen=True)
class Split:
    by: Literal["source", "recording", "grasp", "session", "frame"]
    folds: Annotated[int, Range(2)]
    fold: Annotated[int, Range(0)]
    deal: Seed
    seed: Seed
    validation: Share
    train_share: Annotated[float, Range(0, 1, open="low")]
    train_groups: Literal["all"] | Count


@dataclass(frozen=True)
class Cluster:
    method: Literal["kmeans", "none"]
    scope: Literal["object", "recording"]
    components: Count
    restarts: Count
    assignment: Literal["index", "anchor", "random", "area", "matched"]
    seed: Seed


@dataclass(frozen=True)
class AugmentParams:
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
    schedule: Schedule
    step_size: Count
    step_offset: Annotated[int, Range(0)]
    batch: Annotated[int, Range(2)]
    noise: NotNegative
    masked_epochs: Annotated[int, Range(0)]


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
    start: Literal["random", "max"]
    readout: Literal["max", "mean"]
    assignments: Literal["any", "rotations"]
    members: list[Member]
    pooled_view: bool
    dropout: Share


@dataclass(frozen=True)
class Finetune:
    epochs: Count
    optimiser: Literal["sgd", "adam", "adamw"]
    lr_backbone: NotNegative
    lr: Positive
    weight_decay: NotNegative
    momentum: Share
    schedule: Schedule
    step_size: Count
    step_offset: Annotated[int, Range(0)]
    batch: Annotated[int, Range(2)]
    noise: NotNegative
    draw: Literal["clusters", "random"]
    resample_views: Literal["epoch", "never"]
    feature_reuse: Count
    num_views: Literal["full", "random"]
    backbone_dropout: bool
    moments: Literal["running", "clean"]


@dataclass(frozen=True)
class Evaluate:
    trials: Count
    side: Literal["test", "validation"]
    confidence_threshold: Share
    protocols: list[Literal["object", "recording"]]


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
    launcher: Annotated[str, EndingIn("-m")]
    data: Data
    preprocess: PreprocessSection
    split: Split
    cluster: Cluster
    augment: AugmentParams
    pretrain: Pretrain
    model: Model
    finetune: Finetune
    evaluate: Evaluate
    glove: Glove


def load(path: str | Path, changes: tuple[str, ...] = (), name: str = "") -> Params:
    """Parameters of the file at `path` with `key=value` changes on top, all checked.

    Args:
        name: what an error begins with; else the path.

    Raises:
        UserError: lists every mistake, each with its key, the value, what is allowed and the nearest known name.
        FileNotFoundError: no such file.
    """
    tree = read_yaml(Path(path))
    mistakes = [mistake for change in changes if (mistake := set_value(tree, change))]
    params = build(Params, tree, mistakes)
    if not mistakes:
        mistakes = list(conflicts(params))
    if mistakes:
        raise UserError(f"{name or path}: " + "; ".join(mistakes))
    return params


def read_yaml(path: Path) -> dict[str, Any]:
    """The keys and values of a YAML file.

    Raises:
        UserError: it is not YAML, or something else than keys and values, such as empty.
        FileNotFoundError: no such file.
    """
    try:
        tree = yaml.load(path.read_text(), Loader=LOADER)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(tree, dict):
        raise UserError(f"{path}: expected keys and values, found {'nothing' if tree is None else type(tree).__name__}")
    return tree


def preset_changes(name: str) -> list[str]:
    """A preset as `key=value` changes to params.yaml, none with a space in it, so that each is one word of a shell."""
    text = (files("tactile_viewgcn") / "presets" / f"{name}.yaml").read_text()
    return [as_change(key, value) for key, value in yaml.safe_load(text).items()]
