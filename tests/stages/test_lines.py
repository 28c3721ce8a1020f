"""The commands that the product prints run as printed, for several gloves in one clone."""

import csv
import re
import shlex
from itertools import product

import numpy as np
import pytest

from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.readers.files import save
from tests.stages.running import commit, copy_repository, sh

# MLflow's own warnings
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]
SESSIONS = 2
REPEATS = 3


def recordings(objects, shape, frames=30):
    """Yield the object, the session, the repeat and the counts (frames, *shape) of recordings.

    The objects press different sensors, so they are easy to tell apart.
    """
    rng = np.random.default_rng(0)
    patterns = {name: 90 * (rng.random(shape) < 0.5) for name in objects}
    rise = np.clip(np.linspace(-0.5, 1, frames), 0, 1).reshape(-1, *[1] * len(shape))
    for name, session, repeat in product(objects, range(SESSIONS), range(REPEATS)):
        signal = rise * patterns[name] * rng.uniform(0.7, 1.3)
        counts = 500 + signal + rng.normal(0, 1, (frames, *shape))
        yield name, f"day{session}", repeat, counts.round().astype(np.int16)


def flat_arrays(folder):
    """Write arrays (frames, 48) whose names begin with the object, and return the options.

    The options tell `inspect` how to read them.
    """
    for name, session, repeat, counts in recordings(("cup", "pen", "tin"), (48,)):
        save(folder / f"{name}_{session}{repeat}.npy", counts)
    return ["--shape", "6", "8", "--set", "data.layout=OBJECT_FILE"]


def table(folder):
    """Write one table of four channels, with a column for the session."""
    folder.mkdir()
    with (folder / "all.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["object", "session", "recording", "thumb", "index", "middle", "palm"])
        for name, session, repeat, counts in recordings(("fist", "flat", "point", "spread"), (4,)):
            recording = f"{name}{session}{repeat}"
            writer.writerows([name, session, recording, *row] for row in counts.tolist())
    return []


def folders(folder):
    """Write arrays (frames, 6, 8) into a folder for each session and object."""
    for name, session, repeat, counts in recordings(("ball", "mug"), (6, 8)):
        save(folder / session / name / f"{repeat}.npy", counts)
    return []


GLOVES = {
    flat_arrays: ((6, 8), {"cup", "pen", "tin"}),
    table: ((1, 4), {"fist", "flat", "point", "spread"}),
    folders: ((6, 8), {"ball", "mug"}),
}


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    repository = tmp_path_factory.mktemp("lines") / "clone"
    copy_repository(repository)
    commit(repository)
    return repository


def run(line, folder):
    """Run a line as a shell takes it."""
    return sh(
        "bash", "-c", line, cwd=folder, MLFLOW_TRACKING_URI="disabled", PYTHONPATH=str(folder)
    )


def printed(text):
    """Return the first command of an inspection that trains, with its continued lines."""
    return re.search(r"^dvc exp run (?:.*\\\n)*.*", text, re.MULTILINE)[0]


def test_printed_lines_of_three_gloves_run_one_after_the_other(clone):
    lines = {}
    for write in GLOVES:
        source = clone.parent / write.__name__
        inspect = shlex.join(["tactile-viewgcn", "inspect", str(source), *write(source)])
        lines[source] = printed(run(inspect, clone))
    for (source, line), (shape, objects) in zip(lines.items(), GLOVES.values(), strict=True):
        run(line, clone)
        run("tactile-viewgcn report", clone)
        page = (clone / "report.html").read_text()
        assert all(name in page for name in objects)
        assert "tactile-viewgcn predict models/classifier.pt" in page
        recogniser = Recogniser(clone / "models" / "classifier.pt")
        assert (recogniser.shape, set(recogniser.classes) - {"empty_hand"}) == (shape, objects)
        predict = f"tactile-viewgcn predict models/classifier.pt {source}"
        if source.name == "flat_arrays":
            predict += " --set data.layout=OBJECT_FILE"
        assert "right: " in run(predict, clone)


def test_files_of_a_run_on_own_data_are_applied_pushed_and_pulled_where_nobody_has_simulated(
    clone, tmp_path
):
    source = tmp_path / "own"
    folders(source)
    line = printed(run(f"tactile-viewgcn inspect {source}", clone))
    run(line.replace("exp run", "exp run --temp --name own"), clone)
    (clone / "models" / "classifier.pt").unlink(missing_ok=True)
    run("dvc exp apply own && dvc exp branch own of_own", clone)
    assert set(Recogniser(clone / "models" / "classifier.pt").classes) == {"ball", "mug"}
    run(f"dvc remote add -d here {tmp_path}/remote && dvc push", clone)
    run("git add -A && git commit -qm own", clone)
    run(f"git clone -q {clone} second && cd second && dvc pull", tmp_path)
    pulled = (tmp_path / "second" / "models" / "classifier.pt").read_bytes()
    assert pulled == (clone / "models" / "classifier.pt").read_bytes()
    assert not list(tmp_path.glob("second/data/virtual/recordings*"))
