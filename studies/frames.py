"""Frames as a study needs them: validation groups in the place of the test side, less to learn from, leaking sides."""

from dataclasses import replace

import click
import numpy as np

from stages.command import INPUT, OUTPUT, stage
from tactile_viewgcn.frames import Frames, write_frames
from tactile_viewgcn.params import Preprocess, Split
from tactile_viewgcn.preprocessing import prepare
from tactile_viewgcn.randomness import stream
from tactile_viewgcn.recordings import Recordings
from tactile_viewgcn.split import TEST, TRAIN, VALIDATION, balanced_anchors

VALIDATION_SHARE = 0.5  # of the training groups, where the parameters leave none
UNUSED = -1  # a side


@stage("preprocess", "split")
@click.option("--recordings", type=INPUT, required=True)
@click.option("--side", type=click.Choice(["test", "validation"]), default="test", help="What becomes the test side.")
@click.option(
    "--share", type=click.FloatRange(0, 1, min_open=True), default=1.0, help="Of each training group's frames."
)
@click.option("--hold-out", type=click.Choice(["frame", "recording", "grasp", "session"]), help="In place of split.by.")
@click.option("--out", type=OUTPUT, required=True)
def frames(params, run, recordings, side, share, hold_out, out):
    """Prepare the frames of a study."""
    split = params.split
    if side == "validation":
        split = replace(split, validation=split.validation or VALIDATION_SHARE)
    if hold_out:  # nothing is held out beside, so that every way learns from as much
        split = replace(split, by=split.by if hold_out == "frame" else hold_out, validation=0.0)
    with Recordings(recordings) as table:
        found = prepare(table, params.preprocess, split, stream(split.seed, "preprocess"))[0]
    if side == "validation":
        found = validated(found)
    if hold_out == "frame":
        found = at_random(found, params.preprocess, split)
    write_frames(out, shortened(found, share))
    sides = {name: len(found.on(code)) for name, code in (("train", TRAIN), ("test", TEST))}
    print(f"frames: {sides['train']:,} to learn from, {sides['test']:,} to test on, {len(found.classes)} classes")


def validated(table: Frames) -> Frames:
    """The validation groups in the place of the test side, which is left out."""
    side = np.where(table.side == VALIDATION, TEST, np.where(table.side == TEST, UNUSED, table.side))
    return replace(table, side=side.astype(table.side.dtype))


def at_random(table: Frames, how: Preprocess, split: Split) -> Frames:
    """Sides that leak: of each class one frame in `folds`, at random, is tested on, its neighbours in time are not."""
    rng, side = stream(split.seed, "study.leak"), np.full_like(table.side, TRAIN)
    for label in range(len(table.classes)):
        own = rng.permutation(np.flatnonzero(table.label == label))
        side[own[split.fold :: split.folds]] = TEST
    anchor, _ = balanced_anchors(table.label, side, minimum=how.balance_minimum, rng=rng)
    return replace(table, side=side, anchor=anchor)


def shortened(table: Frames, share: float) -> Frames:
    """Only the first share of each training group's frames of a class: of a recording, its beginning."""
    side, anchor = table.side.copy(), table.anchor.copy()
    for group, label in {*zip(table.group.tolist(), table.label.tolist(), strict=True)}:
        own = np.flatnonzero((table.group == group) & (table.label == label) & (table.side == TRAIN))
        late = own[max(1, round(share * len(own))) :]
        side[late], anchor[late] = UNUSED, False
    return replace(table, side=side, anchor=anchor)


if __name__ == "__main__":
    frames()
