"""Numbers and choices of a run in plain words."""

from collections.abc import Sequence
from typing import Any

from tactile_viewgcn.systems import on_sensors

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
UNSEEN = {  # what is on the test side, by `split.by`
    "source": "of the published test side",
    "recording": "of a recording that it has not learnt from",
    "grasp": "of a grasp that it has not learnt from",
    "session": "of a session that it has not learnt from",
    "frame": "right beside frames that it has learnt from",
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


def seconds(value: float) -> str:
    """3.7 s, 2 min 19 s, or 1 h 4 min."""
    if value < 60:
        return f"{value:.1f} s"
    minutes, left = divmod(round(value), 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min {left} s"


def enumerated(names: Sequence[str]) -> str:
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def system(params: dict[str, Any]) -> str:
    """What gives the answers: `ensemble` of kernel and max_kernel, which needs no neural network."""
    name = params["model.system"]
    of = f" of {enumerated(params['model.members'])}" if name == "ensemble" else ""
    return f"{name}{of}, {'without a neural network' if trains_no_network(params) else 'a neural network'}"


def trains_no_network(params: dict[str, Any]) -> bool:
    """Whether neither a backbone nor `max_network` is trained."""
    name = params["model.system"]
    return not pretrains(params) and "max_network" not in (params["model.members"] if name == "ensemble" else [name])


def pretrains(params: dict[str, Any]) -> bool:
    """Whether the system stands on the pretrained backbone."""
    return not on_sensors(params["model.system"])
