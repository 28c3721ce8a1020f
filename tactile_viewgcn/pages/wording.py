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

NOTED = {  # what a stage's remark is about, by how it begins
    "filter flags": "Filter",
    "filter contact": "Filter",
    "filter": "Filter",
    "baseline": "Baseline",
    "split": "Split",
    "classes": "Objects",
    "anchors": "Anchors",
    "train": "Training side",
    "validation": "Validation side",
    "test": "Test side",
    "leak check": "Leak check",
}
WORDS = {
    "frame": "one reading of all sensors of the glove",
    "count": "the unit that the sensors are read in",
    "contact": "a frame in which enough sensors read clearly more than without an object",
    "flag": "the mark of the recordings themselves that an object is held in a frame",
    "open hand": "the glove worn, and nothing pressed",
    "empty hand": "recordings of the open hand alone; as the object empty_hand it is an answer too: nothing is held",
    "baseline": "what the sensors read of the open hand; it is subtracted from every frame",
    "network input": "what a classifier is given of a sensor: its counts above the baseline, scaled",
    "recording": "the frames taken in one go, of one object",
    "session": "the recordings between two fittings of the glove",
    "split group": "frames that never stand on two sides of the split, because they resemble each other",
    "training, test side": "what the classifier learns from, and what it is asked about afterwards",
    "validation side": "a part of the training side, held back for choices, so that the test side is used once",
    "view set": "the frames that are classified together; each is a view",
    "anchor": "a frame that a view set is drawn around; equally many of every object where there are enough",
    "cluster": "frames of an object that resemble each other; a view set takes one frame of each",
    "trial": "one drawing of a view set around each anchor",
    "guessing": "always naming the object that most test view sets are of",
    "95 % interval": "where the error would lie in 95 of 100 repetitions with other split groups of the same source; "
    "its upper end is never below that of as many groups without a mistake (26 % with 12 groups), its lower end never "
    "above that of as many groups with nothing but mistakes (74 % with 12)",
    "confidence": "the probability that the classifier gives its own answer",
    "calibration error": "how far, on average, that probability is from the share of right answers",
    "leak check": "whether the object can be told from frames without contact; then an error says little about touch",
    "backbone": "the network that turns one frame into features, trained before the classifier",
}


def percent(share: float) -> str:
    """47.3 %, in one word."""
    return f"{100 * share:.1f}\N{NO-BREAK SPACE}%"


def interval(ends: tuple[float, float] | None) -> str:
    """The ends of an error's 95 % interval in words."""
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


def joined(names: Sequence[str]) -> str:
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def system(params: dict[str, Any]) -> str:
    """What gives the answers: `ensemble` of kernel and max_kernel, which needs no neural network."""
    name = params["model.system"]
    of = f" of {joined(params['model.members'])}" if name == "ensemble" else ""
    return f"{name}{of}, {'without a neural network' if trains_no_network(params) else 'a neural network'}"


def trains_no_network(params: dict[str, Any]) -> bool:
    """Whether neither a backbone nor `max_network` is trained."""
    name = params["model.system"]
    return not pretrains(params) and "max_network" not in (params["model.members"] if name == "ensemble" else [name])


def pretrains(params: dict[str, Any]) -> bool:
    """Whether the system stands on the pretrained backbone."""
    return params["model.system"] not in get_args(OnSensors)
