"""With any system, the answers of a stream up to a frame do not depend on later frames."""

from dataclasses import asdict
from itertools import chain
from typing import get_args

import numpy as np
import pytest

from tactile_viewgcn.members.network import NETWORK
from tactile_viewgcn.params import Member, System
from tests.glove_data import SHAPE, recogniser, recording

SMALL = (
    "views=4",
    "precision=float32",
    "preprocess.scale=60",
    "model.backbone.width=8",
    "pretrain.epochs=2",
    "finetune.epochs=1",
    "finetune.num_views=full",
)
NETWORKS = [
    pytest.param((f"model.system={name}", *SMALL), id=name)
    for name in get_args(System)
    if name != "sensors"
]
MEMBERS = [
    pytest.param((f"model.members=[{name}]",), id=name)
    for name in get_args(Member)
    if name != NETWORK
]
# the network is trained by a preset of its own
MEMBERS.append(pytest.param((f"model.members=[{NETWORK}]",), id=NETWORK, marks=pytest.mark.slow))
GRASPS = np.concatenate(
    [
        recording("cup", 70, before=12, held=14, after=12),
        recording("pen", 71, before=0, held=9, after=8),
    ]
)


def values_of(updates):
    """Return updates as dicts that are equal only if every digit is equal."""
    rows = []
    for update in updates:
        values = asdict(update)
        if update.probabilities is not None:
            values["probabilities"] = update.probabilities.tobytes()
        rows.append(values)
    return rows


def pushed(stream, frames):
    """Return the updates of each frame, and of the end of the input."""
    rows = [values_of(stream.push(counts, index / 10)) for index, counts in enumerate(frames)]
    return [*rows, values_of(stream.close())]


@pytest.mark.parametrize("changes", [*NETWORKS, *MEMBERS])
def test_the_updates_up_to_a_frame_are_the_same_whatever_follows_it(changes):
    model = recogniser(*changes)
    whole = pushed(model.stream(), GRASPS)
    states = [update["state"] for update in chain.from_iterable(whole)]
    assert states.count("final") == 2 and states.count("answer") == 23, states

    rng = np.random.default_rng(0)
    for last in (3, 13, 20, 27, 29, 30, 45):
        noise = rng.integers(300, 900, (9, *SHAPE), dtype=np.int16)
        other = np.concatenate([GRASPS[: last + 1], noise, recording("ball", 72)])
        assert pushed(model.stream(), other)[: last + 1] == whole[: last + 1]
    # nor does it matter how many frames are pushed at once
    times = np.arange(len(GRASPS)) / 10
    at_once = model.stream().push(GRASPS, times)
    assert values_of(at_once) == list(chain.from_iterable(whole[:-1]))
