"""Pretraining and fine-tuning on the small table, with the same call for both."""

import torch
from torch import nn

from tactile_viewgcn.training.finetuning import finetune_classifier
from tactile_viewgcn.training.pretraining import pretrain_backbone
from tests.glove_data import CPU, fewer_anchors, pretrained, recipe, table, views_of


def frames_of(changes, every):
    """Return the table under the changes to `split`, with only every `every`-th anchor."""
    of_split = [change for change in changes if change.startswith("split")]
    return fewer_anchors(table(*of_split), every)


def pretrain(*changes, every=1, **checkpoint):
    """Return backbone and linear classifier as one module, and the progress."""
    frames = frames_of(changes, every)
    backbone, linear, progress = pretrain_backbone(frames, recipe(*changes), CPU, **checkpoint)
    return nn.ModuleList([backbone, linear]), progress


def finetune(*changes, every=1, **checkpoint):
    """Return the network, trained from the small table's backbone, and the progress."""
    frames = frames_of(changes, every)
    params = recipe(*changes)
    views = views_of(frames, params)
    return finetune_classifier(frames, views, pretrained(), params, CPU, **checkpoint)


def equal_weights(module, other):
    """Return whether two modules have equal weights and moments, bit by bit."""
    pairs = zip(module.state_dict().values(), other.state_dict().values(), strict=True)
    return all(torch.equal(of_module, of_other) for of_module, of_other in pairs)
