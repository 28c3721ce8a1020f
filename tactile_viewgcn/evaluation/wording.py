"""Numbers and choices of a run in plain words."""

from collections.abc import Sequence
from typing import Any, get_args

from tactile_viewgcn.systems import OnSensors

BASELINES = {
    "empty_hand": "what the empty hand reads in the same session is subtracted",
    "grasp": "what the open hand reads before each grasp is subtracted",
    "quiet": "the mean of the recording's quietest frames is subtracted",
    "none": "the same constant is subtracted everywhere",
}
FILTERS = {
    "flags": "frames that the recordings mark as valid",
    "contact": "frames in which enough sensors are pressed",
    "none": "all frames",
}
SPLITS = {
    "source": "the split published with the recordings",
    "recording": "whole recordings",
    "grasp": "whole grasps",
    "session": "whole sessions",
    "frame": "single frames, so that neighbours in time stand on both sides",
}
PROTOCOLS = {
    "recording": "all frames of an answer come from one recording, as in use",
    "object": "the frames come from any test recording of the object, as in the paper",
}
STAGES = {
    "ingest": "read and check the recordings",
    "preprocess": "subtract the baseline, choose frames, split",
    "cluster": "group each object's frames into views",
    "pretrain": "train the backbone on single frames",
    "finetune": "train on view sets, or fit",
    "evaluate": "test",
}


def percent(share: float) -> str:
    """47.3 %, in one word."""
    return f"{100 * share:.1f}\N{NO-BREAK SPACE}%"


def interval(score: dict[str, Any]) -> str:
    """The 95 % interval of a protocol's error."""
    ends = error_ends(score)
    return f"{100 * ends[0]:.1f} to {percent(ends[1])}" if ends else "none: there is one group"


def error_ends(score: dict[str, Any]) -> tuple[float, float] | None:
    """Low and high end of the error's interval, as fractions."""
    ends = score["top1"]["ci95"]
    return (1 - ends["high"], 1 - ends["low"]) if ends else None


def seconds(value: float) -> str:
    """3.7 s, 2 min 19 s, or 1 h 4 min."""
    if value < 60:
        return f"{value:.1f} s"
    minutes, rest = divmod(round(value), 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min {rest} s"


def listed(names: Sequence[str]) -> str:
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def system(params: dict[str, Any]) -> str:
    """What gives the answers: `ensemble` of kernel and max_kernel, which needs no neural network."""
    name = params["model.system"]
    of = f" of {listed(params['model.members'])}" if name == "ensemble" else ""
    return f"{name}{of}, {'without a neural network' if trains_no_network(params) else 'a neural network'}"


def trains_no_network(params: dict[str, Any]) -> bool:
    """Whether neither a backbone nor `max_network` is trained."""
    name = params["model.system"]
    return not pretrains(params) and "max_network" not in (params["model.members"] if name == "ensemble" else [name])


def pretrains(params: dict[str, Any]) -> bool:
    """Whether the system stands on the pretrained backbone."""
    return params["model.system"] not in get_args(OnSensors)
