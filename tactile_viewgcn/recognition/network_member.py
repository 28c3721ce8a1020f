"""The member `network`: the preset of this name, trained with each fold left out, if its work is allowed.

The work is counted, not timed: which members a classifier has does not depend on how busy the
machine is.
"""

from dataclasses import replace

import numpy as np

from tactile_viewgcn.device import Compute
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.params import default_params, preset_changes
from tactile_viewgcn.progress import steps
from tactile_viewgcn.recognition.calibration import recording_answers
from tactile_viewgcn.sensors.representation import NETWORK
from tactile_viewgcn.tables.counts import Gathered
from tactile_viewgcn.tables.frames import TEST, TRAIN, Frames, Views
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone

#: By kind of device, the readings that all trainings of the network may pass through it. On one
#: core of an AMD EPYC a reading took 3.2 microseconds, in frames of 16 x 16 to 64 x 64: these are
#: 53 minutes. A GPU took a tenth of the time.
MOST_READINGS = {"cpu": 1e9, "cuda": 1e10}
NONE = np.zeros(0, dtype=int)


class NetworkMember:
    """The preset's network for a table of frames.

    Args:
        recordings: indices of the frames of each training recording.
    """

    def __init__(
        self, table: Frames, views: Views, recordings: list[np.ndarray], seed: int, compute: Compute
    ):
        self.params = default_params((*preset_changes(NETWORK), f"seed={seed}"))
        settings = replace(table.plan.params, transform=self.params.preprocess.transform)
        self.table = replace(table, plan=replace(table.plan, params=settings))
        self.views, self.recordings, self.compute = views.unclustered(), recordings, compute

    @property
    def most_readings(self) -> float:
        """The number of `readings` that is allowed on the device."""
        return MOST_READINGS[self.compute.device.type]

    def readings(self, folds: list[np.ndarray]) -> float:
        """Count the sensor readings that pass through the network in its trainings: without each fold, and with all.

        Args:
            folds: masks bool (R,) of recordings that are left out together.
        """
        is_anchor = self.table.anchor & (self.table.side == TRAIN)
        anchors = np.array([is_anchor[index].sum() for index in self.recordings])
        frames = anchors.sum()
        for fold in folds:
            frames += anchors[~fold].sum()
        return float(frames) * self.params.pretrain.epochs * self.table.live.size

    def left_out(self, folds: list[np.ndarray]) -> np.ndarray:
        """Train the network without each fold, and return its probabilities (R, classes) for the fold's recordings.

        Recordings of no fold have zeros.

        Args:
            folds: masks bool (R,) of recordings that are left out together.

        Raises:
            UserError: a training diverges.
        """
        shares = np.zeros((len(self.recordings), len(self.table.classes)), dtype=np.float32)
        for fold in steps(folds, "network, groups left out", "training runs"):
            recordings = [self.recordings[number] for number in np.flatnonzero(fold)]
            index = np.concatenate(recordings)
            pool = np.repeat(np.arange(len(recordings)), [len(frames) for frames in recordings])
            network = self.train(index)
            values = network.frame_values(Gathered(self.table.inputs, index))
            shares[fold] = np.exp(
                recording_answers(network, None, values, self.table.points(index), pool)
            )
        return shares

    def train(self, left: np.ndarray = NONE) -> ViewNetwork:
        """The network, trained on the training side but for the frames at the indices `left` (k,)."""
        side = self.table.side.copy()
        side[left] = TEST
        table = self.table.with_columns(side=side)
        backbone, linear, _ = pretrain_backbone(table, self.params, self.compute)
        pretrained = {"backbone": backbone.state_dict(), "classifier": linear.state_dict()}
        network, _ = finetune_classifier(table, self.views, pretrained, self.params, self.compute)
        network.transform = table.transform
        network.prepare(self.compute)
        return network
