"""The answers of a stream up to a frame do not depend on later frames, with any system."""

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
# trained by its own preset
MEMBERS.append(pytest.param((f"model.members=[{NETWORK}]",), id=NETWORK, marks=pytest.mark.slow))
GRASPS = np.concatenate(
    [
        recording("cup", 70, before=12, held=14, after=12),
        recording("pen", 71, before=0, held=9, after=8),
    ]
)


def told(updates):
    """Return updates as values that are equal only if every digit is equal."""
    return [
        (
            *(update.state, update.frame, update.time, update.object, update.probability),
            *(update.frames, update.seconds, update.note),
            None if update.probabilities is None else update.probabilities.tobytes(),
        )
        for update in updates
    ]


def pushed(stream, frames):
    """Return what each frame changed, and what the end of the input changed."""
    rows = [stream.push(counts, number / 10) for number, counts in enumerate(frames)]
    return [told(row) for row in rows] + [told(stream.close())]


@pytest.mark.parametrize("changes", [*NETWORKS, *MEMBERS])
def test_the_updates_up_to_a_frame_are_the_same_whatever_follows_it(changes):
    model = recogniser(*changes)
    whole = pushed(model.stream(), GRASPS)
    states = [update[0] for row in whole for update in row]
    assert states.count("final") == 2 and states.count("answer") == 23, states

    rng = np.random.default_rng(0)
    for last in (3, 13, 20, 27, 29, 30, 45):
        noise = rng.integers(300, 900, (9, *SHAPE), dtype=np.int16)
        other = np.concatenate([GRASPS[: last + 1], noise, recording("ball", 72)])
        assert pushed(model.stream(), other)[: last + 1] == whole[: last + 1]
    # nor does it matter how many frames are pushed at once
    times = np.arange(len(GRASPS)) / 10
    at_once = model.stream().push(GRASPS, times)
    assert told(at_once) == [update for row in whole[:-1] for update in row]
