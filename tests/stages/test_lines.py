"""The lines that the product prints, run as printed, in one clone for several gloves in turn."""

import csv
import re
import shlex

import numpy as np
import pytest

from tactile_viewgcn.recognition.recogniser import Recogniser
from tests.readers.files import save
from tests.stages.running import commit, copy_repository, sh

# MLflow's own warnings
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]
SESSIONS, REPEATS = 2, 3


def recordings(objects, shape, frames=30):
    """Yield object, session, number and counts (frames, *shape) of easily told recordings."""
    rng = np.random.default_rng(0)
    patterns = {name: 90 * (rng.random(shape) < 0.5) for name in objects}
    rise = np.clip(np.linspace(-0.5, 1, frames), 0, 1).reshape(-1, *[1] * len(shape))
    for name, session, number in (
        (n, s, r) for n in objects for s in range(SESSIONS) for r in range(REPEATS)
    ):
        counts = (
            500 + rise * patterns[name] * rng.uniform(0.7, 1.3) + rng.normal(0, 1, (frames, *shape))
        )
        yield name, f"day{session}", number, counts.round().astype(np.int16)


def flat_arrays(place):
    """Write arrays (frames, 48) whose names begin with the object, which the lines have to say."""
    for name, session, number, counts in recordings(("cup", "pen", "tin"), (48,)):
        save(place / f"{name}_{session}{number}.npy", counts)
    return ["--shape", "6", "8", "--set", "data.layout=OBJECT_FILE"]


def table(place):
    """Write one table of four channels, with a column for the session."""
    place.mkdir()
    with (place / "all.csv").open("w", newline="") as file:
        csv.writer(file).writerow(
            ["object", "session", "recording", "thumb", "index", "middle", "palm"]
        )
        for name, session, number, counts in recordings(("fist", "flat", "point", "spread"), (4,)):
            csv.writer(file).writerows(
                [name, session, f"{name}{session}{number}", *row] for row in counts.tolist()
            )
    return []


def folders(place):
    """Write arrays (frames, 6, 8) into a folder for each session and object."""
    for name, session, number, counts in recordings(("ball", "mug"), (6, 8)):
        save(place / session / name / f"{number}.npy", counts)
    return []


GLOVES = {
    flat_arrays: ((6, 8), {"cup", "pen", "tin"}),
    table: ((1, 4), {"fist", "flat", "point", "spread"}),
    folders: ((6, 8), {"ball", "mug"}),
}


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    place = tmp_path_factory.mktemp("lines") / "clone"
    copy_repository(place)
    commit(place)
    return place


def run(line, place):
    """Run a line as a shell takes it."""
    return sh("bash", "-c", line, cwd=place, MLFLOW_TRACKING_URI="disabled", PYTHONPATH=str(place))


def printed(text):
    """Return the first command of an inspection that trains, with its continued lines."""
    return re.search(r"^dvc exp run (?:.*\\\n)*.*", text, re.MULTILINE)[0]


def test_printed_lines_of_three_gloves_run_one_after_the_other(clone):
    lines = {}
    for write in GLOVES:
        source = clone.parent / write.__name__
        lines[source] = printed(
            run(shlex.join(["tactile-viewgcn", "inspect", str(source), *write(source)]), clone)
        )
    for (source, line), (shape, objects) in zip(lines.items(), GLOVES.values(), strict=True):
        run(line, clone)
        run("tactile-viewgcn report", clone)
        page = (clone / "report.html").read_text()
        assert (
            all(name in page for name in objects)
            and "tactile-viewgcn predict models/classifier.pt" in page
        )
        recogniser = Recogniser(clone / "models" / "classifier.pt")
        assert (recogniser.shape, set(recogniser.classes) - {"empty_hand"}) == (shape, objects)
        form = "--set data.layout=OBJECT_FILE" if source.name == "flat_arrays" else ""
        assert "right: " in run(
            f"tactile-viewgcn predict models/classifier.pt {source} {form}", clone
        )


def test_files_of_a_run_on_own_data_are_applied_pushed_and_pulled_where_nobody_has_simulated(
    clone, tmp_path
):
    folders(source := tmp_path / "own")
    run(
        printed(run(f"tactile-viewgcn inspect {source}", clone)).replace(
            "exp run", "exp run --temp --name own"
        ),
        clone,
    )
    (clone / "models" / "classifier.pt").unlink(missing_ok=True)
    run("dvc exp apply own && dvc exp branch own of_own", clone)
    assert set(Recogniser(clone / "models" / "classifier.pt").classes) == {"ball", "mug"}
    run(
        f"dvc remote add -d here {tmp_path}/remote && dvc push && git add -A && git commit -qm own",
        clone,
    )
    run(f"git clone -q {clone} second && cd second && dvc pull", tmp_path)
    files = [place / "models" / "classifier.pt" for place in (clone, tmp_path / "second")]
    assert files[0].read_bytes() == files[1].read_bytes()
    assert not list(tmp_path.glob("second/data/virtual/recordings*"))
