"""A small residual network on the maximum of each sensor over a view set."""

from typing import Any, Self

import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.nn.backbone import Backbone
from tactile_viewgcn.sensors.estimators import TrainingFrames
from tactile_viewgcn.sensors.unit import above_dead_zone

WIDTH, DROPOUT = 32, 0.3  # channels of the first stage; share of the features dropped
STEPS, BATCH = 1500, 64  # view sets
LR, WEIGHT_DECAY = 3e-3, 0.05
SHIFT = 1  # rows and columns that a batch is shifted by at most


class MaxNetwork:
    """A network that is trained on random view sets of 1 to V frames, equally many of each pool of frames.

    The optimiser is AdamW, with one cycle of the learning rate (Smith and Topin 2019). One network answers every number
    of frames.
    """

    takes_fewer = False  # each number of views would cost one more pass through the network

    def fit(self, data: TrainingFrames) -> Self:
        values, rng = torch.from_numpy(self.frame_values(data.frames)), np.random.default_rng(data.seed)
        members = [np.flatnonzero(data.pools == pool) for pool in np.unique(data.pools)]
        labels = torch.from_numpy(np.array([data.labels[frames[0]] for frames in members]))
        self._live, self._scale = torch.from_numpy(data.live), float(values.pow(2).mean().sqrt()) or 1.0
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(data.seed)
            self._network = network = build_network(data.classes)
            optimiser = torch.optim.AdamW(network.parameters(), LR, weight_decay=WEIGHT_DECAY)
            schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, LR, STEPS)
            for _ in range(STEPS):
                pools, count = rng.integers(len(members), size=BATCH), rng.integers(1, max(data.sizes) + 1)
                sets = np.stack([rng.choice(members[pool], count) for pool in pools])
                maps = shifted(self._maps(values[sets]), *rng.integers(2 * SHIFT + 1, size=2))
                optimiser.zero_grad()
                functional.cross_entropy(network(maps), labels[pools]).backward()
                optimiser.step()
                schedule.step()
        network.eval()
        return self

    def state_dict(self) -> dict[str, Any]:
        """The network's weights, and the root mean square of the training values."""
        return {"weights": self._network.state_dict(), "scale": self._scale}

    def load_state_dict(self, state: dict[str, Any], live: np.ndarray, classes: int) -> None:
        self._live, self._scale = torch.from_numpy(live), float(state["scale"])
        with torch.random.fork_rng(devices=[]):  # building a network draws weights
            self._network = build_network(classes).eval()
        self._network.load_state_dict(state["weights"])

    def frame_values(self, sensors: np.ndarray) -> np.ndarray:
        return above_dead_zone(sensors)

    @torch.no_grad()
    def logits(self, values: np.ndarray) -> np.ndarray:
        parts = torch.from_numpy(values).split(4 * BATCH)
        return torch.cat([self._network(self._maps(part)) for part in parts]).numpy()

    def _maps(self, values: Tensor) -> Tensor:
        """Maps (B, 1, H, W) of each sensor's maximum, from values (B, k, S) of view sets."""
        maps = values.new_zeros(len(values), 1, *self._live.shape)
        maps[:, 0, self._live] = values.amax(dim=1) / self._scale
        return maps


def build_network(classes: int) -> nn.Sequential:
    """The network from maps (B, 1, H, W) to logits (B, classes); weights come from torch's default generator."""
    body = Backbone(WIDTH, blocks=1, readout="grid")
    return nn.Sequential(body, nn.Dropout(DROPOUT), nn.Linear(body.features, classes))


def shifted(maps: Tensor, row: int, column: int) -> Tensor:
    """Maps (B, 1, H, W) moved up by `row` - SHIFT rows and left by `column` - SHIFT columns; zeros move in."""
    height, width = maps.shape[2:]
    return functional.pad(maps, (SHIFT,) * 4)[:, :, row : row + height, column : column + width]
