"""Pretraining and fine-tuning on the small table, with the same call for both."""

import torch
from torch import nn

from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, views_of


def frames_of(changes, every):
    """Return the table under the changes to `split`, with only every `every`-th anchor."""
    return fewer_anchors(
        table(*(change for change in changes if change.startswith("split"))), every
    )


def pretrain(*changes, every=1, **checkpoint):
    """Return backbone and linear classifier as one module, and the progress."""
    backbone, linear, progress = pretrain_backbone(
        frames_of(changes, every), recipe(*changes), CPU, **checkpoint
    )
    return nn.ModuleList([backbone, linear]), progress


def finetune(*changes, every=1, **checkpoint):
    """Return the network, trained from the small table's backbone, and the progress."""
    frames, params = frames_of(changes, every), recipe(*changes)
    return finetune_classifier(
        frames, views_of(frames, params), pretrained(), params, CPU, **checkpoint
    )


def equal_weights(one, other):
    """Return whether two modules have equal weights and moments, bit by bit."""
    pairs = zip(one.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(a, b) for a, b in pairs)
