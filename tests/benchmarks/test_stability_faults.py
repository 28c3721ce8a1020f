"""Faults put into the project fail the stability tests: each replaces a function by what one would write at first."""

from importlib import import_module
from inspect import signature

import numpy as np
import pytest
from sklearn.cluster import KMeans
from torch import nn
from torch.autograd.gradcheck import GradcheckError

from benchmarks.solver.other_integrators import explicit_euler
from tests.stability import Rows


def expanded_edges(positions, neighbours):
    square = positions.square().sum(dim=-1)
    distances = square[..., :, None] + square[..., None, :] - 2 * positions @ positions.transpose(-1, -2)
    return distances.unsqueeze(-1).expand(*neighbours.shape, 10)


def received_without_gradient(self, nodes):
    return nn.functional.leaky_relu(nodes.unsqueeze(1) + nodes.detach().unsqueeze(2), 0.2).sum(dim=1)


def one_pass_moments(counts):
    values = counts.astype(np.float64)
    mean = values.mean(axis=0)
    return mean, np.sqrt(np.maximum((values**2).mean(axis=0) - mean**2, 1 / 12))


def wrapped(excess, kind, scale):
    return (np.asarray(excess, np.float32) / np.float32(scale)) % 1


def always_views_many(scores, views, *, restarts, seed):
    return KMeans(views, n_init=restarts, random_state=seed).fit_predict(scores)


def euler(self, y, frames):
    return explicit_euler(self.mechanics, y, frames, self.frame, 8)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    ("target", "faulty", "test", "arguments"),
    [
        ("tests.nn.test_stability.edge_geometry", expanded_edges,
         "nn.test_stability.test_distances_keep_their_digits_a_million_away_from_the_origin", ()),
        ("tactile_viewgcn.nn.view_selection.log_odds", lambda logits, dim: logits.softmax(dim),
         "nn.test_stability.test_a_selector_with_logits_10_000_times_as_large_selects_the_same_in_single_precision",
         ()),
        ("tactile_viewgcn.nn.message_passing.NonLocalMessagePassing.received", received_without_gradient,
         "systems.test_view_gcn.test_gradients_equal_finite_differences", ()),
        ("tests.frames.test_stability.trimmed_moments", one_pass_moments,
         "frames.test_stability.test_a_signal_in_the_last_digits_of_a_billion", ("32-bit counts", 10**9, np.int32)),
        ("tactile_viewgcn.tables.frames.network_input", wrapped,
         "frames.test_stability.test_network_input_of_frames_that_no_hand_makes", ()),
        ("tests.views.test_stability.kmeans", always_views_many,
         "views.test_stability.test_three_frames_over_and_over_are_three_clusters", ()),
        ("tests.test_intervals.proportion_interval", lambda correct, groups, rng: (correct.mean(),) * 2,
         "test_intervals.test_where_all_is_right_or_wrong_the_interval_is_clopper_and_pearsons_of_the_groups",
         ("right", 1.0, 12)),
        ("tactile_viewgcn.glove.integrator.ImplicitIntegrator.run", euler,
         "glove.test_stability.test_a_loaded_plate_on_the_palm_has_the_forces_of_its_closed_form", ()),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)  # fmt: skip
def test_a_fault_fails_its_test(monkeypatch, tmp_path, target, faulty, test, arguments):
    module, _, name = f"tests.{test}".rpartition(".")
    function = getattr(import_module(module), name)
    monkeypatch.setattr(target, faulty)
    fixtures = {"row": Rows(), "tmp_path": tmp_path}
    names = list(signature(function).parameters)
    values = iter(arguments)
    with pytest.raises((AssertionError, GradcheckError)):
        function(*(fixtures[name] if name in fixtures else next(values) for name in names))
