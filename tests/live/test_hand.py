"""The hand in a stream waits, is ready or holds, in frames whose state is known."""

from dataclasses import replace

import numpy as np
import pytest

from tactile_viewgcn.frames.apply import apply
from tactile_viewgcn.frames.moments import MIN_FRAMES
from tactile_viewgcn.live.hand import OPEN_FRAMES, hand_of
from tactile_viewgcn.params import CONTACT_SIGMAS
from tests.glove_data import SHAPE, empty_hand, of_arrays, pressed, recogniser, recording

SENSORS = 6  # fewest in a frame of contact, of the classifiers of these tests


def plan_of(*, shows_open_hand=True, kept_share=0.5, **settings):
    """Return the plan of the three objects' classifier, with other settings."""
    plan = recogniser().plan
    params = replace(plan.params, **settings)
    return replace(plan, params=params, shows_open_hand=shows_open_hand, kept_share=kept_share)


def followed(plan, frames, **options):
    """Return the state after each frame, which frames are in contact, and the hand.

    The states are a text, of the first letter of each state.
    """
    hand = hand_of(plan, frames[0], **options)
    states = ""
    in_contact = np.zeros(len(frames), dtype=bool)
    for index, counts in enumerate(frames):
        found = hand.follow(counts)
        states += hand.state[0]
        in_contact[index + 1 - len(found) : index + 1] = True
    return states, in_contact, hand


def test_a_hand_waits_for_five_open_frames_and_a_grasp_ends_with_the_fifth_after_it():
    frames = recording("pen", 80, before=12, held=7, after=9)
    states, in_contact, _ = followed(plan_of(), frames)
    assert states == 4 * "w" + 8 * "r" + (7 + 4) * "c" + 5 * "r"
    np.testing.assert_array_equal(np.flatnonzero(in_contact), np.arange(12, 19))


@pytest.mark.parametrize("name", ["ball", "cup", "pen"])
@pytest.mark.parametrize("baseline", ["empty_hand", "grasp"])
def test_contact_and_baseline_are_those_of_apply_where_the_hand_opens_first(name, baseline):
    """With `grasp` the numbers are equal; `empty_hand` also averages frames after the grasp."""
    plan = plan_of(baseline=baseline)
    frames = recording(name, 81)
    _, in_contact, hand = followed(plan, frames[:45])
    table = of_arrays([frames], ["pen"], np.zeros(1, int), np.zeros(1, int))
    estimate, expected = apply(plan, table, new=True)
    np.testing.assert_array_equal(in_contact, expected[:45])
    mean = estimate.mean[estimate.of_frame[40]]
    if baseline == "grasp":
        np.testing.assert_array_equal(hand.mean, mean)
    np.testing.assert_allclose(hand.mean, mean, atol=1)


def test_frames_of_a_closing_hand_are_in_contact_if_the_mean_of_the_open_hand_says_so():
    """All sensors of an object are pressed weakly, and the baseline partly follows them."""
    frames = recording("pen", 82, before=40, held=6, after=0)
    mean = frames[:38].mean(axis=0)
    threshold = CONTACT_SIGMAS * recogniser().plan.noise
    weak = np.where(pressed("pen"), np.ceil(mean + 1.05 * threshold), np.rint(mean))
    frames[38:40] = weak.astype(np.int16)
    _, in_contact, hand = followed(plan_of(), frames)
    assert in_contact[38:].all() and not in_contact[:38].any()
    assert np.abs(hand.mean - mean).max() < 0.5


def test_an_object_that_is_held_from_the_first_frame_is_no_open_hand_unless_one_says_so():
    frames = recording("pen", 83, before=0, held=20, after=20)
    states, in_contact, _ = followed(plan_of(), frames)
    assert states[:24] == 24 * "w"
    assert states[24:] == 16 * "r"
    assert not in_contact.any()
    # a real grip varies by more than noise, but five frames of a rigid grip are taken as open
    assert followed(plan_of(), frames, tare=True)[0] == states
    rigid = np.repeat(frames[5:6], 20, axis=0)
    assert followed(plan_of(), rigid)[0] == 20 * "w"
    assert followed(plan_of(), rigid, tare=True)[0] == 4 * "w" + 16 * "r"


