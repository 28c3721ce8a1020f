"""Faults put into the project turn rows of the stability tests WRONG; `test_tunnelling` steps over a contact."""

import warnings
from inspect import signature

import numpy as np
import pytest
from sklearn.cluster import KMeans
from torch import nn
from torch.autograd.gradcheck import GradcheckError

import tests.evaluation.test_statistics as evaluation
import tests.frames.test_stability as frames
import tests.glove.test_stability as glove
import tests.nn.test_stability as graph
import tests.systems.test_view_gcn as equations
import tests.test_intervals as intervals
import tests.training.test_pretraining as pretraining
import tests.views.test_stability as clusters
from benchmarks.solver.other_integrators import explicit_euler
from tactile_viewgcn.glove import newton
from tests.stability import Rows


def expanded(positions):
    square = positions.square().sum(dim=-1)
    return square[..., :, None] + square[..., None, :] - 2 * positions @ positions.transpose(-1, -2)


def expanded_edges(positions, neighbours):
    return expanded(positions).unsqueeze(-1).expand(*neighbours.shape, 10)


def odds_of_large_powers(logits, dim):
    powers = logits.exp()
    p = powers / powers.sum(dim, keepdim=True)
    return (p / (1 - p)).log()


def received_without_gradient(self, nodes):
    return nn.functional.leaky_relu(nodes.unsqueeze(1) + nodes.detach().unsqueeze(2), 0.2).sum(dim=1)


def one_pass_moments(counts):
    values = counts.astype(np.float64)
    mean = values.mean(axis=0)
    return mean, np.sqrt(np.maximum((values**2).mean(axis=0) - mean**2, frames.ROUNDING_SD**2))


def divided_by_no_noise(recordings, baseline, *, sensors, sigmas):
    counts = recordings.frames(np.arange(len(recordings))).astype(np.float64)
    noise = np.where(baseline.noise < 0.3, 0.0, baseline.noise)[baseline.of_frame]
    with np.errstate(divide="ignore", invalid="ignore"):
        return (((counts - baseline.mean[baseline.of_frame]) / noise) > sigmas).sum(axis=(1, 2)) >= sensors


def wrapped(excess, kind, scale):
    return (np.asarray(excess, np.float32) / np.float32(scale)) % 1


def kmeans_of_near_duplicates(scores, views, *, restarts, seed):
    with warnings.catch_warnings(action="ignore"):
        return KMeans(views, n_init=restarts, random_state=seed).fit_predict(scores)


def nearest_ranks(values):
    return {"median": np.sort(values)[len(values) // 2], "p95": values.max()}


def euler(self, y, frames):
    return explicit_euler(self.mechanics, y, frames, self.frame, 8)


def end_at_once(iterate):
    def once(self, rows, mechanics, at):
        iterate(self, rows, mechanics, at)
        self.best[rows] = self.tried[rows]
        return np.ones(len(rows), dtype=bool), np.ones(len(rows), dtype=bool)

    return once


#: Name: what is replaced, by what, and the test that sees it with its arguments.
FAULTS = {
    "distances by expansion": (
        "tests.nn.test_stability.squared_distances", expanded,
        graph.test_distances_keep_their_digits_a_million_away_from_the_origin, (),
    ),
    "edges by expansion": (
        "tests.nn.test_stability.edge_geometry", expanded_edges,
        graph.test_distances_keep_their_digits_a_million_away_from_the_origin, (),
    ),
    "ranks in the network's precision": (
        "tactile_viewgcn.nn.graph._ranks", expanded, graph.test_the_graph_and_its_network_at_extreme_places, (),
    ),
    "a softmax of large numbers": (
        "tests.nn.test_stability.log_odds", odds_of_large_powers, graph.test_log_odds_of_large_logits, (),
    ),
    "certainty that saturates": (
        "tactile_viewgcn.nn.view_selection.log_odds", lambda logits, dim: logits.softmax(dim),
        graph.test_a_selector_with_logits_10_000_times_as_large_selects_the_same_in_single_precision, (),
    ),
    "a sum of messages without its gradient": (
        "tactile_viewgcn.nn.message_passing.NonLocalMessagePassing.received", received_without_gradient,
        equations.test_gradients_equal_finite_differences, (),
    ),
    "moments in one pass": (
        "tests.frames.test_stability.trimmed_moments", one_pass_moments,
        frames.test_a_signal_in_the_last_digits_of_a_billion, ("32-bit counts", 10**9, np.int32),
    ),
    "division by no noise": (
        "tests.frames.test_stability.in_contact", divided_by_no_noise,
        frames.test_of_a_sensor_without_noise_one_count_more_is_noise_and_two_are_contact, ("counts", np.int16, 1),
    ),
    "clipping that wraps": (
        "tactile_viewgcn.tables.frames.network_input", wrapped,
        frames.test_network_input_of_frames_that_no_hand_makes, (),
    ),
    "k-means of near duplicates": (
        "tests.views.test_stability.kmeans", kmeans_of_near_duplicates,
        clusters.test_three_frames_over_and_over_are_three_clusters, (),
    ),
    "an interval without width": (
        "tests.test_intervals.proportion_interval", lambda correct, groups, rng: (correct.mean(),) * 2,
        intervals.test_where_all_is_right_or_wrong_the_interval_is_clopper_and_pearsons_of_the_groups,
        ("right", 1.0, 12),
    ),
    "confidence against each answer": (
        "tests.evaluation.test_statistics.calibration_error",
        lambda confidence, correct: abs(confidence - correct).mean(),
        evaluation.test_the_calibration_error_of_one_bin_is_how_far_confidence_is_from_the_share_correct, (),
    ),
    "the nearest rank": (
        "tests.evaluation.test_statistics.median_and_p95", nearest_ranks,
        evaluation.test_the_median_and_the_tail_of_few_values_by_hand, ([1.0, 3.0], 2, 2.9),
    ),
    "a training that is never looked at": (
        "tactile_viewgcn.training.loop.has_diverged", lambda *_: False,
        pretraining.test_a_training_that_diverges_later_keeps_the_last_good_weights, (1e9,),
    ),
    "an explicit method on a stiff plate": (
        "tactile_viewgcn.glove.integrator.ImplicitIntegrator.run", euler,
        glove.test_a_loaded_plate_on_the_palm_has_the_forces_of_its_closed_form, (),
    ),
    "a layer without the object's stiffness": (
        "tactile_viewgcn.glove.contact.Layer.series", lambda self, stiffness: np.full(len(stiffness), self.stiffness),
        glove.test_a_loaded_plate_on_the_palm_has_the_forces_of_its_closed_form, (),
    ),
    "a Newton iteration that ends too early": (
        "tactile_viewgcn.glove.newton.StageSolver.iterate", end_at_once(newton.StageSolver.iterate),
        glove.test_where_the_drive_stands_still_energy_only_falls, (glove.GRASPS[4],),
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_turns_a_row_wrong(monkeypatch, tmp_path, fault):
    target, faulty, test, arguments = FAULTS[fault]
    monkeypatch.setattr(target, faulty)
    fixtures = {"row": Rows(), "tmp_path": tmp_path, "monkeypatch": monkeypatch}
    names = list(signature(test).parameters)
    given = {name: fixtures[name] for name in names if name in fixtures}
    with pytest.raises((AssertionError, GradcheckError)):
        test(**given, **dict(zip([name for name in names if name not in fixtures], arguments, strict=True)))
