"""The command line `tactile-viewgcn`."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tactile_viewgcn.params import preset_changes, presets
from tactile_viewgcn.readers.formats import ARRAYS, HDF5, STAG_METADATA, TEXTS
from tests.readers.files import save

ROOT = Path(__file__).parents[1]


def call(*words, cwd=ROOT):
    command = [sys.executable, "-m", "tactile_viewgcn", *map(str, words)]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


def refused(result):
    """Return the one line of a refused command."""
    assert result.returncode == 1 and len(result.stderr.splitlines()) == 1, result.stderr
    return result.stderr


def glove(folder, *names, number=2, shape=(20, 4, 4)):
    """Return a folder of arrays with `number` recordings of each object."""
    rng = np.random.default_rng(0)
    for name in names:
        for recording in range(number):
            counts = rng.integers(500, 530, shape, dtype=np.int16)
            save(folder / name / f"{recording}.npy", counts)
    return folder


def test_inspect_takes_the_folder_that_it_is_called_in_and_hands_the_layout_on_to_the_command(
    tmp_path,
):
    source = glove(tmp_path / "glove", "mug", "pen", shape=(20, 16))
    unshaped = call("inspect", ".", cwd=source).stdout
    assert {f"data.source={source}", "data.shape=auto"} <= set(unshaped.split())
    assert "`--shape 4 4`" in unshaped
    shaped = call("inspect", ".", "--shape", 4, 4, cwd=source).stdout
    assert {f"data.source={source}", "'data.shape=[4,4]'"} <= set(shaped.split())
    assert "`--shape 4 4`" not in shaped
    assert "`dvc exp run -S split.folds=2`" in refused(
        call("inspect", source, "--set", "split.folds=2")
    )


def test_inspect_help_names_every_format_that_is_read():
    words = call("inspect", "--help").stdout.replace("(", " ").replace(")", " ").replace(",", " ")
    words = {word.strip(".,") for word in words.split()}
    assert {ending.strip(".") for ending in TEXTS + HDF5 + ARRAYS} <= words
    assert {STAG_METADATA, "labels.csv", "catalogue"} <= words


@pytest.mark.parametrize(
    ("change", "remedy"),
    [
        ("preproces.baseline=grasp", "did you mean preprocess?"),
        ("preprocess.baselin=grasp", "did you mean preprocess.baseline?"),
        ("dta.layout=auto", "did you mean data?"),
        ("finetun.lr=0.1", "did you mean finetune?"),
        ("finetune.lrr=0.1", "did you mean finetune.lr?"),
        ("view=4", "did you mean views?"),
        ("split.by=grap", "did you mean grasp?"),
    ],
)
def test_a_misspelt_change_is_answered_by_the_nearest_key_and_not_repeated_in_another_command(
    tmp_path, change, remedy
):
    source = glove(tmp_path / "glove", "mug", "pen")
    for command in (["inspect", source], ["predict", "model.pt", source]):
        line = refused(call(*command, "--set", change))
        assert remedy in line and "dvc exp run" not in line


@pytest.mark.parametrize("name", ["released", "bset", ""])
def test_preset_prints_options_of_dvc_and_one_that_dvc_refuses_for_an_unknown_name(name):
    result = call("preset", name)
    if name in presets():
        words = result.stdout.split()
        assert words[::2] == ["-S"] * (len(words) // 2) and words[1::2] == preset_changes(name)
        return
    assert result.stdout == f"-S no-such-preset={name}\n"
    remedy = "did you mean best?" if name else "expected one of best, "
    assert remedy in refused(result)
    command = [sys.executable, "-m", "dvc", "exp", "run", "--dry", *result.stdout.split()]
    done = subprocess.run(command, cwd=ROOT, capture_output=True)
    assert done.returncode and b"no-such-preset" in done.stderr


def test_a_command_that_needs_a_missing_library_names_the_extra_in_one_line():
    program = (
        "import sys; sys.modules |= {'dvc': None, 'mlflow': None}\n"
        "sys.argv = ['tactile-viewgcn', 'report', 'exp-1']\n"
        "from tactile_viewgcn.cli import main; main()"
    )
    result = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert "pip install 'tactile-viewgcn[pipeline]'" in refused(result)


def test_control_characters_of_names_reach_neither_a_terminal_nor_a_page(tmp_path):
    source = glove(tmp_path / "l\u202ea\udcffb", "m\x1b[31mu\ng", "p\u202een", number=3)
    result = call("inspect", source, "--html", tmp_path / "page.html")
    assert result.returncode == 0, result.stderr
    for text in (result.stdout, (tmp_path / "page.html").read_text()):
        assert r"m\x1b[31mu\ng" in text and r"p\u202een" in text
        assert all(line.isprintable() for line in text.replace("\xa0", "").splitlines())


#: The command gets the signal in the moment in which its temporary table is read
ENDED = """
import os, signal
from tactile_viewgcn.cli import main
from tactile_viewgcn.tables.recordings import Recordings

def read(path):
    print(path.name, "are there" if path.exists() else "are not there", flush=True)
    os.kill(os.getpid(), signal.SIGTERM)
    raise AssertionError("the command goes on after SIGTERM")

Recordings.read = read
main()
"""


def test_a_command_that_is_ended_leaves_no_temporary_folder(tmp_path):
    place = tmp_path / "temporary"
    place.mkdir()
    source = glove(tmp_path / "lab", "mug", "pen")
    environment = os.environ | {"PYTHONPATH": str(ROOT), "TMPDIR": str(place)}
    command = [sys.executable, "-c", ENDED, "inspect", str(source)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (143, "recordings are there\n"), done.stderr
    assert list(place.iterdir()) == []
