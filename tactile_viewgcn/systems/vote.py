"""Vote: the mean of the log-probabilities of single views, as of independent ones. Nothing is fine-tuned."""

from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem
from tactile_viewgcn.params import Model


class Vote(ViewSystem):
    """Features (B, k, C) to logits (B, classes), the mean log-probabilities; the order plays no part."""

    takes_fewer = True
    takes_more = True
    trainable = False

    def __init__(self, viewpoints: Tensor, shape: tuple[int, ...], classes: int, model: Model):
        super().__init__()
        self.classifier = nn.Linear(shape[0], classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        return self.classifier(views).log_softmax(dim=-1).mean(dim=1), []

    def load_frame_classifier(self, weights: dict[str, Tensor]) -> None:
        self.classifier.load_state_dict(weights)
