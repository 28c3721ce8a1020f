"""Small systems with chosen weights, and views for them."""

from typing import get_args

import torch

from tactile_viewgcn.params import System
from tactile_viewgcn.recognition.model_file import build_classifier
from tests.glove_data import recipe

NETWORKS = [name for name in get_args(System) if name != "sensors"]
NARROW = "model.backbone.width=8"
LINE = torch.tensor([[0.0, 0, 0], [1, 0, 0], [3, 0, 0], [7, 0, 0]])


def fill(parameter, values):
    """Write values into a parameter, in its shape."""
    with torch.no_grad():
        parameter.copy_(torch.as_tensor(values, dtype=parameter.dtype).view_as(parameter))


def only_leaky(system):
    """Return the system in evaluation mode; its shape classifier is only a LeakyReLU."""
    for layer in (system.classifier[0], system.classifier[3]):
        fill(layer.weight, torch.eye(len(layer.weight)))
        fill(layer.bias, torch.zeros(len(layer.bias)))
    return system.eval()


def built(name, *changes, places=LINE, classes=5):
    """Return a classifier with 16 features and maps of 16 x 3 x 3, in evaluation mode."""
    torch.manual_seed(0)
    model = recipe(f"model.system={name}", NARROW, *changes).model
    return build_classifier(places, classes, model, (12, 12)).eval()


def head_of(kind, *changes, places=LINE, classes=5, features=16):
    """Return only the head of a system; `features` is C, or the shape (C, H, W) of maps."""
    if not isinstance(features, tuple):
        features = (features,)
    return kind(torch.as_tensor(places), features, classes, recipe(*changes).model)


def some_views(classifier, count=None):
    """Return features, or maps, of three view sets of `count` views, or of V views."""
    if count is None:
        count = classifier.views
    generator = torch.Generator().manual_seed(1)
    return torch.randn(3, count, *classifier.feature_shape, generator=generator)
