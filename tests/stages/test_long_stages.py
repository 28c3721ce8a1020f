"""A long stage says how far it is, and about how long it still takes.

The tests set its clock.
"""

import re
import shutil
from itertools import count

import pytest

from tactile_viewgcn.tables.frames import save_table
from tests.glove_data import SMALL, fewer_anchors, table
from tests.stages.running import FILES, SENSORS, changed, record_of, run_stage, set_params

GLOVE = {"objects": ["ball"], "sessions": 2, "grasps": 1, "grasp_frames": 17}  # the smallest
STEP = re.compile(r"(\w[\w /,-]*): ([\d,]+) of ([\d,]+) ([\w ]+)")


def said(stage, *words, cwd) -> dict[str, set[str]]:
    """Return the totals and units in the messages about each step of a stage.

    A minute passes whenever the stage looks at the clock.
    """
    minutes = count(step=60.0)
    result = run_stage(stage, *words, cwd=cwd, clock=lambda: next(minutes))
    assert result.returncode == 0, result.stderr
    numbers: dict[str, set[str]] = {}
    for line in result.stderr.splitlines():
        assert line.startswith(f"{stage}: ") and line.isprintable()
        for step, done, total, units in STEP.findall(line):
            assert int(done.replace(",", "")) <= int(total.replace(",", ""))
            numbers.setdefault(step, set()).add(f"{total} {units}")
    assert "s left" in result.stderr
    return numbers


def test_a_simulation_counts_its_frames(folder):
    set_params(folder, "glove", **GLOVE)
    words = ("--out", "made", "--record", "made.json")
    assert said("simulate", *words, cwd=folder) == {"frames of this process": {"100 frames"}}


@pytest.mark.parametrize(
    ("stage", "steps"),
    [
        ("preprocess", {"writing": {"1 blocks of frames"}}),
        (
            "finetune",
            {"kernel, groups held out": {"4 folds"}, "fits of whole recordings": {"1 members"}},
        ),
        ("evaluate", {"object protocol": {"3 trials"}, "recording protocol": {"3 trials"}}),
    ],
)
def test_a_stage_on_the_sensors_counts_its_steps(finished, tmp_path, stage, steps):
    folder = tmp_path / "workspace"
    shutil.copytree(finished, folder)
    words = (*FILES[stage].split(), "--record", record_of(stage), *changed(*SENSORS))
    numbers = said(stage, *words, cwd=folder)
    assert {step: numbers.get(step) for step in steps} == steps, numbers
    if stage == "evaluate":
        assert "frames" in numbers and "k-means" in numbers


def test_stages_of_a_network_count_pools_and_batches(folder):
    save_table(folder / "frames", fewer_anchors(table(), 4))
    settings = changed(
        *SMALL, "device=cpu", "precision=float32", "pretrain.epochs=2", "model.system=mean"
    )
    assert run_stage("needs", "--out", "needs.json", cwd=folder).returncode == 0
    words = ("--needs", "needs.json", "--frames", "frames", *settings)
    assert said("cluster", *words, "--out", "views", cwd=folder)["k-means"] == {"4 pools"}
    numbers = said("pretrain", *words, "--out", "backbone.pt", cwd=folder)
    assert any(step.startswith("pretrain epoch 2") for step in numbers), numbers
