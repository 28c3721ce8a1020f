"""The modified ResNet-18: one tactile frame to a feature of 128.

Residual blocks after He et al., "Deep residual learning for image recognition" (arXiv 1512.03385); one input
channel, two of its four stages, and dropout between them, as in Sundaram et al. 2019, whose network
Tactile-ViewGCN takes over. 674,240 weights, trained from scratch.
"""

import torch
from torch import Tensor, nn

FEATURES = 128
DROPOUT = 0.2
AT_ONCE = 128  # frames in one pass where nothing is learnt: more gain no speed and take memory


class BasicBlock(nn.Module):
    """Two 3x3 convolutions around which the input is added: (B, in, H, W) -> (B, out, H / stride, W / stride)."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1):
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, padding=1, bias=False)
        self.norm1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1, bias=False)
        self.norm2 = nn.BatchNorm2d(outputs)
        self.shortcut = nn.Identity()
        if stride != 1 or inputs != outputs:
            self.shortcut = nn.Sequential(nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs))

    def forward(self, x: Tensor) -> Tensor:
        out = torch.relu(self.norm1(self.conv1(x)))
        return torch.relu(self.norm2(self.conv2(out)) + self.shortcut(x))


class Backbone(nn.Module):
    """Frames (B, 1, H, W) to features (B, 128); a 32 x 32 frame passes through maps of 128 x 8 x 8.

    Args:
        dropout: share of stage 1's channels dropped in training.
    """

    def __init__(self, dropout: float = DROPOUT):
        super().__init__()
        self.stem = nn.Sequential(
            nn.Conv2d(1, 64, 3, padding=1, bias=False),
            nn.BatchNorm2d(64),
            nn.ReLU(),
            nn.MaxPool2d(3, stride=2, padding=1),
        )
        self.stage1 = nn.Sequential(BasicBlock(64, 64), BasicBlock(64, 64))
        self.dropout = nn.Dropout2d(dropout)
        self.stage2 = nn.Sequential(BasicBlock(64, FEATURES, stride=2), BasicBlock(FEATURES, FEATURES))

    def forward(self, frames: Tensor) -> Tensor:
        maps = self.stage2(self.dropout(self.stage1(self.stem(frames))))  # (B, 128, H / 4, W / 4)
        return maps.float().mean(dim=(2, 3))


@torch.no_grad()
def features_of(backbone: Backbone, frames: Tensor) -> Tensor:
    """Features float32 (n, 128) of frames (n, 1, H, W), in evaluation mode and batches that fit memory."""
    backbone.eval()
    return torch.cat([backbone(part).float() for part in frames.split(AT_ONCE)])
