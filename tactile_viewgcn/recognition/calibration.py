"""Temperature scaling: calibrated probabilities, fitted on groups that were left out of the training.

Guo et al., "On calibration of modern neural networks" (arXiv 1706.04599). There is a temperature for each number of
frames, and for each number of recordings of one object that are answered together.
"""

import numpy as np
import torch
from torch import Tensor

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import Note
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recognition.sequential import MOST_RECORDINGS, Calibration, logits_by_count, sequences
from tactile_viewgcn.tables.frames import VALIDATION, Frames
from tactile_viewgcn.training.inputs import FrameInputs
from tactile_viewgcn.views.sampling import spread_frames

DRAWS = 10  # sets of recordings that are answered together, for each recording; view sets around each anchor, at most
MOST_SETS = 1000  # view sets that are answered
MIN_TEMPERATURE, MAX_TEMPERATURE = 0.02, 50.0


def fit_temperature(logits: Tensor, labels: Tensor, recordings: int) -> float:
    """Temperature whose softmax(logits / temperature) fits labels (n,) best, logits (n, Y), at least two classes.

    As in Platt (1999, section 2.2), a label counts as right with the probability that Laplace's rule gives for as many
    right answers as there are recordings, (recordings + 1) / (recordings + 2). So the confidence stays below 1 where
    every answer is right.
    """
    from scipy.optimize import minimize_scalar

    logits = logits.double()
    doubt, of_label = 1 / (recordings + 2), torch.nn.functional.one_hot(labels, logits.shape[1]).bool()

    def negative_log_likelihood(log_temperature: float) -> float:
        shares = (logits / np.exp(log_temperature)).log_softmax(dim=1)
        others = shares.masked_fill(of_label, -torch.inf).logsumexp(dim=1)
        return float(-((1 - doubt) * shares[of_label] + doubt * others).mean())

    bounds = np.log(MIN_TEMPERATURE), np.log(MAX_TEMPERATURE)
    return float(np.exp(minimize_scalar(negative_log_likelihood, bounds=bounds, method="bounded").x))


def calibrate(network: ViewNetwork, table: Frames, compute: Compute, seed: int) -> Calibration:
    """The calibration of a network by its answers to the table's validation side.

    It answers random frames of a recording, and V frames that are evenly spread over each.
    """
    index, views = table.on(VALIDATION), network.views
    columns = np.stack([table.label[index], table.recording[index], table.group[index]])
    pool = np.unique(columns, axis=1, return_inverse=True)[1].ravel()
    members = [np.flatnonzero(pool == number) for number in range(pool.max() + 1)]
    spread = np.stack([frames[spread_frames(len(frames), views)] for frames in members])
    anchors = np.repeat(np.flatnonzero(table.anchor[index]), DRAWS)
    anchors = anchors[:: -(-len(anchors) // MOST_SETS)]
    drawn = sequences(anchors, pool, views, stream(seed, "touches.calibrate"))
    network.prepare(compute)
    with compute.autocast(), torch.inference_mode():
        values = network.frame_values(FrameInputs(table, index, compute, network.transform))
    with torch.inference_mode():
        whole = network.logits(values, torch.from_numpy(spread).to(values.device)).cpu()
        by_count = logits_by_count(network, values, drawn).cpu()
    label = torch.from_numpy(table.label[index].astype(np.int64))
    by_frames = [fit_temperature(logits, label[anchors], len(members)) for logits in by_count]
    return Calibration(by_frames, together_temperatures(whole, label[spread[:, 0]]))


def calibration_warning(calibration: Calibration | None, groups: str, remedy: str) -> list[Note]:
    """A warning where all classes are about equally probable for every recording: its temperature is near the largest.

    Args:
        groups: of which recordings the calibration is.
    """
    if not calibration or calibration.by_recordings[0] <= 0.9 * MAX_TEMPERATURE:
        return []
    text = f"answers to recordings of {groups} are no better than chance, and probabilities say so: {remedy}"
    return [Note(text, level="warning", topic="calibration")]


def together_temperatures(logits: Tensor, classes: Tensor) -> list[float]:
    """Temperatures of one, two and three recordings together, from logits (P, Y) of recordings and their classes (P,).

    Only classes with that many recordings count; a number that no class has is left out.
    """
    rng, temperatures = np.random.default_rng(0), []
    for count in range(1, MOST_RECORDINGS + 1):
        sets, labels = [], []
        for label in np.unique(classes):
            members = np.flatnonzero(classes == label)
            if len(members) >= count:
                sets += [rng.choice(members, count, replace=False) for _ in range(DRAWS * len(members))]
                labels += [int(label)] * (DRAWS * len(members))
        if not sets:
            break
        added = logits[torch.from_numpy(np.stack(sets))].log_softmax(dim=-1).sum(dim=1)
        temperatures.append(fit_temperature(added, torch.tensor(labels), len(classes)))
    return temperatures
