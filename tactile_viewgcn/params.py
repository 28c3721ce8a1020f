"""The parameters with their types and defaults, and the presets.

The sections are frozen, and all values are checked before any work. The params.yaml of the root
lists the same values, and says who chose each of them.
"""

from dataclasses import field
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from annotated_types import Interval, MaxLen, MinLen
from pydantic import Strict, StrictBool, StrictFloat, StrictInt, StrictStr, StringConstraints
from pydantic.dataclasses import dataclass
from pydantic.functional_validators import AfterValidator, model_validator

from tactile_viewgcn.files import home_path
from tactile_viewgcn.messages import UserError
from tactile_viewgcn.schema import SECTION, Unique, as_change, build, flatten, nearest, read_yaml

PRESETS = Path(str(files("tactile_viewgcn"))) / "presets"
VIRTUAL = "data/virtual/recordings"  # the `data.source` that the virtual glove writes
CONTACT_SIGMAS = 5.0  # a pressed sensor reads more than five standard deviations above its baseline
# this number and its inverse lie well within single precision, in which networks are trained
MAX_NUMBER = 1e30
MAX_SIDE = 256  # rows and columns of a frame; pressure mats have up to 160 x 64
MOST = 1_000_000  # upper limit of counts
COLUMN = "^(pressure|time|object|recording|session|leave_out):.+$"
# auto; or one or more of OBJECT, SESSION, SPLIT, PART and FILE, with text without capitals between
# them
LAYOUT = (
    "^(auto|[^A-Z]*(OBJECT|SESSION|SPLIT|PART|FILE)([^A-Z]+(OBJECT|SESSION|SPLIT|PART|FILE))*)$"
)
CORNERS = 8  # viewpoints of the cube
LEVELS = 3  # levels of the view-graph, with V, V // 2 and V // 4 nodes; none has only one node
SIDES = ("train", "validation", "test")  # sets of a split, by code
TRAIN, VALIDATION, TEST = range(len(SIDES))  # codes of these sets, also of a published split

System = Literal[  # all except sensors are networks on the pretrained backbone
    "view_gcn",
    "stag",
    "cnn_lstm",
    "conv_lstm",
    "mvcnn",
    "mean",
    "gvcnn",
    "rotationnet",
    "gcn",
    "vote",
    "sensors",
]
# members of the system sensors
SensorMember = Literal["trees", "svm", "convolutions", "kernel", "pooled_kernel"]
Member = Literal[SensorMember, "network"]
Count = Annotated[StrictInt, Interval(ge=1, le=MOST)]
Side = Annotated[StrictInt, Interval(ge=1, le=MAX_SIDE)]  # rows or columns of a frame
Natural = Annotated[StrictInt, Interval(ge=0, le=MOST)]
Positive = Annotated[StrictFloat, Interval(ge=1e-30, le=MAX_NUMBER)]
NotNegative = Annotated[StrictFloat, Interval(ge=0, le=MAX_NUMBER)]
Share = Annotated[StrictFloat, Interval(ge=0, lt=1)]
Seed = Annotated[StrictInt, Interval(ge=0, le=2**32 - 1)]
Batch = Annotated[StrictInt, Interval(ge=2, le=MOST)]  # batch normalisation needs two examples
Members = Annotated[list[Member], Strict(), MinLen(1), Unique]
Columns = Annotated[list[Annotated[StrictStr, StringConstraints(pattern=COLUMN)]], Strict(), Unique]
# see training/optim.py
Schedule = Literal["constant", "cosine", "compounding_cosine", "exponential"]
Effect = Literal[  # of the virtual glove
    "motion", "weight", "shift", "tremor", "fit",
    "bending", "saturation", "hysteresis", "crosstalk", "noise", "common_mode", "defects",
]  # fmt: skip
Grasped = Literal[  # by the virtual glove
    "empty_hand", "allen_key_set", "ball", "battery", "board_eraser", "bracket", "brain", "cat",
    "chain", "clip", "coin", "empty_can", "full_can", "gel", "kiwano", "lotion", "mug",
    "multimeter", "pen", "safety_glasses", "scissors", "screw_driver", "spoon", "spray_can",
    "stapler", "tape", "tea_box",
]  # fmt: skip