def test_the_first_open_hand_of_a_stream_may_drift_and_the_next_is_compared_with_it():
    """Ten sensors read 12 counts more than in training, where a sensor drifts by 5 counts."""
    plan = replace(plan_of(), drift=5.0)
    frames = recording("pen", 97, before=12, held=20, after=0)
    frames.reshape(len(frames), -1)[:, :10] += 12
    assert followed(plan_of(), frames[:12])[0] == 12 * "w"
    states, _, hand = followed(plan, frames[:12])
    assert states == 4 * "w" + 8 * "r"
    hand.begin_anew()
    weak = frames[:12].copy()
    weak.reshape(len(weak), -1)[:, -10:] += 12  # now a light grip that is held still
    for counts in weak:
        hand.follow(counts)
    assert hand.state == "waiting"


def test_a_hand_that_was_not_open_where_the_baseline_began_is_looked_for_anew():
    rng = np.random.default_rng(0)
    held = recording("pen", 84, before=0, held=1, after=0)
    rigid = np.repeat(held, 10, axis=0) + np.rint(rng.normal(0, 1, (10, *SHAPE))).astype(np.int16)
    frames = np.concatenate([rigid, recording("cup", 85, before=20, held=8, after=8)])
    states, in_contact, _ = followed(plan_of(), frames, tare=True)
    assert states == 4 * "w" + 10 * "r" + 5 * "w" + 11 * "r" + 12 * "c" + 4 * "r"
    np.testing.assert_array_equal(np.flatnonzero(in_contact), np.arange(30, 38))


def test_the_baseline_follows_an_open_hand_that_drifts():
    """The sensors drift by twelve counts in 1,200 frames, more than twice the threshold of five."""
    drift = np.rint(np.linspace(0, 12, 1240))[:, None, None].astype(np.int16)
    frames = recording("pen", 86, before=1200, held=20, after=20) + drift
    states, in_contact, hand = followed(plan_of(), frames[:1210])
    assert states == 4 * "w" + 1196 * "r" + 10 * "c"
    np.testing.assert_array_equal(np.flatnonzero(in_contact), np.arange(1200, 1210))
    expected = frames[1198 - OPEN_FRAMES : 1198].mean(axis=0)
    np.testing.assert_allclose(hand.mean, expected, atol=0.5)


def test_sensors_that_jump_by_less_than_contact_are_a_new_baseline_after_fifty_frames():
    frames = recording("pen", 95, before=100, held=6, after=0)
    frames[12:] += 3
    plan = replace(plan_of(), noise=np.full(SHAPE, 1.15))
    states, in_contact, hand = followed(plan, frames)
    assert states == 4 * "w" + (8 + 49) * "r" + 5 * "w" + 34 * "r" + 6 * "c"
    np.testing.assert_array_equal(np.flatnonzero(in_contact), np.arange(100, 106))
    np.testing.assert_allclose(hand.mean, frames[61:98].mean(axis=0), atol=0.5)


def test_after_a_grasp_that_is_closed_early_the_hand_waits_until_it_is_open():
    frames = recording("pen", 87, before=12, held=30, after=9)
    hand = hand_of(plan_of(), frames[0])
    states = ""
    for index, counts in enumerate(frames):
        hand.follow(counts)
        if index == 20:
            hand.let_go()
        states += hand.state[0]
    assert states == 4 * "w" + 8 * "r" + 8 * "c" + (22 + 4) * "w" + 5 * "r"


