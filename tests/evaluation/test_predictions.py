"""The file of all answers."""

import numpy as np
import pytest
from sklearn.metrics import confusion_matrix

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.evaluation.predictions import read_predictions, write_predictions
from tactile_viewgcn.tables.frames import TEST, TRAIN, VALIDATION
from tests.glove_data import CPU, fewer_anchors, recipe, table, trained


@pytest.mark.parametrize(
    ("side", "code", "changes"),
    [("test", TEST, ()), ("validation", VALIDATION, ("split.validation=0.3", "evaluate.side=validation"))],
)
def test_answers_belong_to_the_anchors_of_the_evaluated_side(tmp_path, side, code, changes):
    params, frames = recipe(*changes), fewer_anchors(table(*changes), 5)
    evaluation = evaluate_table(trained(), frames, params, CPU, timed=False)
    write_predictions(tmp_path / "predictions.npz", evaluation.predictions)
    predictions, metrics = read_predictions(tmp_path / "predictions.npz"), evaluation.metrics
    on_side = frames.side == code
    anchors = np.flatnonzero(frames.anchor & on_side)
    assert (predictions.labels == frames.label[anchors]).all()
    assert (predictions.groups == frames.group[anchors]).all()
    assert predictions.recordings.tolist() == [frames.recordings[i] for i in frames.recording[anchors]]
    assert predictions.classes.tolist() == frames.classes
    assert metrics["groups"] == {side: len(np.unique(frames.group[anchors]))}
    assert metrics["frames"] == {"train": (frames.anchor & (frames.side == TRAIN)).sum(), side: len(anchors)}
    for protocol, answers in predictions.predicted.items():
        assert answers.shape == (params.evaluate.trials, len(anchors))
        assert predictions.errors(protocol) == pytest.approx((answers != predictions.labels).mean(axis=1))
        assert predictions.errors(protocol).mean() == pytest.approx(metrics[protocol]["error"]["mean"])
        expected = confusion_matrix(np.tile(predictions.labels, len(answers)), answers.ravel(), labels=range(4))
        np.testing.assert_array_equal(predictions.confusion(protocol), expected)
