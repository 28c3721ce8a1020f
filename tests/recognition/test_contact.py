"""Contact in new recordings of a glove whose noise is cut off at 0."""

import numpy as np
import pytest

from tactile_viewgcn.frames.preprocessing import preprocess_recordings
from tactile_viewgcn.params import load
from tactile_viewgcn.recognition.model_file import FittedPreprocessing
from tactile_viewgcn.recognition.preprocessing import find_contact
from tactile_viewgcn.tables.array_recordings import ArrayRecordings
from tests.glove_data import FILE

NOISE, WEAK, HELD = 20.0, 7.0, np.arange(90) // 15 % 2 == 1  # counts; standard deviations; frames of three grasps


def table(seeds, *, empty):
    """Recordings of 6 x 8 sensors at 0, of which ten are pressed by seven standard deviations of noise."""
    arrays, labels = [], []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        counts = rng.normal(0, NOISE, (len(HELD), 48))
        if seed or not empty:
            counts[:, 10 * (seed % 2) : 10 * (seed % 2) + 10] += WEAK * NOISE * HELD[:, None]
        arrays.append(np.maximum(np.rint(counts), 0).astype(np.int16).reshape(-1, 6, 8))
        labels.append(0 if empty and not seed else 1 + seed % 2)
    return ArrayRecordings(arrays, ["empty_hand", "cup", "pen"], np.array(labels), np.zeros(len(arrays), dtype=int))


@pytest.mark.parametrize("baseline", ["grasp", "empty_hand"])
def test_noise_that_is_cut_off_is_corrected_once(baseline):
    fixed = "filter=contact", "contact_sensors=5", "empty_hand_class=false"
    changes = [f"preprocess.{change}" for change in (f"baseline={baseline}", *fixed)]
    params, training = load(FILE, ("split.by=recording", *changes)), table(range(7), empty=True)
    made = preprocess_recordings(training, params.preprocess, params.split)
    noise = made.frames.noise[training.live]
    np.testing.assert_allclose(np.median(noise), NOISE, rtol=0.25)
    fitted = FittedPreprocessing.of(made.frames)
    new = table([8, 9], empty=False)
    estimate, contact = find_contact(fitted, new)
    np.testing.assert_allclose(np.median(estimate.noise[estimate.of_frame]), NOISE, rtol=0.25)
    np.testing.assert_array_equal(contact, np.tile(HELD, 2))
