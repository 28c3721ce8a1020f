"""The clusters of a whole table: which frames get one, and what they may depend on."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.tables.frames import TEST, TRAIN
from tactile_viewgcn.tables.views import NO_CLUSTER
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import recipe, table, views_of

VALIDATED = "split.validation=0.25"


def test_training_and_validation_frames_get_a_cluster_and_test_frames_none():
    frames, views = table(VALIDATED), views_of(table(VALIDATED), recipe())
    assert (views.cluster[frames.side == TEST] == NO_CLUSTER).all()
    for number in np.unique(views.pool[frames.side != TEST]):
        assert set(views.cluster[views.pool == number].tolist()) == set(range(4))


@pytest.mark.parametrize("scope", ["object", "recording"])
def test_pools_are_of_the_scope_and_the_viewpoints_are_kept(scope):
    frames, params = table(), recipe(f"cluster.scope={scope}")
    views = views_of(frames, params)
    of_pool = frames.label if scope == "object" else frames.recording
    cells = np.unique(np.stack([views.pool, frames.side, of_pool]), axis=1).T
    assert len(cells) == len(np.unique(cells[:, 0])) == len(np.unique(cells[:, 1:], axis=0))
    np.testing.assert_array_equal(views.viewpoints, viewpoints(params.views, params.viewpoints, params.seed))
    assert views.cluster.dtype == np.int16


def test_clusters_of_the_training_side_depend_on_no_other_side():
    frames = table(VALIDATED)
    train, counts, label = frames.side == TRAIN, frames.counts[:].copy(), frames.label.copy()
    counts[~train] = np.random.default_rng(0).permutation(counts[~train])
    label[frames.side == TEST] = 0
    views, other = (views_of(each, recipe()) for each in (frames, replace(frames, counts=counts, label=label)))
    np.testing.assert_array_equal(other.cluster[train], views.cluster[train])
