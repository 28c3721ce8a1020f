"""Pictures: matplotlib figures, made where somebody keeps them."""

import numpy as np
from matplotlib.figure import Figure

GAP = 1  # blank cells between the frames of a mosaic
WIDEST = 40  # inches


def confusions(counts: dict[str, np.ndarray], classes: list[str]) -> Figure:
    """Counts (C, C) by their panel's title, rows the true class, drawn side by side as shares of each row."""
    side = 2 + 0.28 * len(classes)
    figure = Figure(figsize=(1 + side * len(counts), side), layout="constrained")
    panels = figure.subplots(1, len(counts), sharey=True, squeeze=False)[0]
    for axes, (title, table) in zip(panels, counts.items(), strict=True):
        shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
        image = axes.imshow(shares, vmin=0, vmax=1, cmap="Blues")
        axes.set_xticks(range(len(classes)), classes, rotation=90, fontsize=8)
        axes.set_yticks(range(len(classes)), classes, fontsize=8)
        axes.set(xlabel="predicted", title=title)
    panels[0].set_ylabel("held")
    figure.colorbar(image, ax=panels, label="share of the object's view sets", shrink=0.8)
    return figure


def cluster_means(means: np.ndarray, live: np.ndarray, classes: list[str]) -> Figure:
    """Mean network input of each cluster (C, V, H, W), a row per class, drawn on the sensors' layout."""
    count, views, height, width = means.shape
    mosaic = np.full((count * (height + GAP), views * (width + GAP)), np.nan)
    for row in range(count):
        for column in range(views):
            top, left = row * (height + GAP), column * (width + GAP)
            mosaic[top : top + height, left : left + width] = np.where(live, means[row, column], np.nan)
    figure = Figure(figsize=(2 + min(0.8 * views, WIDEST), 1 + 0.8 * count), layout="compressed")
    axes = figure.add_subplot()
    image = axes.imshow(mosaic, cmap="viridis", vmin=0, vmax=np.nanpercentile(mosaic, 99.5) or 1)
    axes.set_yticks(np.arange(count) * (height + GAP) + height / 2, classes, fontsize=8)
    axes.set_xticks(np.arange(views) * (width + GAP) + width / 2, [str(column) for column in range(views)])
    axes.set(xlabel="cluster = viewpoint", title="mean frame of each cluster, training side")
    figure.colorbar(image, label="network input", shrink=0.4)
    return figure
