"""Draw docs/answer.png: frames of one simulated test recording, and what the classifier answers.

Run it after `dvc repro`, from the root of the repository: python docs/answer_picture.py
"""

from pathlib import Path

import h5py
import matplotlib
import numpy as np

from tactile_viewgcn import TactileClassifier

RECORDING = Path("data/virtual/recordings/003/016-mug.h5")
CLASSIFIER = Path("models/classifier.pt")
FRAMES = 8
ANSWERS = 5
OPEN_HAND = 8  # frames at the beginning of a simulated recording
BLUE = "#2a6f97"
GREY = "#a9b4bc"


def main() -> None:
    """Draw the picture."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with h5py.File(RECORDING) as file:
        counts = file["pressure"][:]  # (T, 32, 32)
        valid = file["valid"][:]
        truth = file.attrs["object"]
    classifier = TactileClassifier.load(CLASSIFIER)
    (probabilities,) = classifier.predict_proba([counts])
    best = np.argsort(-probabilities)[:ANSWERS]
    pressure = counts[valid.astype(bool)] - counts[:OPEN_HAND].mean(axis=0)
    chosen = pressure[np.linspace(0, len(pressure) - 1, FRAMES).round().astype(int)]

    figure = plt.figure(figsize=(10, 3.2), dpi=110, layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=[1.7, 1])
    for axes, frame in zip(left.subplots(2, FRAMES // 2).flat, chosen, strict=True):
        axes.imshow(frame, cmap="magma", vmin=0, vmax=40)
        axes.set_axis_off()
    left.suptitle("eight pressure frames of one recording", fontsize=11)
    axes = right.subplots()
    names = [str(name).replace("_", " ") for name in classifier.classes_[best]]
    colours = [BLUE if classifier.classes_[index] == truth else GREY for index in best]
    bars = axes.barh(names, 100 * probabilities[best], color=colours)
    axes.bar_label(bars, fmt="%.0f %%", padding=3)
    axes.invert_yaxis()
    axes.set_xlim(0, 100)
    axes.set_xlabel("probability, %")
    axes.spines[["top", "right"]].set_visible(False)
    right.suptitle("the answer", fontsize=11)
    figure.savefig(Path(__file__).with_name("answer.png"))


if __name__ == "__main__":
    main()