def test_begun_anew_a_hand_that_goes_on_holding_is_not_open():
    """The hand holds so steadily that its frames read alike."""
    frames = np.repeat(recording("pen", 88, before=0, held=1, after=0), 30, axis=0)
    frames = np.concatenate([recording("pen", 88, before=12, held=5, after=0), frames])
    hand = hand_of(plan_of(), frames[0])
    for index, counts in enumerate(frames):
        hand.follow(counts)
        if index == 16:
            assert hand.state == "contact"
            hand.begin_anew()
    assert hand.state == "waiting"
    for counts in empty_hand(89)[:MIN_FRAMES]:
        hand.follow(counts)
    assert hand.state == "ready"


def test_a_hand_that_is_neither_in_contact_nor_open_for_long_ends_its_grasp():
    """Such a glove goes on reading a little after the hand has let go."""
    frames = recording("pen", 90, before=12, held=8, after=80)
    frames[20:, pressed("pen")] += 4
    plan = replace(plan_of(), noise=np.full(SHAPE, 1.15))  # contact from 5.75 counts on
    states, in_contact, _ = followed(plan, frames)
    assert states[12:70] == (8 + 49) * "c" + "w" and in_contact.sum() == 8


def test_without_an_open_hand_in_the_training_the_training_s_baseline_is_taken():
    plan = plan_of(shows_open_hand=False)
    frames = recording("pen", 91, before=3, held=7, after=9)
    states, in_contact, hand = followed(plan, frames)
    assert states == 3 * "r" + (7 + 4) * "c" + 5 * "r" and in_contact.sum() == 7
    np.testing.assert_array_equal(hand.mean, plan.mean_baseline())
    hand = hand_of(plan, frames[0])
    states = ""
    for index, counts in enumerate(frames):
        hand.follow(counts)
        if index == 5:
            hand.let_go()
        states += hand.state[0]
    assert states == 3 * "r" + 2 * "c" + (5 + 4) * "w" + 5 * "r"


@pytest.mark.parametrize(
    ("settings", "states"),
    [
        ({"filter": "none", "baseline": "none"}, 20 * "c"),
        ({"filter": "flags", "baseline": "none", "kept_share": 0.995}, 20 * "c"),
        ({"filter": "none", "baseline": "grasp", "shows_open_hand": False}, 20 * "c"),
        ({"filter": "none", "baseline": "grasp"}, 4 * "w" + 16 * "c"),
    ],
)
def test_where_every_frame_counts_nothing_but_an_open_hand_at_first_is_waited_for(settings, states):
    plan = plan_of(zero=123.0, **settings)
    frames = recording("pen", 92, before=8, held=6, after=6)
    found, in_contact, hand = followed(plan, frames)
    assert found == states and in_contact.all()
    expected = plan.mean_baseline()
    if plan.params.baseline == "none":
        expected = np.full(SHAPE, 123.0)
    elif plan.shows_open_hand:
        expected = frames[:5].mean(axis=0)
    np.testing.assert_allclose(hand.mean, expected, rtol=1e-6)


def test_without_the_training_s_noise_the_first_frames_show_it():
    """The plan has no baseline, and its filter was the flags of the source."""
    plan = plan_of(baseline="none", filter="flags", zero=7.0)
    plan = replace(plan, noise=np.full(SHAPE, np.nan))
    frames = recording("pen", 93, before=40, held=9, after=8)
    states, in_contact, hand = followed(plan, frames)
    assert states == 31 * "w" + 9 * "r" + (9 + 4) * "c" + 4 * "r"
    np.testing.assert_array_equal(np.flatnonzero(in_contact), np.arange(40, 49))
    assert (hand.mean == 7).all()


def test_cells_without_a_sensor_read_the_same_as_in_the_stream_s_first_frame():
    plan = recogniser().plan
    live = plan.live.copy()
    live[0, :3] = False
    plan = replace(plan, live=live)
    frames = recording("pen", 94, before=12, held=5, after=0)
    frames[:, 0, :3] = 77
    _, _, hand = followed(plan, frames)
    assert (hand.mean[0, :3] == 77).all()