def everywhere(path: Path) -> Path:
    """Return `data.source` in a form that DVC's temporary workspaces find.

    Args:
        path: of the source.

    Returns:
        The absolute path. If DVC tracks the source, the path itself, since DVC copies the source to
            its temporary workspaces.
    """
    is_tracked = path.absolute().with_name(f"{path.name}.dvc").exists()
    if is_tracked or path == Path(VIRTUAL):
        return path
    return path.absolute()


def _each_word_once(layout: str) -> str:
    for word in ("OBJECT", "SPLIT", "PART", "FILE"):
        if layout.count(word) > 1:
            raise ValueError(f"{word} appears twice")
    return layout


def _written_out(path: str) -> str:
    """Return the path of the source; raise a ValueError if it begins with ~.

    Only a shell expands ~, and it does not expand ~ after `=`.
    """
    if path.startswith("~"):
        raise ValueError(f"~ is not expanded here; write data.source={home_path(path)}")
    return path


def on_sensors(name: str) -> bool:
    """Return whether a system reads the sensors and so needs no pretrained backbone."""
    return name == "sensors"


@dataclass(frozen=True, config=SECTION)
class Data:
    """How recordings are read, see `readers/source.py`."""

    source: Annotated[StrictStr, MinLen(1), AfterValidator(_written_out)] = VIRTUAL
    shape: (
        Literal["auto", "frames_last"] | Annotated[list[Side], Strict(), MinLen(2), MaxLen(2)]
    ) = "auto"
    layout: Annotated[
        StrictStr, StringConstraints(pattern=LAYOUT), AfterValidator(_each_word_once)
    ] = "auto"
    columns: Columns = field(default_factory=list)


@dataclass(frozen=True, config=SECTION)
class PreprocessSection:
    """How readings become frames, see `frames/decide.py`."""

    # auto: see frames/decide.py
    baseline: Literal["auto", "empty_hand", "grasp", "none"] = "auto"
    zero: Annotated[StrictFloat, Interval(ge=-MAX_NUMBER, le=MAX_NUMBER)] = 500.0
    filter: Literal["auto", "flags", "contact", "none"] = "auto"
    contact_sensors: Literal["auto"] | Count = "auto"
    transform: Literal["clip", "log"] = "clip"
    scale: Literal["auto"] | Positive = "auto"
    empty_hand_class: StrictBool = True


@dataclass(frozen=True, config=SECTION)
class Split:
    """Which groups are in the training set, the validation set and the test set."""

    by: Literal["source", "recording", "grasp", "session"] = "source"
    folds: Annotated[StrictInt, Interval(ge=2, le=MOST)] = 3
    fold: Natural = 0
    deal: Seed = 0
    validation: Share = 0.0
    train_groups: Literal["all"] | Count = "all"
    train_grasps: Literal["all"] | Count = "all"


@dataclass(frozen=True, config=SECTION)
class Cluster:
    """How the frames of a pool are divided into views, see `views/clustering.py`."""

    method: Literal["kmeans", "none"] = "kmeans"
    scope: Literal["object", "recording"] = "object"
    restarts: Count = 10
    assignment: Literal["index", "anchor", "random"] = "index"


@dataclass(frozen=True, config=SECTION)
class Pretrain:
    """The training of the backbone on single frames, see `training/pretraining.py`."""

    epochs: Natural = 30
    lr: Positive = 5e-3
    weight_decay: NotNegative = 1e-4
    schedule: Literal["step"] | Schedule = "step"
    step_size: Count = 10
    step_offset: Natural = 0
    batch: Batch = 32
    noise: NotNegative = 0.015


@dataclass(frozen=True, config=SECTION)
class BackboneParams:
    """The network that turns a frame into features, see `nn/backbone.py`."""

    width: Count = 64
    dropout: Share = 0.2
    readout: Literal["average", "grid"] = "average"


