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

CHANNELS = np.ones((1, 2), dtype=bool)
ARRAY = np.ones((8, 8), dtype=bool)
NAMES = ("up", "down", "trembling", "pushed", "pulled")


def recording(name, seed, *, frames=32, live=CHANNELS):
    """Return counts (T, S) with a force on the first sensors.

    The first three objects have the same forces, each in another order.
    """
    rng = np.random.default_rng([seed, NAMES.index(name)])
    time = np.linspace(-1, 1, frames)
    in_any_order = rng.permutation(time)
    push = np.exp(-8 * time**2)
    forces = {"up": time, "down": -time, "trembling": in_any_order, "pushed": push, "pulled": -push}
    pressed = 8 if live is ARRAY else 1
    counts = rng.normal(0, 0.05, (frames, live.sum()))
    counts[:, :pressed] += forces[name][:, None]
    return (50 * counts).astype(np.float32)


def recordings(seeds=range(8), names=NAMES, **options):
    """Return a recording of each object for each seed, and their labels."""
    recordings = [recording(name, seed, **options) for seed in seeds for name in names]
    return recordings, np.tile(range(len(names)), len(seeds))


def examples_of(recordings, labels, *, live=CHANNELS, sizes=(1, 2, 4)):
    """Return the examples of recordings, in the unit of their glove."""
    frames = np.concatenate(recordings)
    scale = Representation.of(live, frames, contact_unit(frames))
    classes = max(labels) + 1
    return Examples(recordings.__getitem__, labels, scale, sizes=sizes, classes=classes, seed=0)


def fitted(names, recordings, labels, *, live=CHANNELS, sizes=(1, 2, 4), weights=None):
    """Return a classifier whose members, with these names, are fitted to recordings.

    Without weights all members have the same.
    """
    examples = examples_of(recordings, labels, live=live, sizes=sizes)
    scale = examples.representation
    classes = examples.classes
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


def answers(classifier, recordings):
    """Return the probabilities (R, classes) of recordings."""
    logits = [classifier.recording(values(classifier, counts)) for counts in recordings]
    return softmax(logits, axis=1)
