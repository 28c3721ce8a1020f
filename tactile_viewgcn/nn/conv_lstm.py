"""ConvLSTM: the views' feature maps in the order of time through a memory whose gates are one 3x3 convolution.

Shi et al., "Convolutional LSTM network: a machine learning approach for precipitation nowcasting" (arXiv
1506.04214), without its peephole connections. Its products are computed in the precision of the maps, as the
backbone's are: with them it is the larger part of the work.
"""

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem


class System(ViewSystem):
    """Maps (B, k, C, H, W), the earliest first, to logits of the last state's average over H and W."""

    takes = "maps"
    in_time_order = True
    takes_fewer = True

    def __init__(self, *, features: int, classes: int):
        super().__init__()
        self.gates = nn.Conv2d(2 * features, 4 * features, 3, padding=1)
        self.classifier = nn.Linear(features, classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        hidden = torch.zeros_like(views[:, 0])
        cell = torch.zeros_like(hidden, dtype=self.classifier.weight.dtype)
        with torch.autocast(views.device.type, torch.bfloat16, enabled=views.dtype == torch.bfloat16):
            for view in views.unbind(dim=1):
                hidden, cell = self.step(view, hidden, cell)
        return self.classifier(hidden.to(cell.dtype).mean(dim=(2, 3))), []

    def step(self, view: Tensor, hidden: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
        """Maps of a view and of the states, (B, C, H, W) each, to the next states."""
        inward, forget, outward, candidate = self.gates(torch.cat([view, hidden], dim=1)).chunk(4, dim=1)
        cell = forget.sigmoid() * cell + inward.sigmoid() * candidate.tanh()
        return (outward.sigmoid() * cell.tanh()).to(view.dtype), cell