@dataclass(frozen=True, config=SECTION)
class Model:
    """The system that joins the views, its backbone, and options of single systems."""

    system: System = "view_gcn"
    backbone: BackboneParams = field(default_factory=BackboneParams)
    neighbours: Count | Annotated[list[Count], Strict(), MinLen(1), MaxLen(3)] = 4
    selector: Literal["per_view", "joint"] = "per_view"
    edge_distance: Literal["squared", "plain"] = "squared"
    view_loss: Literal["sum", "mean"] = "sum"
    members: Literal["auto"] | Members = field(default_factory=lambda: ["kernel", "pooled_kernel"])


@dataclass(frozen=True, config=SECTION)
class Finetune:
    """The training of the system on view sets, see `training/finetuning.py`."""

    epochs: Count = 15
    optimiser: Literal["sgd", "adam"] = "sgd"
    lr_backbone: NotNegative = 1e-4
    lr: Positive = 5e-4
    weight_decay: NotNegative = 1e-4
    schedule: Schedule = "constant"
    batch: Batch = 20
    noise: NotNegative = 0.015
    draw: Literal["clusters", "random"] = "clusters"
    resample_views: Literal["epoch", "never"] = "epoch"
    feature_reuse: Count = 8
    num_views: Literal["full", "random"] = "full"
    backbone_dropout: StrictBool = True
    moments: Literal["running", "clean"] = "clean"


@dataclass(frozen=True, config=SECTION)
class Evaluate:
    """The set that is tested, and how often view sets are drawn from it."""

    trials: Count = 10
    side: Literal["test", "validation"] = "test"


@dataclass(frozen=True, config=SECTION)
class Glove:
    """What the virtual glove simulates, see `glove/simulation.py`."""

    sessions: Annotated[StrictInt, Interval(ge=2, le=MOST)] = 5
    grasps: Count = 10
    # more than the nine frames in which a grasp is not steady
    grasp_frames: Annotated[StrictInt, Interval(ge=10, le=MOST)] = 10
    objects: Literal["all"] | Annotated[list[Grasped], Strict(), MinLen(1), Unique] = "all"
    seed: Seed = 0
    leave_out: Annotated[list[Effect], Strict(), Unique] = field(default_factory=list)


@dataclass(frozen=True, config=SECTION)
class Params:
    """All parameters, with a section for each part of the pipeline."""

    seed: Seed = 0
    views: Annotated[StrictInt, Interval(ge=1, le=1000)] = 8
    viewpoints: Literal["auto", "cube", "circle", "sphere", "random"] = "auto"
    device: Literal["auto", "cpu", "cuda"] = "auto"
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    data: Data = field(default_factory=Data)
    preprocess: PreprocessSection = field(default_factory=PreprocessSection)
    split: Split = field(default_factory=Split)
    cluster: Cluster = field(default_factory=Cluster)
    pretrain: Pretrain = field(default_factory=Pretrain)
    model: Model = field(default_factory=Model)
    finetune: Finetune = field(default_factory=Finetune)
    evaluate: Evaluate = field(default_factory=Evaluate)
    glove: Glove = field(default_factory=Glove)

    @model_validator(mode="after")
    def _goes_together(self) -> Self:
        """Refuse values that contradict each other, even if each value is allowed by itself."""
        mistakes = [
            *_split_mistakes(self),
            *_system_mistakes(self),
            *_view_mistakes(self),
            *_preprocess_mistakes(self),
        ]
        if mistakes:
            raise ValueError("; ".join(mistakes))
        return self


def _split_mistakes(params: Params) -> list[str]:
    """Return how the split contradicts itself, the tested set or the system."""
    split = params.split
    tests_validation = params.evaluate.side == "validation"
    mistakes = list[str]()
    if split.fold >= split.folds:
        mistakes.append(
            f"split.fold is {split.fold}; expected less than split.folds = {split.folds}"
        )
    if tests_validation and not split.validation:
        mistakes.append(
            "evaluate.side is validation, and split.validation is 0: expected a share of the groups"
        )
    system = params.model.system
    has_idle_validation = split.validation > 0 and not tests_validation
    if on_sensors(system) and has_idle_validation:
        mistakes.append(
            f"split.validation is {split.validation:g}, and model.system is {system}, which is "
            "calibrated without validation groups: expected 0, or evaluate.side validation"
        )
    return mistakes


