"""The classifier on the sensors: what it tells apart, which estimator answers, and what is kept in a file."""

from typing import get_args

import numpy as np
import pytest
import torch

from tactile_viewgcn.params import Member
from tactile_viewgcn.sensors import classifier as classifier_module
from tactile_viewgcn.sensors.classifier import SensorClassifier
from tactile_viewgcn.sensors.examples import FLOOR, FRAME, WHOLE
from tests.sensors.small_recordings import ARRAY, CHANNELS, NAMES, answers, fitted, recording, recordings, values

IN_TIME, KERNELS = ["trees", "svm", "convolutions"], ["kernel", "pooled_kernel"]
NEW = range(100, 105)


@pytest.mark.parametrize("member", get_args(Member))
def test_directions_tremble_and_negative_forces_are_recognised_from_whole_recordings(member):
    """From channels, by members that read the order of time; of an array all tell pushing from pulling."""
    for live, names in ((CHANNELS, NAMES), (ARRAY, NAMES[3:])):
        if live is ARRAY or member in IN_TIME:
            made, labels = recordings(NEW, names, live=live)
            classifier = fitted([member], *recordings(names=names, live=live), live=live)
            assert (answers(classifier, made).argmax(axis=1) == labels).all()


@pytest.mark.parametrize("members", [IN_TIME, KERNELS])
def test_order_counts_in_recordings_alone_and_answers_are_equal_alone_and_among_others(monkeypatch, members):
    classifier, (made, _) = fitted(members, *recordings()), recordings(NEW)
    alone, together = [values(classifier, each) for each in made], values(classifier, np.concatenate(made))
    both = [int(classifier.recording_logits(each).argmax()) for each in (alone[0], alone[0].flip(0))]
    assert both == [0, 1] or members == KERNELS  # up and down; these read no order
    torch.testing.assert_close(together, torch.cat(alone))
    of_recordings = [
        torch.cat([classifier.recording_logits(each) for each in of]) for of in (together.split(32), alone)
    ]
    torch.testing.assert_close(*of_recordings, rtol=1e-5, atol=1e-5)
    sets = torch.arange(4 * len(made)).view(-1, 4)
    whole = classifier.logits(together, sets)
    torch.testing.assert_close(classifier.logits(together, sets.flip(1)), whole)
    monkeypatch.setattr(classifier_module, "MAX_SET_VALUES", 1)
    torch.testing.assert_close(classifier.logits(together, sets), whole, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("live", [CHANNELS, ARRAY])
@pytest.mark.parametrize("members", [IN_TIME, KERNELS, ["trees"], ["convolutions"]])
def test_a_loaded_classifier_gives_equal_answers(members, live):
    first = fitted(members, *recordings(live=live), live=live)
    state, sets, again = first.state_dict(), torch.arange(32).view(8, 4), SensorClassifier(members, first.viewpoints, 5)
    again.load_state_dict(state, live)
    kept, loaded = (values(each, recording("trembling", 100, live=live)) for each in (first, again))
    assert (kept == loaded).all() and (first.logits(kept, sets) == again.logits(loaded, sets)).all()
    assert (first.recording_logits(kept) == again.recording_logits(loaded)).all() and again.shortest == 32
    with pytest.raises(ValueError, match="no estimator of the size"):
        again.load_state_dict(state | {"fitted": {name: {} for name in state["fitted"]}}, live)


def test_fewer_frames_have_the_estimator_of_the_next_smaller_size_and_a_short_recording_is_a_view_set():
    classifier = fitted(["trees", "svm"], *recordings(frames=10))
    assert classifier.fitted["svm"].keys() == {WHOLE, 1, 2, 4} and classifier.takes_fewer
    read = values(classifier, recording("up", 100))
    for frames, size in ((1, 1), (2, 2), (3, 2), (4, 4)):
        points = classifier.representation.points("svm", read[None, :frames].numpy(), whole=False)
        logits = classifier.logits(read, torch.arange(frames)[None])
        np.testing.assert_allclose(logits, np.log(classifier.fitted["svm"][size].predict_proba(points)), rtol=1e-5)
        assert torch.equal(classifier.recording_logits(read[:frames]), logits)
    half = classifier.logits(read, torch.arange(5)[None])  # of the shortest recording
    assert (classifier.recording_logits(read[:5]) != half).any()
    short = fitted(["trees", "svm"], *recordings(frames=2), sizes=(4,))  # as short ones were in the training
    assert (short.recording_logits(read[:2]) != short.logits(read, torch.arange(2)[None])).any()
    assert not short.takes_fewer and short.shortest == 2


def test_members_add_their_logarithms_and_that_of_frames_is_averaged():
    members, frames = [*KERNELS, "svm"], recording("pushed", 100)
    alone, together = [fitted([name], *recordings()) for name in members], fitted(members, *recordings())
    expected = sum(np.log(answers(each, [frames]) + FLOOR) for each in alone)
    np.testing.assert_allclose(together.recording_logits(values(together, frames)), expected, rtol=1e-4)
    by_frame = alone[0].fitted["kernel"][FRAME].predict_proba(alone[0].representation.scaled(frames))
    np.testing.assert_allclose(answers(alone[0], [frames])[0], by_frame.mean(axis=0), rtol=1e-4)


def test_view_sets_stay_in_a_recording_and_take_other_frames_where_there_are_enough():
    made = [recording("up", seed, frames=frames) for seed, frames in enumerate((5, 3, 3000, 5, 2))]
    examples = fitted(["svm"], made, np.arange(5)).examples
    for size, sets in examples.sets.items():
        of = examples.recording_of(size)  # of the third recording 400 frames are taken
        assert (np.searchsorted([5, 8, 408, 413], sets, side="right") == of[:, None]).all()
        assert np.bincount(of).tolist() == [4] * 5 and all(len(set(row)) == size for row in sets[of % 2 == 0][:8])
    frames = np.linspace(0, 2999, 400).astype(int)[examples.sets[1][8:12] - 8]
    expected = examples.representation.points("svm", examples.representation.scaled(made[2])[frames], whole=False)
    np.testing.assert_allclose(examples.points("svm", 1)[8:12], expected)


def test_what_members_read_is_fitted_without_labels_and_an_estimator_to_the_used_recordings():
    made, labels = recordings()
    one, other = (fitted(["convolutions"], made, each).examples for each in (labels, labels[::-1].copy()))
    states = [each.representation.convolutions.state_dict() for each in (one, other)]
    assert all(torch.equal(states[0][name], states[1][name]) for name in states[0])
    used = labels < 2
    shares = one.answers("convolutions", WHOLE, one.fit("convolutions", WHOLE, 0, used), used)
    assert (shares[used].argmax(axis=1) == labels[used]).all()
    assert (shares[used, 2:] == 0).all() and np.isnan(shares[~used]).all()


ALTERED = {
    "dilations": lambda state: state["convolutions"].update(dilations=1000 * state["convolutions"]["dilations"]),
    "no estimator of the size 0": lambda state: state["fitted"]["svm"].pop("0"),
    "no estimator of the size 4": lambda state: state["fitted"]["svm"].pop("4"),
    "classes": lambda state: state["fitted"]["trees"]["0"].update(classes=torch.tensor([4, 3, 2, 1, 0])),
    "spread": lambda state: state["fitted"]["svm"]["0"]["spread"].zero_(),
}


@pytest.mark.parametrize("refusal", ALTERED)
def test_an_altered_state_is_refused(refusal):
    classifier = fitted(["trees", "svm", "convolutions"], *recordings())
    state, other = classifier.state_dict(), SensorClassifier(classifier.members, classifier.viewpoints, 5)
    other.load_state_dict(state, classifier.representation.live)
    ALTERED[refusal](state)
    with pytest.raises(ValueError, match=refusal):
        other.load_state_dict(state, classifier.representation.live)
