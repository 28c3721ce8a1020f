"""The backbone: a modified ResNet-18 that turns a tactile frame into 128 features.

Tactile-ViewGCN takes this network from Sundaram et al. 2019. They started from the ResNet-18 of He
et al., "Deep residual learning for image recognition" (arXiv 1512.03385). The input has one
channel, and two of the four stages are left, with dropout between them. The network has 674,240
weights and is trained from scratch.
"""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.params import BackboneParams

GRID = 4  # the read-out `grid` averages this many parts of a map along each edge
INFERENCE_BATCH = 128  # frames; a larger batch needs more memory and is no faster


class BasicBlock(nn.Module):
    """Residual block of two 3x3 convolutions: (B, in, H, W) -> (B, out, H / stride, W / stride).

    Args:
        inputs: number of input channels.
        outputs: number of output channels.
        stride: stride of the first convolution.
    """

    def __init__(self, inputs: int, outputs: int, stride: int = 1):
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, outputs, 3, stride, padding=1, bias=False)
        self.norm1 = nn.BatchNorm2d(outputs)
        self.conv2 = nn.Conv2d(outputs, outputs, 3, padding=1, bias=False)
        self.norm2 = nn.BatchNorm2d(outputs)
        self.shortcut: nn.Module = nn.Identity()
        if stride != 1 or inputs != outputs:
            self.shortcut = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, maps: Tensor) -> Tensor:
        """Return the maps (B, out, H / stride, W / stride) of maps (B, in, H, W)."""
        inner = torch.relu(self.norm1(self.conv1(maps)))
        return torch.relu(self.norm2(self.conv2(inner)) + self.shortcut(maps))


class Stem(nn.Module):
    """The first layers of the network: (B, 1, H, W) -> (B, C, H / 2, W / 2).

    The layers are a 3x3 convolution, batch normalisation, ReLU and maximum pooling.

    The stem gives the same result as these four layers, in fewer passes over its maps, which are
    the largest of the network. A frame has one channel, so the mean and variance of every map
    follow exactly from the moments of the frame's 3x3 patches. The normalisation is folded into the
    convolution's nine weights and its bias. ReLU comes after the pooling, with which it commutes.
    """

    def __init__(self, outputs: int):
        super().__init__()
        self.conv = nn.Conv2d(1, outputs, 3, padding=1, bias=False)
        # Any, since torch's types say that the running moments can be missing
        self.norm: Any = nn.BatchNorm2d(outputs)

    def forward(self, frames: Tensor) -> Tensor:
        """Return the maps (B, C, H / 2, W / 2) of frames (B, 1, H, W)."""
        norm = self.norm
        with torch.autocast(frames.device.type, enabled=False):
            if self.training:
                mean, variance = self._moments(frames)
            else:
                mean = norm.running_mean
                variance = norm.running_var
            scale = norm.weight * (variance + norm.eps).rsqrt()
            weight = self.conv.weight * scale[:, None, None, None]
            bias = norm.bias - mean * scale
        maps = functional.conv2d(frames, weight, bias, padding=1)
        return torch.relu(functional.max_pool2d(maps, 3, stride=2, padding=1))

    def _moments(self, frames: Tensor) -> tuple[Tensor, Tensor]:
        """Return the mean and variance (C,) of the convolution's maps over the batch.

        The running moments are updated.
        """
        # (B, H, W, 3, 3)
        patches = functional.pad(frames, (1, 1, 1, 1)).squeeze(1).unfold(1, 3, 1).unfold(2, 3, 1)
        patches = patches.permute(3, 4, 0, 1, 2).flatten(2).flatten(0, 1)  # (9, B * H * W)
        count = patches.shape[1]
        centre = patches.mean(dim=1, keepdim=True)
        patches = patches - centre
        covariance = patches @ patches.T / count
        weight = self.conv.weight.flatten(1)
        mean = weight @ centre.squeeze(1)
        variance = ((weight @ covariance) * weight).sum(dim=1)
        with torch.no_grad():
            self.norm.num_batches_tracked += 1
            self.norm.running_mean.lerp_(mean, self.norm.momentum)
            self.norm.running_var.lerp_(variance * (count / max(1, count - 1)), self.norm.momentum)
        return mean, variance