def _system_mistakes(params: Params) -> list[str]:
    """Return why the system cannot be trained on fewer views than V."""
    if params.finetune.num_views != "random":
        return []
    mistakes = list[str]()
    system = params.model.system
    if params.model.selector == "joint":
        mistakes.append(
            "model.selector joint needs all views, finetune.num_views is random: expected per_view"
        )
    if system in ("stag", "rotationnet"):
        mistakes.append(
            f"model.system is {system}, which needs all views: expected finetune.num_views full"
        )
    return mistakes


def _view_mistakes(params: Params) -> list[str]:
    """Return how the number of views contradicts the viewpoints or the levels of the view-graph."""
    views = params.views
    mistakes = list[str]()
    if params.viewpoints == "cube" and views != CORNERS:
        mistakes.append(f"viewpoints is cube, which has {CORNERS} places; views is {views}")
    levels = sum(views >> level >= 2 for level in range(LEVELS))
    neighbours = params.model.neighbours
    is_short_list = isinstance(neighbours, list) and len(neighbours) < levels
    if params.model.system == "view_gcn" and is_short_list:
        mistakes.append(
            f"model.neighbours is {neighbours}: expected one number, or one for each of {levels} "
            "levels"
        )
    return mistakes


def _preprocess_mistakes(params: Params) -> list[str]:
    """Return how the filter contradicts the baseline."""
    if params.preprocess.baseline == "none" and params.preprocess.filter == "contact":
        return [
            "preprocess.filter is contact, which needs a baseline's noise: expected "
            "preprocess.filter auto"
        ]
    return []


def load(path: str | Path, changes: tuple[str, ...] = (), name: str = "") -> Params:
    """Return the parameters of a file, with changes applied, after checking all of them.

    Args:
        path: of the YAML file; a key that it lacks has its default.
        changes: `key=value` texts.
        name: the first word of an error, in place of the path.

    Raises:
        UserError: there are mistakes. The message lists each of them with its key, its value and
            the allowed values, or with the nearest known key.
        FileNotFoundError: there is no such file.
    """
    params: Params = build(Params, read_yaml(Path(path)), str(name or path), changes)
    return params


def unlike_the_file(values: dict[str, Any], path: str = "params.yaml") -> dict[str, Any]:
    """Return the values that differ from the values in a file of parameters.

    Args:
        values: by dotted key.
        path: of the file. If there is no readable file of parameters, no value is returned.
    """
    try:
        file_values = flatten(load(path))
    except (UserError, OSError):
        return {}
    return {key: value for key, value in values.items() if file_values.get(key, value) != value}


def default_params(changes: tuple[str, ...] = (), name: str = "parameters") -> Params:
    """Return the defaults, with `key=value` changes applied.

    Args:
        changes: as in `load`.
        name: the first word of an error.

    Raises:
        UserError: as in `load`.
    """
    params: Params = build(Params, {}, name, changes)
    return params


def presets() -> list[str]:
    """Return the names of the presets, each a file whose first line says what it is for."""
    return sorted(path.stem for path in PRESETS.glob("*.yaml"))


def preset_changes(name: str) -> list[str]:
    """Return a preset as `key=value` changes to params.yaml.

    No change has a space, so a shell takes each as one word.

    Args:
        name: of the preset.

    Raises:
        UserError: there is no preset of that name. The message has all names, and the nearest.
    """
    names = presets()
    if name not in names:
        raise UserError(
            f"preset is {name!r}; expected one of {', '.join(names)}{nearest(name, names)}"
        )
    return [as_change(key, value) for key, value in read_preset(name).items()]


def read_preset(name: str) -> dict[str, Any]:
    """Return the values of a preset by dotted key."""
    return read_yaml(PRESETS / f"{name}.yaml")
