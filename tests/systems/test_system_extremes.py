"""Every system with one view, and with more views than frames."""

import numpy as np
import pytest

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.training.finetuning import finetune_classifier
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, views_of
from tests.systems.small_systems import NARROW, NETWORKS


@pytest.mark.parametrize("views", [1, 40])
@pytest.mark.parametrize(
    ("name", "reuse", "readout"),
    [
        *((name, 1, "average") for name in NETWORKS),
        ("gvcnn", 4, "grid"),
        ("conv_lstm", 4, "grid"),
    ],
)
def test_it_trains_and_evaluates_with_one_view_and_with_more_views_than_frames(
    name, reuse, readout, views
):
    """Features are reused or not; on maps they have another shape, and need no readout."""
    backbone = (NARROW, f"model.backbone.readout={readout}")
    params = recipe(
        *backbone,
        f"model.system={name}",
        f"finetune.feature_reuse={reuse}",
        f"views={views}",
        "evaluate.trials=1",
    )
    frames = fewer_anchors(table(), 12)
    classifier, progress = finetune_classifier(
        frames, views_of(frames, params), pretrained(*backbone), params, CPU
    )
    if classifier.head.trainable:
        assert np.isfinite(progress.curves["loss"]).all()
    else:
        assert not progress.curves
    logits = []
    classifier.head.register_forward_hook(lambda _, __, output: logits.append(output[0]))
    evaluate_table(classifier, frames, params, CPU, temperature=None)
    assert len(logits) >= 3  # for both protocols, for whole recordings, and for fewer views
    for of_batch in logits:
        assert of_batch.shape[1] == 4
        assert of_batch.isfinite().all()
