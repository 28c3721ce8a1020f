"""The wheel, installed outside of the clone, has everything that it needs.

The class and the command find their files, and a user's mypy finds the types.
"""

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from tests.glove_data import FOREIGN_NAMES, ROOT, floats

PROGRAM = """
import sys
sys.modules |= {"dvc": None, "mlflow": None, "psutil": None}
import tactile_viewgcn
assert "torch" not in sys.modules
from tactile_viewgcn import TactileClassifier
X = []
for sign in (1, -1, 1.1, -1.2):
    X.append([[sign * frame] for frame in range(9)])
fitted = TactileClassifier(preset="best", system="svm").fit(X, [1, 2, 1, 2])
print(tactile_viewgcn.__file__, fitted.predict(X[:2]))
from tactile_viewgcn.cli import cli
cli(["inspect", "glove", "--html", "page.html"])
"""
USER_PROGRAM = Path(__file__).with_name("user_program.py")
PRINTED = """\
predicted 1 2 1 2
loaded 1 2 1 2
refused random
last update final 1 9
refused seconds
answered first
files 16 recordings 16
refused FileNotFoundError
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Return a folder of packages that holds only the wheel of the committed files."""
    place = tmp_path_factory.mktemp("wheel")
    pip = [sys.executable, "-m", "pip"]
    options = ["--quiet", "--disable-pip-version-check", "--no-deps"]
    address = f"tactile-viewgcn @ git+file://localhost{ROOT}"
    build = [*pip, "wheel", *options, "--no-build-isolation", "--wheel-dir=.", address]
    subprocess.run(build, cwd=place, check=True)
    (wheel,) = place.glob("*.whl")
    subprocess.run([*pip, "install", *options, "--target=site", wheel], cwd=place, check=True)
    return place / "site"


def run(*words, cwd, site):
    """Run a Python program that finds the installed copy, and no program of this machine."""
    return subprocess.run(
        [sys.executable, *words],
        cwd=cwd,
        env={"PYTHONPATH": str(site), "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_copy_outside_the_clone_trains_and_inspects_without_dvc_and_mlflow(site, tmp_path):
    floats(tmp_path / "glove")
    result = run("-c", PROGRAM, cwd=tmp_path, site=site)
    assert result.returncode == 0, result.stderr
    place, _, answers = result.stdout.splitlines()[0].partition(" ")
    assert place.startswith(str(site)) and answers == "[1 2]"
    assert all(name in (tmp_path / "page.html").read_text() for name in FOREIGN_NAMES)


def test_the_citation_names_the_version_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == project["version"]


@pytest.mark.slow
def test_a_users_program_runs_and_mypy_knows_its_types(site, tmp_path):
    floats(tmp_path / "glove")
    shutil.copy(USER_PROGRAM, tmp_path / "program.py")
    result = run("program.py", cwd=tmp_path, site=site)
    assert result.returncode == 0 and result.stdout == PRINTED, result.stderr

    strict = ("-m", "mypy", "--strict", f"--config-file={os.devnull}")
    checked = run(*strict, "program.py", cwd=tmp_path, site=site)
    assert checked.stdout == "Success: no issues found in 1 source file\n", checked.stdout

    # what the checks above rest on: without types there are mistakes
    untyped = tmp_path / "untyped"
    shutil.copytree(site, untyped)
    (untyped / "tactile_viewgcn" / "py.typed").unlink()
    checked = run(*strict, "program.py", cwd=tmp_path, site=untyped)
    assert "missing library stubs or py.typed marker" in checked.stdout
    assert 'Expression is of type "Any", not "list[str]"' in checked.stdout