class Backbone(nn.Module):
    """Frames (B, 1, H, W) to features (B, C); a 32 x 32 frame has last maps of 128 x 8 x 8.

    The weights are drawn from torch's default generator.

    Args:
        options: the section `model.backbone`. `width` is the number of channels of stage 1; stage 2
            has twice as many. `dropout` is the share of stage 1's channels that are dropped in
            training. The `readout` `average` is the mean of each map, as in the paper. The
            `readout` `grid` takes the means of 4 x 4 parts of each map, which keep where on the
            hand a feature is. A linear layer turns these means into the same number of features.
        maps: whether to return the maps themselves, (B, 2 * width, H / 4, W / 4), in the precision
            that they were computed in.

    Attributes:
        width: number of channels of stage 1.
        features: C, which is 2 * width.
        maps: see Args.
    """

    def __init__(self, options: BackboneParams, *, maps: bool = False):
        super().__init__()
        width = options.width
        self.width = width
        self.features = 2 * width
        self.maps = maps
        self.stem = Stem(width)
        self.stage1 = nn.Sequential(BasicBlock(width, width), BasicBlock(width, width))
        self.dropout = nn.Dropout2d(options.dropout)
        self.stage2 = nn.Sequential(
            BasicBlock(width, 2 * width, stride=2), BasicBlock(2 * width, 2 * width)
        )
        self.grid = None
        if options.readout == "grid" and not maps:
            join = nn.Linear(GRID**2 * self.features, self.features, bias=False)
            self.grid = nn.Sequential(join, nn.BatchNorm1d(self.features), nn.ReLU())

    def forward(self, frames: Tensor) -> Tensor:
        """Return the features (B, C) of frames (B, 1, H, W), or their maps."""
        maps: Tensor = self.stage2(self.dropout(self.stage1(self.stem(frames))))
        if self.maps:
            return maps
        if maps.dtype == torch.bfloat16:
            maps = maps.float()
        if self.grid is None:
            return maps.mean(dim=(2, 3))
        with torch.autocast(maps.device.type, enabled=False):
            parts = functional.adaptive_avg_pool2d(maps, GRID).flatten(1)
            features: Tensor = self.grid(parts)
        return features

    def load_pretrained(self, state: Mapping[str, Tensor]) -> None:
        """Load the weights of a pretrained backbone that returns features.

        The weights of its readout are ignored if this backbone returns maps.

        Args:
            state: the state of the pretrained backbone.

        Raises:
            RuntimeError: the backbones differ in width or readout.
        """
        if self.maps:
            state = {name: value for name, value in state.items() if not name.startswith("grid.")}
        self.load_state_dict(state)

    def map_shape(self, shape: tuple[int, int]) -> tuple[int, int, int]:
        """Return the shape (2 * width, H / 4, W / 4), rounded up, of the maps of a frame (H, W)."""
        height, width = shape
        return 2 * self.width, _quarter(height), _quarter(width)


def _quarter(length: int) -> int:
    """Return the length of a map's edge after two halvings, each rounded up."""
    return math.ceil(math.ceil(length / 2) / 2)


@torch.no_grad()
def extract_features(backbone: nn.Module, batches: Iterable[Tensor]) -> Tensor:
    """Return the features (n, C), or maps (n, C, H, W), of frames, in evaluation mode.

    Args:
        backbone: the backbone, which is left in evaluation mode.
        batches: n frames in all, in batches (B, 1, H, W) on the backbone's device.
    """
    backbone.eval()
    return torch.cat([backbone(frames) for frames in batches])
