"""A disk without room, in every command that writes files: one line, and no wrong file under its final name."""

import shutil
from itertools import pairwise

import pytest

from tactile_viewgcn import cli
from tests.full_disk import room_for
from tests.stages.running import FILES, SENSORS, captured, changed, run_stage

pytestmark = pytest.mark.slow  # test_files.py writes each kind of file without room
GLOVE = ("glove.objects=[ball]", "glove.sessions=2", "glove.grasps=1", "glove.grasp_frames=17")  # the smallest
NETWORK = ("model.system=mvcnn", "model.backbone.width=8", "pretrain.epochs=1")
STAGES = {
    "simulate": ("--out data/virtual", GLOVE),
    "needs": ("--out network/needs.json", NETWORK),
    **{stage: (FILES[stage], ()) for stage in ("ingest", "preprocess", "cluster", "evaluate")},
    "pretrain": ("--needs network/needs.json --frames data/frames --out network/backbone.pt", NETWORK),
    "finetune": (
        "--frames data/frames --views data/views --backbone network/backbone.pt --out network/classifier.pt",
        NETWORK,
    ),
}
PAGES = {"report": "report --out report.html", "inspect": "inspect data/virtual --html inspection.html"}


def words_of(name):
    """A command's words, and the paths of what it writes."""
    if name in PAGES:
        words = PAGES[name].split()
    else:
        files, changes = STAGES[name]
        words = [*files.split(), "--record", f"records/{name}.json", *changed(*SENSORS, *changes)]
    return words, [path for option, path in pairwise(words) if option in ("--out", "--kept", "--record", "--html")]


def run(name, place):
    words, _ = words_of(name)
    return captured(cli.main, *words, cwd=place) if name in PAGES else run_stage(name, *words, cwd=place)


def contents(outputs):
    """The bytes of each file among the outputs or below them."""
    files = [file for path in outputs for file in (path, *path.rglob("*")) if file.is_file()]
    return {file: file.read_bytes() for file in files}


@pytest.fixture(scope="module")
def complete(finished, tmp_path_factory):
    """The workspace of a finished run, with simulated recordings and a trained network too."""
    place = tmp_path_factory.mktemp("complete")
    shutil.copytree(finished, place, dirs_exist_ok=True)
    for name in (*STAGES, *PAGES):
        result = run(name, place)
        assert result.returncode == 0, result.stderr
    return place


@pytest.mark.parametrize("short", [1, 64], ids="{} KB short".format)
@pytest.mark.parametrize("name", [*STAGES, *PAGES])
def test_a_command_without_room_ends_in_one_line_and_leaves_no_wrong_file(complete, tmp_path, name, short):
    place = tmp_path / "place"
    shutil.copytree(complete, place)
    outputs = [place / path for path in words_of(name)[1]]
    right = contents(outputs)
    for file in right:
        file.unlink()
    with room_for(max(map(len, right.values())) - 1024 * short):
        result = run(name, place)
    *before, line = result.stderr.splitlines()
    assert result.returncode == 1 and line.startswith("Error: "), result.stderr
    assert [text for text in before if f"{name}: epoch " not in text] == []
    assert f"{name}: " not in result.stdout and "open it" not in result.stdout
    assert not (place / "records" / f"{name}.json").exists() and list(place.rglob("*.unfinished")) == []
    times = {"timing.json", "summary.json"}
    assert [file for file, read in contents(outputs).items() if read != right[file] and file.name not in times] == []
