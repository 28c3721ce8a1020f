"""ConvLSTM: a long short-term memory over the views' maps, whose gates are one 3x3 convolution.

Shi et al., "Convolutional LSTM network: a machine learning approach for precipitation nowcasting"
(arXiv 1506.04214), without peephole connections. The convolutions take most of the time, so they
are computed in the precision of the maps, like the convolutions of the backbone.
"""

import torch
from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model


class ConvLSTM(ViewSystem):
    """Maps (B, k, C, H, W), the earliest first, to logits (B, classes).

    The logits come from the last state, averaged over H and W.
    """

    takes = "maps"
    in_time_order = True
    takes_fewer = True

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.gates = nn.Conv2d(2 * shape[0], 4 * shape[0], 3, padding=1)
        self.classifier = nn.Linear(shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of maps (B, k, C, H, W) in the order of time."""
        hidden = torch.zeros_like(views[:, 0])
        cell = torch.zeros_like(hidden, dtype=self.classifier.weight.dtype)
        in_bfloat16 = views.dtype == torch.bfloat16
        with torch.autocast(views.device.type, torch.bfloat16, enabled=in_bfloat16):
            for view in views.unbind(dim=1):
                gates = self.gates(torch.cat([view, hidden], dim=1)).chunk(4, dim=1)
                input_gate, forget_gate, output_gate, candidate = gates
                cell = forget_gate.sigmoid() * cell + input_gate.sigmoid() * candidate.tanh()
                hidden = (output_gate.sigmoid() * cell.tanh()).to(view.dtype)
        return self.classifier(hidden.to(cell.dtype).mean(dim=(2, 3))), []
