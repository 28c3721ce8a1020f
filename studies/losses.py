"""Whether a network is trained to its end, by the training losses of its last epochs."""

from dataclasses import dataclass
from math import nan

from tactile_viewgcn.provenance import Record

# our choice, as shares of the loss of an untrained network
LEFT = 1 / 3  # largest loss at the end of a finished training run
FALL = 0.03  # largest fall of the loss in its last epoch


@dataclass(frozen=True)
class Losses:
    """Losses of a training run, means of an epoch; NaN where nothing is trained in epochs.

    Attributes:
        first: loss of the first batch, before the first step, when the network is untrained.
        before: loss of the last epoch but one. If there is only one epoch, it is `first`.
        end: loss of the last epoch.
        trained: whether the network is trained to its end.
    """

    first: float = nan
    before: float = nan
    end: float = nan
    trained: bool = True


def losses_of(pretrain: Record, finetune: Record) -> Losses:
    """Return the losses of fine-tuning, or of pretraining if the system is not fine-tuned.

    Args:
        pretrain: record of the stage `pretrain`.
        finetune: record of the stage `finetune`.
    """
    record = finetune
    if not finetune.curves:
        record = pretrain
    if not record.curves:
        return Losses()
    first = record.counts["loss.first"]
    losses = [first, *record.curves["loss"]]
    before = losses[-2]
    end = losses[-1]
    is_small = end <= LEFT * first
    hardly_falls = before - end <= FALL * first
    return Losses(first, before, end, trained=is_small and hardly_falls)
