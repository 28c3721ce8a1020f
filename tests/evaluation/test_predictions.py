"""The file of all answers."""

import numpy as np
import pytest
import torch

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.evaluation.predictions import predictions_of, read_predictions, write_predictions
from tactile_viewgcn.evaluation.report import metrics_tree
from tactile_viewgcn.tables.frames import TEST, VALIDATION
from tests.small_tables import CPU, recipe, table, trained


@pytest.mark.parametrize(
    ("side", "code", "changes"),
    [("test", TEST, ()), ("validation", VALIDATION, ("split.validation=0.3", "evaluate.side=validation"))],
)
def test_answers_belong_to_the_anchors_of_the_evaluated_side(tmp_path, side, code, changes):
    params, frames = recipe(*changes), table(*changes)
    evaluation = evaluate_table(trained(), frames, params.cluster, params.evaluate, CPU, params.seed, timed=False)
    write_predictions(tmp_path / "predictions.npz", predictions_of(evaluation, frames, side))
    predictions = read_predictions(tmp_path / "predictions.npz")
    anchors = np.flatnonzero(frames.anchor & (frames.side == code))
    assert (predictions.labels == frames.label[anchors]).all()
    assert (predictions.groups == frames.group[anchors]).all()
    assert predictions.recordings.tolist() == [frames.recordings[i] for i in frames.recording[anchors]]
    assert predictions.classes.tolist() == frames.classes
    tree = metrics_tree(evaluation, frames, 4, side)
    assert tree["groups"] == {side: len(np.unique(frames.group[anchors]))}
    for protocol, answers in predictions.predicted.items():
        assert answers.shape == (params.evaluate.trials, len(anchors))
        assert (answers != predictions.labels).mean() == pytest.approx(tree[protocol]["error"]["mean"])
    evaluated = np.flatnonzero((frames.label == 1) & (frames.side == code))
    mean = torch.from_numpy(frames.inputs(evaluated)).mean(dim=0)
    torch.testing.assert_close(torch.from_numpy(predictions.mean_frames[1]), mean)
