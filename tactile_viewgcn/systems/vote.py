"""Vote: the mean log-probabilities of single views, as if independent, without fine-tuning."""

from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model


class Vote(ViewSystem):
    """Features (B, k, C) to logits (B, classes), the mean of the views' log-probabilities."""

    takes_fewer = True
    takes_more = True
    trainable = False

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.classifier = nn.Linear(shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return the mean log-probabilities (B, classes) of features (B, k, C)."""
        return self.classifier(views).log_softmax(dim=-1).mean(dim=1), []

    def load_frame_classifier(self, weights: dict[str, Tensor]) -> None:
        """Take the linear classifier of single frames; see `ViewSystem`."""
        self.classifier.load_state_dict(weights)
