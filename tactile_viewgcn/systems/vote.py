"""Vote: the mean of the class probabilities of single views. Nothing is fine-tuned."""

from torch import Tensor, nn

from tactile_viewgcn.nn.system import Sizes, ViewSystem
from tactile_viewgcn.params import Model


class Vote(ViewSystem):
    """Features (B, k, C) to logits (B, classes), the logarithms of the mean probabilities; the order plays no part."""

    takes_fewer = True
    trainable = False

    def __init__(self, sizes: Sizes, model: Model):
        super().__init__()
        self.classifier = nn.Linear(sizes.features, sizes.classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        log_p = self.classifier(views).log_softmax(dim=-1)
        return log_p.logsumexp(dim=1) - log_p.new_tensor(views.shape[1]).log(), []

    def load_frame_classifier(self, weights: dict[str, Tensor]) -> None:
        self.classifier.load_state_dict(weights)
