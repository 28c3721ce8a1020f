"""Where a study's best arm and its reference go wrong: confusion, and the objects most often mistaken for each other.

The paper's section on failure cases, for the data at hand.
"""

import click
import numpy as np
from matplotlib.figure import Figure

from stages.command import INPUT, OUTPUT, stage
from studies.arms import read_arms
from studies.pooling import Pooled, pooled
from studies.results import named, write_table
from tactile_viewgcn.files import whole
from tactile_viewgcn.frames import Frames, read_frames
from tactile_viewgcn.split import TEST

PAIRS = 6


@stage("data")
@click.option("--arms", "folders", type=INPUT, required=True, multiple=True, help="Folder of trained arms.")
@click.option(
    "--frames", type=INPUT, required=True, multiple=True, help="What they were tested on, or the folder of each fold's."
)
@click.option("--reference", required=True, help="The arm whose confusion is drawn beside the best one's.")
@click.option("--out", type=OUTPUT, required=True, help="Folder of confusion.png, pairs.png, pairs.csv and pairs.md.")
def failures(params, run, folders, frames, reference, out):
    """Draw the confusion of the best arm and of the reference, and the pairs of objects confused most."""
    source, arms = named(params.data), pooled(read_arms(folders))
    protocol = list(arms[0].predicted)[-1]  # recording, where it was tested
    best = min(arms, key=lambda arm: arm.error(protocol))
    shown = [best, *(arm for arm in arms if arm.name == reference and arm is not best)]
    tables = [path for given in frames for path in (sorted(given.glob("*.h5")) if given.is_dir() else [given])]
    means, live = mean_frames([read_frames(path) for path in tables], best.classes)
    pairs = confused_pairs(best.confusion(protocol), best.classes)
    text = f"{source}. The objects that `{best.name}` takes for each other most, {protocol} protocol."
    write_table(out, pairs, text, name="pairs")
    figures = {
        "confusion.png": confusions(shown, protocol, f"{source}, {protocol} protocol"),
        "pairs.png": side_by_side(
            pairs, best.classes, means, live, f"{source}: mean frames of the pairs that {best.name} confuses most"
        ),
    }
    for name, figure in figures.items():
        with whole(out / name) as part:
            figure.savefig(part, format="png", dpi=90)
        run.artifact(out / name)


def confused_pairs(table: np.ndarray, classes: list[str]) -> list[dict]:
    """The pairs with the highest share of the view sets of either object that were taken for the other."""
    both = table.sum(axis=1)
    wrong = table + table.T
    share = wrong / np.maximum(both[:, None] + both, 1)
    first, second = np.triu_indices(len(classes), k=1)
    order = np.argsort(-share[first, second], kind="stable")[:PAIRS]
    return [
        {
            "object": classes[first[i]],
            "and": classes[second[i]],
            "taken for each other, %": 100 * float(share[first[i], second[i]]),
            "first for second, %": 100 * float(table[first[i], second[i]] / max(1, both[first[i]])),
            "second for first, %": 100 * float(table[second[i], first[i]] / max(1, both[second[i]])),
        }
        for i in order
    ]


def mean_frames(tables: list[Frames], classes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Mean network input (C, H, W) of each class over the test sides, and the live sensors (H, W)."""
    total, count = np.zeros((len(classes), *tables[0].live.shape)), np.zeros(len(classes))
    for table in tables:
        for label, name in enumerate(table.classes):
            index = np.flatnonzero((table.side == TEST) & (table.label == label))
            if len(index):
                total[classes.index(name)] += table.inputs(index).sum(axis=0)
                count[classes.index(name)] += len(index)
    return total / np.maximum(count, 1)[:, None, None], tables[0].live


def confusions(arms: list[Pooled], protocol: str, title: str) -> Figure:
    """Shares of each object's view sets, a matrix for each arm."""
    classes = arms[0].classes
    figure = Figure(figsize=(7.5 * len(arms) + 1, 7.5), layout="constrained")
    for axes, arm in zip(figure.subplots(1, len(arms), squeeze=False)[0], arms, strict=True):
        table = arm.confusion(protocol)
        image = axes.imshow(table / np.maximum(table.sum(axis=1, keepdims=True), 1), vmin=0, vmax=1, cmap="Blues")
        axes.set_xticks(range(len(classes)), classes, rotation=90, fontsize=7)
        axes.set_yticks(range(len(classes)), classes, fontsize=7)
        axes.set(xlabel="answered", ylabel="held", title=f"{arm.name}: error {100 * arm.error(protocol):.1f} %")
    figure.colorbar(image, ax=figure.axes, label="share of the object's view sets", shrink=0.7)
    figure.suptitle(title)
    return figure


def side_by_side(pairs: list[dict], classes: list[str], means: np.ndarray, live: np.ndarray, title: str) -> Figure:
    """The two mean frames of each pair, a column each."""
    columns = max(1, len(pairs))
    figure = Figure(figsize=(2.2 * columns, 5.2), layout="constrained")
    panels = figure.subplots(2, columns, squeeze=False)
    top = float(max((np.percentile(means[:, live], 99.5)), 1e-6))
    for axes in panels.ravel():
        axes.set_axis_off()
    for column, pair in enumerate(pairs):
        for axes, name in zip(panels[:, column], (pair["object"], pair["and"]), strict=True):
            axes.imshow(np.where(live, means[classes.index(name)], np.nan), vmin=0, vmax=top, cmap="viridis")
            axes.set_title(name, fontsize=9)
        panels[1, column].text(
            0.5, -0.08, f"{pair['taken for each other, %']:.0f} %", transform=panels[1, column].transAxes, ha="center"
        )
    figure.suptitle(title)
    return figure


if __name__ == "__main__":
    failures()
