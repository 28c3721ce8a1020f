"""Vote: each view is classified alone and the probabilities are averaged. Nothing is trained a second time."""

from torch import Tensor, nn

from tactile_viewgcn.nn.system import ViewSystem


class System(ViewSystem):
    """Features (B, k, C) to the logarithms of the mean class probabilities, whatever the order of the views."""

    takes_fewer = True
    learns = False

    def __init__(self, *, features: int, classes: int):
        super().__init__()
        self.classifier = nn.Linear(features, classes)

    def forward(self, views: Tensor) -> tuple[Tensor, list[Tensor]]:
        each = self.classifier(views).log_softmax(dim=-1)
        return each.logsumexp(dim=1) - each.new_tensor(views.shape[1]).log(), []

    def begin(self, classifier: dict[str, Tensor]) -> None:
        self.classifier.load_state_dict(classifier)
