"""Whether a network is trained to its end: the training losses of its last epochs, beside that of guessing."""

from dataclasses import dataclass
from math import nan

from tactile_viewgcn.provenance import Record

LEFT = 1 / 3  # ours: largest loss at the end of a finished training, as a share of guessing
FALL = 0.03  # ours: largest fall in its last epoch, likewise


@dataclass(frozen=True)
class Losses:
    """Losses of a training: means of an epoch; NaN where nothing is trained in epochs."""

    guessing: float = nan  # of the first batch, before a step
    before: float = nan  # of the epoch before the last; of one epoch that of guessing
    end: float = nan  # of the last epoch
    trained: bool = True  # whether to its end


def losses_of(pretrain: Record, finetune: Record) -> Losses:
    """The losses of fine-tuning, or of pretraining if the system is not fine-tuned."""
    record = finetune if finetune.curves else pretrain
    if not record.curves:
        return Losses()
    guessing = record.counts["loss.first"]
    before, end = [guessing, *record.curves["loss"]][-2:]
    return Losses(
        guessing, before, end, trained=end <= LEFT * guessing and before - end <= FALL * guessing
    )
