"""Losses and gradients for extreme batches, on a small trained classifier."""

import numpy as np
import pytest
import torch

from benchmarks.stability.rows import max_rel_error, share_not_finite
from tactile_viewgcn.recognition.model_file import build_classifier
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import recipe, table, trained
from tests.trained_network import some_sets, without_dropout

SUM = 2.0**-20  # error of single precision after a few sums
SYSTEMS = ["view_gcn", "stag", "gvcnn", "cnn_lstm", "rotationnet", "vote"]
INPUTS = table().inputs(table().on(TEST)[:24])
SETS = some_sets(24, 4, 6)
LABELS = np.arange(6) % 4


def classifier_of(system):
    """Return the small trained classifier, or another system with random weights.

    It is in training mode, but without dropout.
    """
    torch.manual_seed(0)
    places = torch.from_numpy(viewpoints(4))
    model = recipe(f"model.system={system}").model
    classifier = build_classifier(places, 4, model, (12, 12))
    if system == "view_gcn":
        classifier = trained()
    return without_dropout(classifier.train())


def loss_of(classifier, frames, sets, labels):
    """Return the loss of view sets (B, V) with labels (B,) of frames (n, H, W)."""
    nodes = classifier.backbone(frames.unsqueeze(1))
    logits, aux = classifier.head(nodes[torch.from_numpy(sets)])
    return classifier.head.loss(logits, aux, torch.from_numpy(labels))


def not_finite(system, inputs, sets=SETS, labels=LABELS):
    """Return the largest share of numbers that are not finite, in the loss or in a gradient."""
    classifier = classifier_of(system)
    loss = loss_of(classifier, torch.from_numpy(inputs.astype(np.float32)), sets, labels)
    if loss.requires_grad:
        loss.backward()
    slopes = [weight.grad for weight in classifier.parameters() if weight.grad is not None]
    return max(share_not_finite(values) for values in (loss.detach(), *slopes))


def suffix(system):
    """Return the end of a row's name, which names the system unless it is the default."""
    if system == "view_gcn":
        return ""
    return f", {system}"


@pytest.mark.stability("gradients at the extremes")
@pytest.mark.parametrize("system", SYSTEMS)
def test_every_gradient_of_extreme_batches_is_a_number(row, system):
    for name, inputs, labels in (
        ("10,000 times", 1e4 * INPUTS, LABELS),
        ("blank", np.zeros_like(INPUTS), LABELS),
        ("denormal", np.full_like(INPUTS, 1e-40), LABELS),
        ("one frame", np.repeat(INPUTS[:1], len(INPUTS), axis=0), LABELS),
        ("one class alone", INPUTS, 0 * LABELS),
        ("one view set of a class", INPUTS, np.minimum(LABELS, 1)),
    ):
        row(f"not finite, {name}{suffix(system)}", not_finite(system, inputs, labels=labels))


@pytest.mark.stability("batches of one")
def test_two_view_sets_of_two_frames_are_enough_for_batch_normalisation(row):
    share = not_finite("view_gcn", INPUTS[::20], some_sets(2, 4, 2), np.arange(2))
    row("not finite, two view sets of two frames", share)


@pytest.mark.stability("losses of sure logits")
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_systems_loss_of_logits_10_000_times_as_large(row, system):
    classifier = classifier_of(system).eval()
    head = classifier.head
    generator = torch.Generator().manual_seed(0)
    nodes = torch.rand(24, *classifier.feature_shape, generator=generator)
    labels = torch.from_numpy(LABELS)
    with torch.no_grad():
        logits, aux = head(nodes[torch.from_numpy(SETS)])
        single = head.loss(1e4 * logits, [1e4 * values for values in aux], labels)
        exact = head.loss(1e4 * logits.double(), [1e4 * values.double() for values in aux], labels)
    error = max_rel_error(single, exact)
    row(f"the system's loss of logits 10,000 times as large{suffix(system)}", error, SUM)
