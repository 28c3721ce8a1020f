"""The member `network`: the network of the preset of this name, trained with groups left out, if time allows."""

import time
from dataclasses import replace

import numpy as np

from tactile_viewgcn.device import Compute
from tactile_viewgcn.messages import Note, UserError
from tactile_viewgcn.nn.network import ViewNetwork
from tactile_viewgcn.params import default_params, preset_changes
from tactile_viewgcn.recognition.calibration import recording_answers
from tactile_viewgcn.sensors.representation import NETWORK
from tactile_viewgcn.tables.counts import Gathered, evenly
from tactile_viewgcn.tables.frames import TEST, TRAIN, Frames, Views
from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone

LIMIT = 1800.0  # seconds of all trainings of the network: of each fold, and of the one that is kept
NONE = np.zeros(0, dtype=int)
FIRST_STEPS = 8  # by which they are estimated, after as many that are not timed


class NetworkMember:
    """The preset's network for a table of frames.

    Args:
        recordings: indices of the frames of each training recording.
    """

    def __init__(self, table: Frames, views: Views, recordings: list[np.ndarray], seed: int, compute: Compute):
        self.params = default_params((*preset_changes(NETWORK), f"seed={seed}"))
        self.table = replace(table, transform=self.params.preprocess.transform)
        self.views, self.recordings, self.compute = views.unclustered(), recordings, compute

    def seconds(self) -> float:
        """Seconds of one training on this machine, estimated by the first steps of its pretraining."""
        table, config, ends = self.table, self.params.pretrain, list[float]()
        anchors, few = np.flatnonzero(table.anchor & (table.side == TRAIN)), np.zeros_like(table.anchor)
        few[evenly(anchors, FIRST_STEPS * config.batch)] = True
        table, short = replace(table, anchor=few), replace(self.params, pretrain=replace(config, epochs=2))
        pretrain_backbone(table, short, self.compute, on_epoch=lambda *_: ends.append(time.perf_counter()))
        return (ends[1] - ends[0]) * config.epochs * len(anchors) / int(few.sum())

    def left_out(self, folds: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, Note]:
        """Train the network without each fold, bool (R,), that the limit allows, and answer that fold.

        Returns:
            Probabilities (R, classes); the recordings bool (R,) that were answered; and a note that says how many folds
            they are, or why there are none.
        """
        shares = np.zeros((len(self.recordings), len(self.table.classes)), dtype=np.float32)
        answered = np.zeros(len(shares), dtype=bool)
        try:
            seconds = self.seconds()
            count = min(max(0, int(LIMIT / seconds) - 1), len(folds))
            for fold in folds[:count]:
                left = [self.recordings[number] for number in np.flatnonzero(fold)]
                index, pool = np.concatenate(left), np.repeat(np.arange(len(left)), [len(each) for each in left])
                network = self.train(index)
                values = network.frame_values(Gathered(self.table.inputs, index))
                points = self.table.points(index)
                shares[fold], answered = np.exp(recording_answers(network, None, values, points, pool)), answered | fold
        except UserError as error:
            count, answered, text = 0, np.zeros_like(answered), str(error)
        else:
            text = f"one training takes about {seconds:.0f} s here, all may take {LIMIT:.0f} s"
        taken = f"trained without each of {count} of {len(folds)} parts of the training groups, then with all"
        alone = f"left out, but may err less; `dvc exp run $(tactile-viewgcn preset {NETWORK})` trains it alone"
        return shares, answered, Note(f"{NETWORK}: {text}: {taken if count else alone}", topic="recogniser")

    def train(self, left: np.ndarray = NONE) -> ViewNetwork:
        """The network, trained on the training side but for the frames at the indices `left` (k,)."""
        side = self.table.side.copy()
        side[left] = TEST
        table = replace(self.table, side=side)
        backbone, linear, _ = pretrain_backbone(table, self.params, self.compute)
        pretrained = {"backbone": backbone.state_dict(), "classifier": linear.state_dict()}
        network, _ = finetune_classifier(table, self.views, pretrained, self.params, self.compute)
        network.transform = table.transform
        network.prepare(self.compute)
        return network
