"""The plain counterparts: what the pipeline computes, written down as one would who does not look at the clock.

The network is the backbone layer by layer in float32, contiguous, without autocast; every view of every view set goes
through it; the graph's messages are made pair by pair. View sets are drawn by a loop over anchors and clusters.
"""

from collections import OrderedDict
from copy import deepcopy
from functools import partial
from pathlib import Path

import h5py
import numpy as np
import torch
import torch.nn.functional as functional
from torch import Tensor, nn

from tactile_viewgcn.classifier import Classifier
from tactile_viewgcn.nn.backbone import Backbone, BasicBlock
from tactile_viewgcn.nn.graph import edge_geometry, gather_nodes, nearest
from tactile_viewgcn.nn.view_gcn import SLOPE, LocalGraphConvolution, NonLocalMessagePassing
from tactile_viewgcn.params import Finetune
from tactile_viewgcn.recordings import COLUMNS
from tactile_viewgcn.stag import FIELDS

SETS = 20  # view sets in a batch, the released code's


class PlainBackbone(nn.Module):
    """Frames (B, 1, H, W) to features (B, 2 * width), with the weights of a `Backbone`."""

    def __init__(self, backbone: Backbone):
        super().__init__()
        width = backbone.width
        stem = {
            "conv": nn.Conv2d(1, width, 3, padding=1, bias=False),
            "norm": nn.BatchNorm2d(width),
            "relu": nn.ReLU(),
            "pool": nn.MaxPool2d(3, stride=2, padding=1),
        }
        self.stem = nn.Sequential(OrderedDict(stem))
        self.stage1 = nn.Sequential(BasicBlock(width, width), BasicBlock(width, width))
        self.dropout = nn.Dropout2d(backbone.dropout.p)
        self.stage2 = nn.Sequential(BasicBlock(width, 2 * width, stride=2), BasicBlock(2 * width, 2 * width))
        self.load_state_dict(backbone.state_dict())
        self.train(backbone.training).to(next(backbone.parameters()).device)

    def forward(self, frames: Tensor) -> Tensor:
        return self.stage2(self.dropout(self.stage1(self.stem(frames)))).mean(dim=(2, 3))


class PlainClassifier(nn.Module):
    """View sets of frames (B, V, 1, H, W) to logits (B, classes), with the weights of a `Classifier`."""

    def __init__(self, classifier: Classifier):
        super().__init__()
        self.backbone, self.head = PlainBackbone(classifier.backbone), deepcopy(classifier.head)
        for passing in self.head.messages:
            passing.received = partial(received, passing)
        for convolution in self.head.convolutions:
            convolution.forward = partial(convolve, convolution)
        self.train(classifier.training)

    def forward(self, frames: Tensor) -> tuple[Tensor, list[Tensor]]:
        return self.head(self.backbone(frames.flatten(0, 1)).unflatten(0, frames.shape[:2]))


def received(passing: NonLocalMessagePassing, nodes: Tensor) -> Tensor:
    """What each node (B, N, C) receives, the linear layer applied to every pair of nodes."""
    count = nodes.shape[1]
    senders = nodes.unsqueeze(1).expand(-1, count, -1, -1)
    receivers = nodes.unsqueeze(2).expand(-1, -1, count, -1)
    return functional.leaky_relu(passing.message(torch.cat([senders, receivers], dim=-1)), SLOPE).sum(dim=2)


def convolve(convolution: LocalGraphConvolution, nodes: Tensor, positions: Tensor) -> Tensor:
    """The local graph convolution of nodes (B, N, C), each node's neighbours gathered."""
    near = nearest(positions, convolution.neighbours)
    weights = convolution.relation(edge_geometry(positions, near, convolution.edge_distance))
    gathered = (weights * gather_nodes(nodes, near.expand(len(nodes), -1, -1))).sum(dim=2)
    return functional.leaky_relu(convolution.norm(convolution.linear(gathered).flatten(0, 1)), SLOPE).view_as(nodes)


def pretrain_epoch(
    backbone: PlainBackbone,
    classifier: nn.Linear,
    optimiser: torch.optim.Optimizer,
    frames: Tensor,
    labels: Tensor,
    *,
    batch: int,
    noise: float,
) -> None:
    """A step down the cross-entropy of each batch of frames (n, 1, H, W)."""
    backbone.train()
    for index in torch.randperm(len(frames)).to(frames.device).split(batch):
        inputs = frames[index] + noise * torch.randn_like(frames[index])
        loss = functional.cross_entropy(classifier(backbone(inputs)), labels[index])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


def finetune_epoch(
    classifier: PlainClassifier, frames: Tensor, labels: Tensor, sets: np.ndarray, how: Finetune, noise: float
) -> None:
    """A step down equation 6's loss of each 20 of the view sets (A, V) of indices into frames (n, 1, H, W)."""
    groups = [
        {"params": classifier.backbone.parameters(), "lr": how.lr_backbone},
        {"params": classifier.head.parameters()},
    ]
    optimiser = torch.optim.SGD(groups, how.lr, momentum=how.momentum, weight_decay=how.weight_decay)
    classifier.train()
    for index in torch.from_numpy(sets)[torch.randperm(len(sets))].to(frames.device).split(SETS):
        inputs = frames[index] + noise * torch.randn_like(frames[index])
        logits, view_logits = classifier(inputs)
        loss = classifier.head.loss(logits, view_logits, labels[index[:, 0]])
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


@torch.no_grad()
def logits(classifier: PlainClassifier, frames: Tensor, sets: np.ndarray) -> Tensor:
    """Logits (A, classes) of the view sets (A, V) of indices into frames (n, 1, H, W), in batches of 20."""
    classifier.eval()
    return torch.cat([classifier(frames[index])[0] for index in torch.from_numpy(sets).to(frames.device).split(SETS)])


def draw(
    anchors: np.ndarray, cluster: np.ndarray, pool: np.ndarray, views: int, rng: np.random.Generator
) -> np.ndarray:
    """A view set (V,) around each anchor, (A, V): a frame of cluster i in column i, of any where it has none."""
    members, everyone = {}, {}
    for frame, (own_pool, own_cluster) in enumerate(zip(pool.tolist(), cluster.tolist(), strict=True)):
        members.setdefault((own_pool, own_cluster), []).append(frame)
        everyone.setdefault(own_pool, []).append(frame)
    sets = []
    for anchor in anchors.tolist():
        drawn = []
        for view in range(views):
            choices = members.get((int(pool[anchor]), view), everyone[int(pool[anchor])])
            drawn.append(anchor if view == cluster[anchor] else choices[rng.integers(len(choices))])
        sets.append(drawn)
    return np.array(sets)


def ingest(source: Path, out: Path) -> None:
    """A STAG metadata.mat into a table like the pipeline's: all of it read, then each column written at once."""
    from scipy import io

    tree = io.loadmat(str(source))
    with h5py.File(out, "w") as file:
        chunks = (64, *tree["pressure"].shape[1:])
        file.create_dataset("pressure", data=tree["pressure"], chunks=chunks, compression="gzip")
        for field, column in FIELDS.items():
            if field in tree:
                file.create_dataset(column, data=tree[field].ravel().astype(COLUMNS[column]))
