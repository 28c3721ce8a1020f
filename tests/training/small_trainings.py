"""Both trainings on the small table, the same call for each."""

import torch
from torch import nn

from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, views_of


def frames_of(changes, every):
    """The table of the changes to `split`, with each `every`-th anchor."""
    return fewer_anchors(
        table(*(change for change in changes if change.startswith("split"))), every
    )


def pretrain(*changes, every=1, **checkpoint):
    """Backbone and linear classifier as one module, and the progress."""
    backbone, linear, progress = pretrain_backbone(
        frames_of(changes, every), recipe(*changes), CPU, **checkpoint
    )
    return nn.ModuleList([backbone, linear]), progress


def finetune(*changes, every=1, **checkpoint):
    """The network, from the small table's backbone, and the progress."""
    frames, params = frames_of(changes, every), recipe(*changes)
    return finetune_classifier(
        frames, views_of(frames, params), pretrained(), params, CPU, **checkpoint
    )


def equal_weights(one, other):
    """Whether two modules have equal weights and moments, bit by bit."""
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)
