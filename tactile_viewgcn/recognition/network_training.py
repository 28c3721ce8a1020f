"""Trains the member `network`: the preset of this name, on some of the training recordings.

Its work is counted and not timed. Hence the choice of members does not depend on how busy the
machine is.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tactile_viewgcn.device import Compute
from tactile_viewgcn.members.network import NETWORK
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.params import default_params, preset_changes
from tactile_viewgcn.recognition.calibration import recording_answers
from tactile_viewgcn.tables.counts import Gathered
from tactile_viewgcn.tables.frames import TEST, TRAIN, Frames, Views
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone

#: By kind of device, how many sensor readings all training runs of the network can read together.
#: On one core of an AMD EPYC a reading took 3.2 microseconds, in frames of 16 x 16 to 64 x 64. The
#: limit of the CPU then means 53 minutes. A GPU took a tenth of the time.
MOST_READINGS = {"cpu": 1e9, "cuda": 1e10}


class PresetTraining:
    """Trains the preset's network on a table of frames.

    Args:
        table: the frames of all sets; only the training set is read.
        views: the viewpoints; its clusters are not used.
        recordings: indices of the frames of each of the R training recordings.
        seed: of the training runs.
        compute: the device and its precision.

    Attributes:
        params: the preset's parameters, with the seed.
        table: the table, whose frames have the preset's transform.
    """

    def __init__(
        self,
        table: Frames,
        views: Views,
        recordings: Sequence[np.ndarray],
        *,
        seed: int,
        compute: Compute,
    ):
        self.params = default_params((*preset_changes(NETWORK), f"seed={seed}"))
        settings = replace(table.plan.params, transform=self.params.preprocess.transform)
        self.table = replace(table, plan=replace(table.plan, params=settings))
        self.views = views.unclustered()
        self.recordings = recordings
        self.compute = compute

    @property
    def most_readings(self) -> float:
        """Return the number of `readings` that is allowed on the device."""
        return MOST_READINGS[self.compute.device.type]

    def readings(self, folds: Sequence[np.ndarray]) -> float:
        """Return how many sensor readings the network reads in all its training runs.

        There is one training run without each fold, and one with all recordings.

        Args:
            folds: masks bool (R,) of recordings that are held out together.
        """
        is_anchor = self.table.anchor & (self.table.side == TRAIN)
        anchors = np.array([is_anchor[index].sum() for index in self.recordings])
        frames = anchors.sum()
        for fold in folds:
            frames += anchors[~fold].sum()
        return float(frames) * self.params.pretrain.epochs * self.table.live.size

    def train(self, recordings: np.ndarray) -> ViewNetwork:
        """Return the network, trained on some of the recordings and ready for answers.

        The frames of all other recordings count as the test set, which no training reads.

        Args:
            recordings: bool (R,), the recordings to train on.

        Raises:
            UserError: the training diverges.
        """
        side = self.table.side.copy()
        for recording in np.flatnonzero(~recordings).tolist():
            side[self.recordings[recording]] = TEST
        table = self.table.with_columns(side=side)
        backbone, linear, _ = pretrain_backbone(table, self.params, self.compute)
        pretrained = {"backbone": backbone.state_dict(), "classifier": linear.state_dict()}
        network, _ = finetune_classifier(table, self.views, pretrained, self.params, self.compute)
        network.transform = table.transform
        network.prepare(self.compute)
        return network

    def answers(self, network: ViewNetwork, recordings: np.ndarray) -> np.ndarray:
        """Return a network's probabilities float32 (n, classes) for whole recordings.

        Args:
            network: what `train` returned.
            recordings: bool (R,), the n recordings to answer.
        """
        answered = [self.recordings[recording] for recording in np.flatnonzero(recordings).tolist()]
        index = np.concatenate(answered)
        recording = np.repeat(np.arange(len(answered)), [len(frames) for frames in answered])
        values = network.frame_values(Gathered(self.table.inputs, index))
        points = self.table.points(index)
        logarithms = recording_answers(network, None, values, points, recording)
        answers: np.ndarray = np.exp(logarithms).astype(np.float32)
        return answers
