"""Estimators give the same answers as scikit-learn's estimators on the same points."""

import warnings

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.special import softmax
from sklearn import kernel_ridge
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.linear_model import RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from tactile_viewgcn.members import trees
from tactile_viewgcn.members.convolutions import Ridge
from tactile_viewgcn.members.estimators import probabilities, sampled
from tactile_viewgcn.members.kernels import KernelRidge
from tactile_viewgcn.members.svm import NormalisedVectors, SupportVectors
from tactile_viewgcn.members.trees import Forest

ALL = [Ridge, NormalisedVectors, SupportVectors, KernelRidge, lambda: Forest(20)]


def data(classes):
    """Return 150 points far from 0, their labels, and 50 points to answer.

    The labels are 0, 2, 4 and so on, and 0 is the most frequent. The last feature is constant.
    """
    rng = np.random.default_rng(0)
    labels = 2 * rng.permutation(np.maximum(np.arange(150) % (classes + 2) - 2, 0))
    points, asked = (
        rng.normal(size=(150, 5)) + labels[:, None] * rng.normal(size=5),
        3 * rng.normal(size=(50, 5)),
    )
    points, asked = ((each + 1000).astype(np.float32).astype(float) for each in (points, asked))
    points[:, -1] = asked[:, -1] = 0.1  # its standard deviation is not 0 but rounding
    return points, labels, asked


def ridge(points, labels, asked):
    plain = make_pipeline(StandardScaler(), RidgeClassifierCV(np.logspace(-3, 3, 10)))
    values = plain.fit(points, labels).decision_function(asked)
    return softmax(4 * (values if values.ndim > 1 else np.stack([-values, values], axis=1)), axis=1)


def regression(points, labels, asked):
    width = 2 / cdist(points, points, "sqeuclidean").mean()
    plain = kernel_ridge.KernelRidge(alpha=0.3, kernel="rbf", gamma=width)
    return softmax(
        8 * plain.fit(points, labels[:, None] == np.unique(labels)).predict(asked), axis=1
    )


def normalised(points, labels, asked):
    """Return points that a loop over features standardised, squashed and divided by `within`."""
    columns = []
    for column, of_asked in zip(points.T, asked.T, strict=True):
        mean, spread = column.mean(), column.std() if np.ptp(column) else 1.0
        both = [np.sign(x - mean) * np.log(1 + abs(x - mean) / spread) for x in (column, of_asked)]
        squares = sum(
            ((of_class := both[0][labels == each]) - of_class.mean()) @ of_class
            for each in set(labels)
        )
        within = max((squares / (len(labels) - len(set(labels)))) ** 0.5, 0.05)
        columns.append([each / within for each in both])
    return (np.stack(each, axis=1) for each in zip(*columns, strict=True))


@pytest.mark.parametrize("classes", [2, 3, 7])
def test_answers_are_those_of_scikit_learn(classes):
    points, labels, asked = data(classes)
    expected = [ridge(points, labels, asked), regression(points, labels, asked)]
    expected.append(
        ExtraTreesClassifier(20, random_state=0).fit(points, labels).predict_proba(asked)
    )
    for estimator, shares in zip((Ridge, KernelRidge, ALL[-1]), expected, strict=True):
        np.testing.assert_allclose(
            estimator().fit(points, labels, 0).predict_proba(asked), shares, atol=5e-4
        )
    for estimator, (read, new) in (
        (SupportVectors, (points, asked)),
        (NormalisedVectors, normalised(*data(classes))),
    ):
        machines, plain = estimator().fit(points, labels, 0), SVC(C=10).fit(read, labels)
        logarithms, votes = np.log(machines.predict_proba(asked)), plain.decision_function(new)
        if classes == 2:
            assert (machines.classes[logarithms.argmax(axis=1)] == plain.predict(new)).all()
        else:
            np.testing.assert_allclose(
                logarithms - logarithms[:, :1], votes - votes[:, :1], atol=5e-3
            )


def test_what_threads_of_scikit_learn_warn_of_ends_no_fit(monkeypatch):
    grow, before = ExtraTreesClassifier.fit, list(warnings.filters)
    monkeypatch.setattr(
        ExtraTreesClassifier, "fit", lambda *args: warnings.warn("", stacklevel=1) or grow(*args)
    )
    assert len(Forest(5).fit(*data(3)[:2], 0).roots) == 5 and list(warnings.filters) == before


def test_a_value_that_equals_a_threshold_goes_left():
    stump = {
        "roots": [0],
        "left": [1, 1, 2],
        "right": [2, 1, 2],
        "feature": [0, 0, 0],
        "threshold": [5, 0, 0],
    }
    arrays = {
        name: np.array(each)
        for name, each in (stump | {"leaf": [0, 0, 1], "classes": [0, 1]}).items()
    }
    forest = Forest().load_state_dict(arrays | {"shares": np.eye(2, dtype=np.float32)})
    assert forest.predict_proba(np.array([[4.0], [5], [6]]))[:, 0].tolist() == [1, 1, 0]


@pytest.mark.parametrize("estimator", ALL)
def test_kept_arrays_answer_equally_and_a_class_without_examples_has_probability_0(
    monkeypatch, estimator
):
    points, labels, asked = data(3)
    fitted = estimator().fit(points, labels, 0)
    answers = probabilities(estimator().load_state_dict(fitted.state_dict()), asked, 6)
    assert (answers == probabilities(fitted, asked, 6)).all() and (answers[:, 1::2] == 0).all()
    np.testing.assert_allclose(answers.sum(axis=1), 1, atol=1e-6)
    monkeypatch.setattr(trees, "MOST_PATHS", 100)  # evaluates the trees in parts
    np.testing.assert_allclose(probabilities(fitted, asked, 6), answers, rtol=1e-5)


def test_of_many_points_some_are_taken_and_of_every_class_one():
    points, labels = np.arange(300)[:, None], np.r_[np.zeros(298, int), 1, 2]
    taken, of = sampled(points, labels, 0, 30)
    assert 31 <= len(set(taken.ravel())) == len(taken) <= 33 and (of == labels[taken.ravel()]).all()
    # the sample is random, since points are sorted by recording
    assert np.histogram(taken, 3)[0].min() > 3
    assert set(of) == {0, 1, 2} and len(KernelRidge(30).fit(points, labels, 0).points) == len(taken)
