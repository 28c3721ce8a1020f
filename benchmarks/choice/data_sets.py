"""The recordings that the choice is measured on: digits, virtual gloves, foreign ones, and STAG's where they are."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from sklearn.datasets import load_digits

from benchmarks.choice.foreign import Drawn, dense_array, finger_forces
from tactile_viewgcn.glove.recipe import LAYER, recipe_from_params
from tactile_viewgcn.glove.simulation import simulate
from tactile_viewgcn.params import Params
from tactile_viewgcn.readers.formats import open_source
from tactile_viewgcn.tables.array_recordings import ArrayRecordings
from tactile_viewgcn.tables.recordings import Recordings, write_recordings

SEED = 0  # of the foreign gloves
SINGLE = ("digits", "images")  # of one frame a recording
FEW = ["ball", "mug", "pen", "scissors", "spray_can", "stapler", "tape", "tea_box"]
SOFT = replace(LAYER, stiffness=5e6)
VIRTUAL: dict[str, dict] = {  # changes of the section `glove` of params.yaml
    "virtual_few": {"objects": FEW, "sessions": 10},
    "virtual_soft": {"sessions": 6, "grasps": 2, "seed": 1},
    "virtual": {"sessions": 6},
}
STAG = ("blindfolded_lite", "weights_lite")
SPLIT = {"weights_lite": ("grasp", 6)}  # split.by and split.folds; of the others:
BY_RECORDING = ("recording", 4)


def names() -> list[str]:
    """Of all data sets, about from the quickest to the slowest; STAG's where STAG_DATA names their folder."""
    return [*SINGLE, *VIRTUAL, *(STAG if "STAG_DATA" in os.environ else ()), "array", "fingers"]


def read(name: str, params: Params, folder: Path) -> Recordings:
    """Recordings of a data set; simulated ones and STAG's stay in the folder."""
    if name not in (*VIRTUAL, *STAG):
        arrays, labels = draw(name)
        objects = [f"object {number}" for number in range(labels.max() + 1)]
        return ArrayRecordings(arrays, objects, labels, np.zeros(len(arrays), dtype=int))
    path, source = folder / f"{name}.h5", folder / name
    if not path.exists():
        if name in VIRTUAL:
            recipe = recipe_from_params(replace(params.glove, scale="small", **VIRTUAL[name]))
            simulate(replace(recipe, layer=SOFT) if name == "virtual_soft" else recipe, source)
        else:
            source = Path(os.environ["STAG_DATA"], name, "metadata.mat")
        write_recordings(path, open_source(source), "")
    return Recordings(path)


def draw(name: str) -> Drawn:
    """scikit-learn's digits, or a foreign glove: single frames, an array of 16 x 24, five fingers."""
    rng = np.random.default_rng(SEED)
    if name == "digits":
        images, labels = load_digits(return_X_y=True)
        return list(images.astype(np.int16).reshape(-1, 1, 8, 8)), labels
    if name == "images":
        return dense_array(rng, (16, 16), objects=22, recordings=50, frames=1, levels=1000)
    if name == "array":
        return dense_array(rng, (16, 24), objects=20, recordings=12, frames=40)
    return finger_forces(rng, objects=28, recordings=45, frames=50)
