"""Small recordings of objects whose answer is known, and classifiers fitted to them."""

from unittest.mock import patch

import numpy as np
import torch

from tactile_viewgcn.sensors import representation
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.examples import Examples, for_sets
from tactile_viewgcn.sensors.representation import Representation
from tactile_viewgcn.sensors.unit import contact_unit
from tactile_viewgcn.views.viewpoints import viewpoints

CHANNELS, ARRAY = np.ones((1, 2), dtype=bool), np.ones((8, 8), dtype=bool)
NAMES = ("up", "down", "trembling", "pushed", "pulled")


def recording(name, seed, *, frames=32, live=CHANNELS):
    """Counts (T, S): a force on the first sensors. The first three objects have the same forces, in another order."""
    rng, time = np.random.default_rng([seed, NAMES.index(name)]), np.linspace(-1, 1, frames)
    force = {"up": time, "down": -time, "trembling": rng.permutation(time)}.get(name, np.exp(-8 * time**2))
    counts = rng.normal(0, 0.05, (frames, live.sum()))
    counts[:, : 8 if live is ARRAY else 1] += (-1 if name == "pulled" else 1) * force[:, None]
    return (50 * counts).astype(np.float32)


def recordings(seeds=range(8), names=NAMES, **how):
    """Recordings of each object, and their labels."""
    return [recording(name, seed, **how) for seed in seeds for name in names], np.tile(range(len(names)), len(seeds))


def fitted(members, made, labels, *, live=CHANNELS, sizes=(1, 2, 4), classes=None):
    """A classifier of recordings in their glove's unit, with its examples as an attribute."""
    frames, names, count = np.concatenate(made), {*members, *for_sets(members)}, classes or max(labels) + 1
    read = Representation(live).fit(frames, contact_unit(frames))
    classifier = SensorClassifier(members, torch.from_numpy(viewpoints(sizes[-1])), count)
    classifier.examples = Examples(made, labels, read, sorted(names), sizes, count, 0)
    with patch.multiple(representation, TREES=60, FEWEST_TREES=20):  # quicker, and enough for small recordings
        classifier.fit(classifier.examples, 0)
    return classifier


def values(classifier, counts):
    """What the classifier keeps of the frames of counts (T, S)."""
    return classifier.frame_values(torch.from_numpy(counts).reshape(-1, 1, *classifier.representation.live.shape))


def answers(classifier, made):
    """Probabilities (R, classes) of whole recordings."""
    logits = [classifier.recording_logits(values(classifier, each)) for each in made]
    return torch.cat(logits).softmax(dim=1).numpy()
