"""The clusters of a whole table: which frames get one, and at which viewpoint."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION
from tactile_viewgcn.tables.views import NO_CLUSTER
from tests.small_tables import recipe, table, views_of

VALIDATED = "split.validation=0.25"


def clusters_of(views, frames):
    """For every pool that was clustered, its frames and their clusters."""
    for number in np.unique(views.pool[frames.side != TEST]):
        index = np.flatnonzero(views.pool == number)
        yield index, views.cluster[index]


@pytest.mark.parametrize("assignment", ["area", "matched"])
def test_an_assignment_renumbers_the_clusters_and_changes_nothing_else(assignment):
    frames = table(VALIDATED)
    plain, views = (views_of(frames, recipe(f"cluster.assignment={kind}")) for kind in ("index", assignment))
    np.testing.assert_array_equal(views.pool, plain.pool)
    assert (views.cluster[frames.side == TEST] == NO_CLUSTER).all()
    assert views.cluster.dtype == plain.cluster.dtype
    assert (views.cluster != plain.cluster).any()
    for index, cluster in clusters_of(views, frames):
        before = plain.cluster[index]
        np.testing.assert_array_equal(cluster[:, None] == cluster, before[:, None] == before)
        assert set(cluster.tolist()) <= set(range(4))


def test_clusters_assigned_by_area_have_more_and_more_sensors_in_contact():
    frames, views = table(VALIDATED), views_of(table(VALIDATED), recipe("cluster.assignment=area"))
    area = ((frames.inputs(np.arange(len(frames))) > 5 / 150) & frames.live).sum(axis=(1, 2))
    for index, cluster in clusters_of(views, frames):
        means_of_area = [area[index][cluster == number].mean() for number in np.unique(cluster)]
        assert means_of_area == sorted(means_of_area)
    assert views.references.shape == (4, frames.live.sum()) and not views.references.any()


def unit(values):
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


def test_matched_clusters_of_every_pool_are_assigned_with_the_highest_sum_of_cosines():
    frames, views = table(VALIDATED), views_of(table(VALIDATED), recipe("cluster.assignment=matched"))
    assert views.references.shape == (4, frames.live.sum())
    np.testing.assert_allclose(np.linalg.norm(views.references, axis=1), 1)
    points, sides, means = frames.inputs(np.arange(len(frames)))[:, frames.live].astype(float), set(), []
    for index, cluster in clusters_of(views, frames):
        mean = unit(np.stack([points[index][cluster == number].mean(axis=0) for number in range(4)]))
        cosines = mean @ views.references.T
        best = max(sum(cosines[np.arange(4), order]) for order in permutations(range(4)))
        assert np.trace(cosines) == pytest.approx(best)
        sides |= set(frames.side[index].tolist())
        means += [mean] if (frames.side[index] == TRAIN).all() else []
    assert sides == {TRAIN, VALIDATION}
    np.testing.assert_allclose(views.references, unit(np.mean(means, axis=0)))


def test_references_come_from_the_training_side_alone():
    frames, params = table(VALIDATED), recipe("cluster.assignment=matched")
    train = frames.side == TRAIN
    counts, label = frames.counts.copy(), frames.label.copy()
    counts[~train] = np.random.default_rng(0).permutation(counts[~train])
    label[frames.side == TEST] = 0
    views, other = (views_of(given, params) for given in (frames, replace(frames, counts=counts, label=label)))
    assert views.references.any()
    np.testing.assert_array_equal(other.references, views.references)
    np.testing.assert_array_equal(other.cluster[train], views.cluster[train])


@pytest.mark.parametrize("changes", [(), ("cluster.assignment=anchor",), ("cluster.method=none",)])
def test_without_matching_there_are_no_references(changes):
    views = views_of(table(), recipe(*changes))
    assert views.references.shape == (4, table().live.sum()) and not views.references.any()
