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
    points = rng.normal(size=(150, 5)) + labels[:, None] * rng.normal(size=5)
    new = 3 * rng.normal(size=(50, 5))
    points = (points + 1000).astype(np.float32).astype(float)
    new = (new + 1000).astype(np.float32).astype(float)
    # the standard deviation of the last feature is not 0 but rounding
    points[:, -1] = 0.1
    new[:, -1] = 0.1
    return points, labels, new


def ridge(points, labels, new):
    """Return probabilities (n, classes) by scikit-learn's ridge classifier."""
    plain = make_pipeline(StandardScaler(), RidgeClassifierCV(np.logspace(-3, 3, 10)))
    values = plain.fit(points, labels).decision_function(new)
    if values.ndim == 1:
        values = np.stack([-values, values], axis=1)
    return softmax(4 * values, axis=1)


def regression(points, labels, new):
    """Return probabilities (n, classes) by scikit-learn's kernel ridge regression."""
    width = 2 / cdist(points, points, "sqeuclidean").mean()
    plain = kernel_ridge.KernelRidge(alpha=0.3, kernel="rbf", gamma=width)
    plain.fit(points, labels[:, None] == np.unique(labels))
    return softmax(8 * plain.predict(new), axis=1)


def normalised(points, labels, new):
    """Return both sets of points, standardised, squashed and divided by the spread within classes.

    A loop computes feature by feature.
    """

    def squashed(values):
        return np.sign(values - mean) * np.log(1 + abs(values - mean) / spread)

    points = points.copy()
    new = new.copy()
    classes = set(labels)
    for feature in range(points.shape[1]):
        mean = points[:, feature].mean()
        spread = points[:, feature].std() if np.ptp(points[:, feature]) else 1.0
        points[:, feature] = squashed(points[:, feature])
        new[:, feature] = squashed(new[:, feature])
        squares = 0.0
        for label in classes:
            of_class = points[labels == label, feature]
            squares += np.sum((of_class - of_class.mean()) ** 2)
        within = max((squares / (len(labels) - len(classes))) ** 0.5, 0.05)
        points[:, feature] /= within
        new[:, feature] /= within
    return points, new


@pytest.mark.parametrize("classes", [2, 3, 7])
def test_answers_are_those_of_scikit_learn(classes):
    points, labels, new = data(classes)
    trees = ExtraTreesClassifier(20, random_state=0).fit(points, labels)
    for estimator, expected in (
        (Ridge(), ridge(points, labels, new)),
        (KernelRidge(), regression(points, labels, new)),
        (Forest(20), trees.predict_proba(new)),
    ):
        answers = estimator.fit(points, labels, 0).predict_proba(new)
        np.testing.assert_allclose(answers, expected, atol=5e-4)


@pytest.mark.parametrize("classes", [2, 3, 7])
def test_support_vectors_vote_as_those_of_scikit_learn(classes):
    points, labels, new = data(classes)
    for estimator, (plain_points, plain_new) in (
        (SupportVectors(), (points, new)),
        (NormalisedVectors(), normalised(points, labels, new)),
    ):
        logarithms = np.log(estimator.fit(points, labels, 0).predict_proba(new))
        plain = SVC(C=10).fit(plain_points, labels)
        if classes == 2:
            best = estimator.classes[logarithms.argmax(axis=1)]
            np.testing.assert_array_equal(best, plain.predict(plain_new))
        else:
            votes = plain.decision_function(plain_new)
            differences = logarithms - logarithms[:, :1]
            np.testing.assert_allclose(differences, votes - votes[:, :1], atol=5e-3)


def test_what_threads_of_scikit_learn_warn_of_ends_no_fit(monkeypatch):
    fit = ExtraTreesClassifier.fit

    def fit_with_warning(*args):
        warnings.warn("", stacklevel=1)
        return fit(*args)

    monkeypatch.setattr(ExtraTreesClassifier, "fit", fit_with_warning)
    filters = list(warnings.filters)
    points, labels, _ = data(3)
    assert len(Forest(5).fit(points, labels, 0).roots) == 5
    assert list(warnings.filters) == filters


def test_a_value_that_equals_a_threshold_goes_left():
    stump = {
        "roots": np.array([0]),
        "left": np.array([1, 1, 2]),
        "right": np.array([2, 1, 2]),
        "feature": np.array([0, 0, 0]),
        "threshold": np.array([5, 0, 0]),
        "leaf": np.array([0, 0, 1]),
        "classes": np.array([0, 1]),
        "shares": np.eye(2, dtype=np.float32),
    }
    forest = Forest().load_state_dict(stump)
    assert forest.predict_proba(np.array([[4.0], [5], [6]]))[:, 0].tolist() == [1, 1, 0]


@pytest.mark.parametrize("estimator", ALL)
def test_kept_arrays_answer_equally_and_a_class_without_examples_has_probability_0(
    monkeypatch, estimator
):
    points, labels, new = data(3)
    fitted = estimator().fit(points, labels, 0)
    loaded = estimator().load_state_dict(fitted.state_dict())
    answers = probabilities(loaded, new, 6)
    assert (answers == probabilities(fitted, new, 6)).all()
    assert (answers[:, 1::2] == 0).all()
    np.testing.assert_allclose(answers.sum(axis=1), 1, atol=1e-6)
    monkeypatch.setattr(trees, "MOST_PATHS", 100)  # evaluates the trees in parts
    np.testing.assert_allclose(probabilities(fitted, new, 6), answers, rtol=1e-5)


def test_of_many_points_some_are_taken_and_of_every_class_one():
    points = np.arange(300)[:, None]
    labels = np.r_[np.zeros(298, int), 1, 2]
    taken, labels_taken = sampled(points, labels, 0, 30)
    assert 31 <= len(taken) <= 33
    assert len(set(taken.ravel())) == len(taken)
    assert (labels_taken == labels[taken.ravel()]).all()
    assert set(labels_taken) == {0, 1, 2}
    # the sample is random, since points are sorted by recording
    thirds, _ = np.histogram(taken, 3)
    assert thirds.min() > 3
    assert len(KernelRidge(30).fit(points, labels, 0).points) == len(taken)
