"""The trained recogniser: probabilities of raw counts, baselines, refusals."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import softmax

from tactile_viewgcn.messages import UserError
from tactile_viewgcn.recognition import recogniser as module
from tactile_viewgcn.recognition.model_file import save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.systems.classifier import build_classifier
from tactile_viewgcn.tables.frames import TEST
from tactile_viewgcn.views.viewpoints import viewpoints
from tests.glove_data import CPU, recipe, table, trained


@pytest.fixture
def saved(tmp_path):
    """The trained classifier's file."""
    path = tmp_path / "classifier.pt"
    save_classifier(path, trained(), recipe().model, table())
    return path


def some_sets(count=12):
    """View sets (count, 4) of indices into the table, of any test frames."""
    return np.random.default_rng(0).choice(table().on(TEST), (count, 4))


def pipeline_logits(classifier, frames, sets):
    """Logits (A, classes) of view sets of indices into the table, as evaluation has them."""
    classifier.prepare(CPU)
    values = classifier.frame_values(frames.inputs(sets.ravel()))
    return classifier.view_sets(values, np.arange(sets.size).reshape(sets.shape))


def test_many_view_sets_are_classified_a_few_at_a_time(saved, monkeypatch):
    counts, recogniser = table().counts[some_sets()], Recogniser(saved)
    whole = recogniser.probabilities(counts)
    monkeypatch.setattr(module, "MOST_FRAMES", 20)  # five view sets
    sizes, values = [], recogniser._values
    monkeypatch.setattr(recogniser, "_values", lambda part, base: sizes.append(len(part)) or values(part, base))
    np.testing.assert_allclose(recogniser.probabilities(counts), whole, rtol=1e-5)
    assert sizes == [5, 5, 2]


def test_an_offset_of_a_billion_costs_no_digits_of_the_excess(tmp_path):
    frames = replace(table(), counts=table().counts[np.arange(len(table()))].astype(np.int32))
    save_classifier(tmp_path / "c.pt", trained(), recipe().model, frames)
    recogniser = Recogniser(tmp_path / "c.pt")
    counts, baseline = frames.counts[some_sets()], np.rint(recogniser.baseline("000")).astype(np.int32)
    moved = recogniser.probabilities(counts + 10**9, baseline + 10**9)
    np.testing.assert_array_equal(moved, recogniser.probabilities(counts, baseline))


def test_a_session_with_many_baselines_has_their_mean(tmp_path):
    means = np.broadcast_to(np.array([514, 510, 520, 700], np.float32)[:, None, None], (4, 12, 12)).copy()
    number = np.arange(len(table())) % 3  # two grasps in session one, one in session two; the fourth has no frames
    many = replace(table(), session=(number == 2).astype(int), sessions=["one", "two", "none"], baseline=number)
    save_classifier(tmp_path / "c.pt", trained(), recipe().model, replace(many, baseline_mean=means))
    recogniser = Recogniser(tmp_path / "c.pt")
    assert (recogniser.baseline("one") == 512).all() and (recogniser.baseline("two") == 520).all()
    assert (recogniser.baseline() == 516).all()  # the session without frames does not count


@pytest.mark.parametrize("shape", [(4, 12, 12), (2, 3, 12, 12), (2, 4, 12, 13), (2, 4, 12, 12, 1)])
def test_counts_of_a_different_shape_are_refused_and_no_counts_have_no_probabilities(saved, shape):
    with pytest.raises(UserError, match="counts") as error:
        Recogniser(saved).probabilities(np.zeros(shape))
    assert str(shape) in str(error.value) and "(any, 4, 12, 12)" in str(error.value)
    assert Recogniser(saved).probabilities(np.zeros((0, 4, 12, 12))).shape == (0, 4)


@pytest.mark.parametrize(
    ("baseline", "message"),
    [
        (np.zeros(12), r"baseline.*\(12,\).*\(12, 12\)"),
        (np.full((12, 12), np.nan), "baseline holds nan"),
        ("monday", "baseline is 'monday'"),
    ],
)
def test_wrong_baselines_are_refused(saved, baseline, message):
    with pytest.raises(UserError, match=message):
        Recogniser(saved).probabilities(np.zeros((1, 4, 12, 12)), baseline)
    with pytest.raises(UserError, match=r"'monday'.*000"):
        Recogniser(saved).baseline("monday")


@pytest.mark.parametrize("system", ["view_gcn", "stag", "cnn_lstm", "conv_lstm", "gvcnn"])
@pytest.mark.parametrize("transform", ["clip", "log"])
def test_a_saved_system_has_the_same_probabilities_as_in_the_evaluation(tmp_path, system, transform):
    torch.manual_seed(0)
    params, frames = recipe(f"model.system={system}", "model.backbone.width=8"), replace(table(), transform=transform)
    classifier = build_classifier(torch.from_numpy(viewpoints(4)), 4, params.model, (12, 12)).eval()
    save_classifier(tmp_path / "classifier.pt", classifier, params.model, frames)
    sets = some_sets(5)
    expected = softmax(pipeline_logits(classifier, frames, np.sort(sets, axis=1)), axis=1)
    recogniser = Recogniser(tmp_path / "classifier.pt")
    baseline = frames.baseline_mean[frames.baseline[sets[0, 0]]]
    probabilities = recogniser.probabilities(frames.counts[np.sort(sets, axis=1)], baseline)
    np.testing.assert_allclose(probabilities, expected, atol=1e-5)
