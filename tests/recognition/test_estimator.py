"""scikit-learn's interface: the pipeline's own training, answers of the right form, and files that others read."""

import numpy as np
from sklearn.model_selection import GroupKFold, cross_val_score
from sklearn.utils.estimator_checks import parametrize_with_checks

from tactile_viewgcn import TactileClassifier

NETWORK = {"pretrain.epochs": 2, "finetune.epochs": 1, "model.backbone.width": 4, "model.backbone.blocks": 1}
SMALL = {"cluster.restarts": 1, "preprocess.balance_minimum": 4}
CENTRED = "its data are centred on 0, and readings below the baseline are no contact; passes with preprocess.zero -3"


@parametrize_with_checks(
    [TactileClassifier(), TactileClassifier(system="logistic", params={"preprocess.zero": -3})],
    expected_failed_checks=lambda given: {} if given.params else {"check_classifiers_train": CENTRED},
)
def test_scikit_learn_s_own_checks(estimator, check):
    check(estimator)


def grasps(per_object: int = 6, *, frames: int = 24, objects: int = 3, seed: int = 0):
    """Recordings (T, 8, 6) of raw counts, of slightly different lengths, labels, and numbers within an object.

    The first third of a recording is an open hand at 500 counts. Each object then presses its own two rows.
    """
    rng = np.random.default_rng(seed)
    recordings, labels = [], []
    for number in range(per_object):
        for label in range(objects):
            counts = 500 + rng.normal(0, 1, (frames + number, 8, 6))
            counts[frames // 3 :, 2 * label : 2 * label + 2] += rng.uniform(
                20, 60, (frames + number - frames // 3, 2, 6)
            )
            recordings.append(counts.round().astype(np.int16))
            labels.append(("ball", "mug", "pen")[label])
    return recordings, np.array(labels), np.repeat(np.arange(per_object), objects)


RAW = {"preprocess.baseline": "quiet", "preprocess.filter": "contact", "preprocess.contact_sensors": 6}


def made(**changes) -> TactileClassifier:
    return TactileClassifier(views=4, params=SMALL | RAW | changes.pop("params", {}), **changes)


def test_recordings_of_different_lengths_are_told_apart():
    X, y, _ = grasps()
    new, truth, _ = grasps(2, seed=1)
    classifier = made().fit(X, y)
    assert classifier.classes_.tolist() == ["ball", "mug", "pen"]
    assert (classifier.predict(new) == truth).all() and classifier.score(new, truth) == 1
    np.testing.assert_allclose(classifier.predict_proba(new).sum(axis=1), 1, rtol=1e-5)


def test_groups_are_held_out_together_in_cross_validation():
    X, y, number = grasps(4)
    scores = cross_val_score(made(preset="best"), X, y, groups=number, cv=GroupKFold(4))
    assert scores.tolist() == [1, 1, 1, 1]
