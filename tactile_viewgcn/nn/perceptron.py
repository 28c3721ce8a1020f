"""Two linear layers on the sensors, in place of the residual network: every sensor has weights of its own."""

import torch
from torch import Tensor, nn


class Perceptron(nn.Module):
    """Frames (B, 1, H, W) to features (B, 2 * width) by a layer of 8 * width units and one of 2 * width.

    Args:
        shape: (H, W) of a frame.
        width: half of the features, as in the residual network.
        dropout: share of both layers' units dropped in training.
    """

    def __init__(self, shape: tuple[int, int], width: int, dropout: float):
        super().__init__()
        self.width, self.features = width, 2 * width
        self.hidden = nn.Linear(shape[0] * shape[1], 8 * width)
        self.norm = nn.BatchNorm1d(8 * width)
        self.dropout = nn.Dropout(dropout)
        self.out = nn.Linear(8 * width, self.features)
        self.out_norm = nn.BatchNorm1d(self.features)

    def forward(self, frames: Tensor) -> Tensor:
        with torch.autocast(frames.device.type, enabled=False):
            hidden = self.dropout(torch.relu(self.norm(self.hidden(frames.flatten(1)))))
            return self.dropout(torch.relu(self.out_norm(self.out(hidden))))
