"""What does not go together in params.yaml, though each value is allowed by itself."""

from collections.abc import Iterator
from typing import Any, get_args

from tactile_viewgcn.systems import OnSensors

PLACES = {"cube": 8, "dodecahedron": 20}  # viewpoints of the configurations that have a fixed number


def conflicts(params: Any) -> Iterator[str]:
    """What is wrong with a `Params` of params.py, which imports this file; one message for each conflict."""
    cluster, evaluate, finetune, model = params.cluster, params.evaluate, params.finetune, params.model
    if params.split.fold >= params.split.folds:
        yield f"split.fold is {params.split.fold}; expected less than split.folds = {params.split.folds}"
    if evaluate.side == "validation" and not params.split.validation:
        yield "evaluate.side is validation, and split.validation is 0: expected a share of the training groups"
    if params.split.by == "frame" and params.split.validation:
        yield (
            f"split.by is frame, which leaks, and split.validation is {params.split.validation:g}: expected 0, "
            "or another split.by"
        )
    can_calibrate = params.split.validation or model.system in get_args(OnSensors)  # these need no groups for it
    if evaluate.confidence_threshold and not (finetune.num_views == "random" and can_calibrate):
        yield (
            f"evaluate.confidence_threshold is {evaluate.confidence_threshold:g}, which needs a calibration: "
            "expected finetune.num_views random and split.validation above 0"
        )
    if finetune.num_views == "random" and model.selector == "joint":
        yield "model.selector is joint, which needs all views, and finetune.num_views is random: expected per_view"
    if finetune.num_views == "random" and model.system in ("stag", "rotationnet"):
        yield f"model.system is {model.system}, which needs all views: expected finetune.num_views full"
    if cluster.method == "none" and cluster.assignment in ("area", "matched"):
        yield f"cluster.assignment is {cluster.assignment}, which needs clusters: expected cluster.method kmeans"
    if model.backbone.kind == "perceptron" and model.system in ("gvcnn", "conv_lstm"):
        yield f"model.system is {model.system}, which needs feature maps: expected model.backbone.kind resnet"
    if model.backbone.kind == "perceptron" and params.pretrain.masked_epochs:
        yield "pretrain.masked_epochs is above 0, which needs feature maps: expected model.backbone.kind resnet"
    if model.pooled_view and model.system not in ("mvcnn", "mean", "vote"):
        yield f"model.pooled_view is true, and model.system is {model.system}: expected mvcnn, mean or vote"
    cube = params.viewpoints in ("auto", "cube") and params.views == PLACES["cube"]
    if model.system == "rotationnet" and model.assignments == "rotations" and not cube:
        yield (
            "model.assignments is rotations, which needs the cube: expected views 8 and viewpoints cube, "
            "or assignments any"
        )
    places = PLACES.get(params.viewpoints, params.views)
    if params.views != places:
        yield f"viewpoints is {params.viewpoints}, which has {places} places; views is {params.views}"
    if params.preprocess.baseline == "none" and params.preprocess.filter == "contact":
        yield (
            "preprocess.filter is contact, which needs the baseline's noise: "
            "expected preprocess.filter auto, or preprocess.baseline empty_hand, grasp or quiet"
        )
