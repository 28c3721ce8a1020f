"""CNN-LSTM: a long short-term memory over the views in the order of time.

Hochreiter and Schmidhuber, "Long short-term memory" (1997).
"""

from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model


class CNNLSTM(ViewSystem):
    """Features (B, k, C), the earliest first, to logits (B, classes) from the last state."""

    in_time_order = True
    takes_fewer = True

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.memory = nn.LSTM(shape[0], shape[0], batch_first=True)
        self.classifier = nn.Linear(shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the logits (B, classes) of features (B, k, C) in the order of time."""
        states, _ = self.memory(views)
        return self.classifier(states[:, -1]), []
