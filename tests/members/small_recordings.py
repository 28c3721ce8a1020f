"""Small recordings of objects with known answers, and classifiers that are fitted to them."""

from unittest.mock import patch

import numpy as np
from scipy.special import softmax

from tactile_viewgcn.members import trees
from tactile_viewgcn.members.by_name import answering_sets, build_members
from tactile_viewgcn.members.examples import Examples
from tactile_viewgcn.members.representation import Representation, contact_unit
from tactile_viewgcn.systems.sensors import SensorClassifier, short_limit
from tactile_viewgcn.views.viewpoints import viewpoints

CHANNELS, ARRAY = np.ones((1, 2), dtype=bool), np.ones((8, 8), dtype=bool)
NAMES = ("up", "down", "trembling", "pushed", "pulled")


def recording(name, seed, *, frames=32, live=CHANNELS):
    """Return counts (T, S) with a force on the first sensors.

    The first three objects have the same forces, each in another order.
    """
    rng, time = np.random.default_rng([seed, NAMES.index(name)]), np.linspace(-1, 1, frames)
    force = {"up": time, "down": -time, "trembling": rng.permutation(time)}.get(
        name, np.exp(-8 * time**2)
    )
    counts = rng.normal(0, 0.05, (frames, live.sum()))
    counts[:, : 8 if live is ARRAY else 1] += (-1 if name == "pulled" else 1) * force[:, None]
    return (50 * counts).astype(np.float32)


def recordings(seeds=range(8), names=NAMES, **how):
    """Return recordings of each object, and their labels."""
    return [recording(name, seed, **how) for seed in seeds for name in names], np.tile(
        range(len(names)), len(seeds)
    )


def examples_of(made, labels, *, live=CHANNELS, sizes=(1, 2, 4)):
    """Return the examples of recordings, in the unit of their glove."""
    frames = np.concatenate(made)
    scale = Representation.of(live, frames, contact_unit(frames))
    classes = max(labels) + 1
    return Examples(made.__getitem__, labels, scale, sizes=sizes, classes=classes, seed=0)


def fitted(names, made, labels, *, live=CHANNELS, sizes=(1, 2, 4), weights=None):
    """Return a classifier that is fitted to recordings."""
    examples = examples_of(made, labels, live=live, sizes=sizes)
    scale, classes = examples.representation, examples.classes
    members = build_members(names, scale, classes)
    for_sets = answering_sets(members, scale, classes)
    # fewer trees are quicker, and enough for small recordings
    with patch.multiple(trees, TREES=60, QUICK_TREES=20):
        for member in members:
            member.measure(examples, seed=0)
            member.fit(examples, np.ones(len(labels), dtype=bool), seed=0)
        for member in for_sets:
            member.fit_sets(examples, seed=0)
    return SensorClassifier(
        members,
        for_sets,
        weights or dict.fromkeys(names, 1.0),
        representation=scale,
        viewpoints=viewpoints(sizes[-1]),
        classes=classes,
        short=short_limit(examples.lengths),
    )


def values(classifier, counts):
    """Return the values that the members read of the frames of counts (T, S)."""
    return classifier.frame_values(counts.reshape(-1, *classifier.representation.live.shape))


def answers(classifier, made):
    """Return the probabilities (R, classes) of recordings."""
    return softmax([classifier.recording(values(classifier, each)) for each in made], axis=1)
