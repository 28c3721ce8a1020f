"""Systems without a network: what they answer is what scikit-learn's estimator answers, averaged by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from sklearn.decomposition import PCA
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.linear_model import LogisticRegression
from sklearn.neighbors import KNeighborsClassifier
from sklearn.pipeline import make_pipeline

from tactile_viewgcn.evaluation.evaluate import evaluate_table
from tactile_viewgcn.frames.split import TEST, TRAIN
from tactile_viewgcn.nn.backbone import extract_features
from tactile_viewgcn.nn.network import count_weights
from tactile_viewgcn.recognition.model_file import load_classifier, save_classifier
from tactile_viewgcn.recognition.recogniser import Recogniser
from tactile_viewgcn.sensors.kernel import kernel_estimator
from tactile_viewgcn.sensors.sensor_system import contact_unit
from tactile_viewgcn.systems import system_class
from tactile_viewgcn.systems.classifier import Classifier
from tactile_viewgcn.training.finetuning import finetune_classifier
from tests.small_tables import CPU, recipe, table, views_of

PLAIN = {
    "trees": lambda: ExtraTreesClassifier(500, random_state=0),
    "logistic": lambda: LogisticRegression(max_iter=500),
    "knn": lambda: KNeighborsClassifier(5, metric="cosine"),
    "lda": lambda: make_pipeline(PCA(50, random_state=0), LinearDiscriminantAnalysis()),
    "kernel": lambda: kernel_estimator(table().live),
}


def fitted(name: str) -> Classifier:
    params = recipe(f"model.system={name}")
    return finetune_classifier(table(), views_of(table(), params), {}, params, CPU)[0]


def counts_above(index: np.ndarray) -> np.ndarray:
    """Counts above the baseline of the live sensors, written out."""
    frames = table()
    above = frames.counts[index].astype(np.float32) - frames.baseline_mean[frames.baseline[index]]
    return above[:, frames.live]


def logarithms(index: np.ndarray, name: str) -> np.ndarray:
    """log(1 + x) of the readings in units, for the kernel of those above two units."""
    frames = table()
    train = np.flatnonzero(frames.anchor & (frames.side == TRAIN))
    units = counts_above(index) / np.float32(contact_unit(counts_above(train)))
    return np.log1p(np.maximum(units - (2 if name == "kernel" else 0), 0))


@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
@pytest.mark.parametrize("name", PLAIN)
def test_answers_are_the_plain_estimators_averaged_by_hand(name):
    frames = table()
    assert frames.transform == "clip"  # and yet the estimator sees counts
    train = np.flatnonzero(frames.anchor & (frames.side == TRAIN))
    test = np.flatnonzero(frames.side == TEST)
    probabilities = PLAIN[name]().fit(logarithms(train, name), frames.label[train])
    probabilities = probabilities.predict_proba(logarithms(test, name))
    classifier = fitted(name).eval()
    inputs = CPU.frames(torch.from_numpy(frames.inputs(test, classifier.head.transform)))
    features = extract_features(classifier.backbone, inputs)
    torch.testing.assert_close(features, torch.from_numpy(probabilities).float(), rtol=1e-5, atol=1e-6)
    sets = torch.from_numpy(np.random.default_rng(0).integers(len(test), size=(50, 4)))
    logits, _ = classifier.head(features[sets])
    mean = probabilities.astype(np.float32)[sets.numpy()].mean(axis=1)
    torch.testing.assert_close(logits.softmax(dim=-1), torch.from_numpy(mean), rtol=1e-5, atol=1e-6)
    assert count_weights(classifier) == 0


@pytest.mark.parametrize("name", PLAIN)
def test_the_pipeline_gives_the_same_answers_twice_and_better_than_chance(name):
    params = recipe(f"model.system={name}")
    first, second = (
        evaluate_table(fitted(name), table(), params.cluster, params.evaluate, CPU, params.seed, timed=False)
        for _ in range(2)
    )
    for scope, trials in first.protocols.items():
        assert (trials.predicted == second.protocols[scope].predicted).all()
        assert trials.correct.mean() > 0.5  # of four classes


@pytest.mark.parametrize("name", PLAIN)
def test_the_checkpoint_keeps_estimator_and_transform(tmp_path, name):
    params, frames, classifier = recipe(f"model.system={name}"), table(), fitted(name).eval()
    save_classifier(tmp_path / "classifier.pt", classifier, params.model, frames)
    content = torch.load(tmp_path / "classifier.pt", weights_only=True)
    assert content["transform"] == "counts"
    loaded, _ = load_classifier(tmp_path / "classifier.pt")
    test = np.flatnonzero(frames.side == TEST)[:8]
    inputs = CPU.frames(torch.from_numpy(frames.inputs(test, "counts")))
    assert (loaded.backbone(inputs) == classifier.backbone(inputs)).all()
    # of one session, so that they have one baseline
    session = np.flatnonzero((frames.side == TEST) & (frames.baseline == frames.baseline[test[0]]))[:4]
    recogniser = Recogniser(tmp_path / "classifier.pt")
    baseline = frames.baseline_mean[frames.baseline[session[0]]]
    answers = recogniser.probabilities(frames.counts[session][None].astype(float), baseline)
    mean = classifier.backbone(CPU.frames(torch.from_numpy(frames.inputs(session, "counts")))).mean(dim=0)
    np.testing.assert_allclose(answers[0], mean, rtol=1e-4, atol=1e-6)


def test_a_class_without_training_frames_is_never_answered():
    frames = table()
    label, without = np.where(frames.label == 2, 1, frames.label), recipe("model.system=knn")
    merged = replace(frames, label=label.astype(frames.label.dtype))
    classifier, _ = finetune_classifier(merged, views_of(merged, without), {}, without, CPU)
    test = np.flatnonzero(frames.side == TEST)
    probabilities = classifier.backbone(CPU.frames(torch.from_numpy(frames.inputs(test, "counts"))))
    assert probabilities.shape == (len(test), 4)
    assert (probabilities[:, 2] == 0).all()


@pytest.mark.parametrize("name", PLAIN)
def test_a_system_names_the_library_that_its_file_needs(name):
    assert system_class(name).packages == ("scikit-learn",)


def test_neighbours_are_no_more_than_there_are_training_frames():
    frames, params = table(), recipe("model.system=knn")
    few = replace(frames, anchor=frames.anchor & (np.arange(len(frames)) % 48 == 0))
    classifier, _ = finetune_classifier(few, views_of(frames, params), {}, params, CPU)
    count = int((few.anchor & (few.side == TRAIN)).sum())
    assert 1 < count < 5 and classifier.head.fitted.n_neighbors == count
