"""MVCNN, mean and vote: systems that pool views."""

import math

import torch

from tactile_viewgcn.systems.mean import MeanViews
from tactile_viewgcn.systems.mvcnn import MVCNN
from tactile_viewgcn.systems.vote import Vote
from tests.glove_data import pretrained
from tests.systems.small_systems import fill, head_of, only_leaky
from tests.training.small_trainings import finetune


def test_mvcnn_takes_the_maximum_and_mean_the_mean_by_hand():
    views = torch.tensor([[[1.0, -2], [0.5, -4], [-3, -3]]])
    for kind, expected in ((MVCNN, [1, 0.2 * -2]), (MeanViews, [0.2 * -0.5, 0.2 * -3])):
        system = only_leaky(head_of(kind, features=2, classes=2))
        torch.testing.assert_close(system(views)[0], torch.tensor([expected]))


def test_vote_averages_log_probabilities_by_hand():
    system = head_of(Vote, features=2, classes=2)
    fill(system.classifier.weight, torch.eye(2))
    fill(system.classifier.bias, [0, 0])
    # probabilities 3/4 and 1/4, then 1/2 and 1/2, then 1/10 and 9/10
    views = torch.tensor([[[math.log(3), 0], [5, 5], [0, 2 * math.log(3)]]])
    products = [3 / 4 * 1 / 2 * 1 / 10, 1 / 4 * 1 / 2 * 9 / 10]
    expected = torch.tensor([[math.log(product) / 3 for product in products]])
    torch.testing.assert_close(system(views)[0], expected)


def test_vote_begins_as_the_pretrained_classifier_and_is_not_trained():
    network, _ = finetune("model.system=vote", "finetune.moments=running", every=12)
    for part, module in (("backbone", network.backbone), ("classifier", network.head.classifier)):
        weights = module.state_dict()
        for name, weight in pretrained()[part].items():
            assert torch.equal(weights[name], weight)
