"""The install line of a notebook: a copy outside the clone has all that the class and the command
need.
"""

import subprocess
import sys
import tomllib

import yaml

from tests.glove_data import FOREIGN_NAMES, ROOT, floats

PROGRAM = """
import sys
sys.modules |= {"dvc": None, "mlflow": None, "psutil": None}
import tactile_viewgcn
assert "torch" not in sys.modules
from tactile_viewgcn import TactileClassifier
X = [[[at * sign] for at in range(9)] for sign in (1, -1, 1.1, -1.2)]
fitted = TactileClassifier(preset="best", system="svm").fit(X, [1, 2, 1, 2])
print(tactile_viewgcn.__file__, fitted.predict(X[:2]))
from tactile_viewgcn.cli import cli
cli(["inspect", "glove", "--html", "page.html"])
"""


def test_a_copy_outside_the_clone_trains_and_inspects_without_dvc_and_mlflow(tmp_path):
    options = [
        "--quiet",
        "--no-deps",
        "--no-build-isolation",
        "--disable-pip-version-check",
        "--target=site",
    ]
    address = f"tactile-viewgcn @ git+file://localhost{ROOT}"
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, address], cwd=tmp_path, check=True
    )
    floats(tmp_path / "glove")
    call = [sys.executable, "-c", PROGRAM]
    result = subprocess.run(
        call,
        cwd=tmp_path,
        env={"PYTHONPATH": "site", "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    place, _, answers = result.stdout.splitlines()[0].partition(" ")
    assert place.startswith(str(tmp_path)) and answers == "[1 2]"
    assert all(name in (tmp_path / "page.html").read_text() for name in FOREIGN_NAMES)


def test_the_citation_names_the_version_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == project["version"]
