"""The lock and the constraints pin all that pyproject.toml asks for, and name no index."""

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
NAME = "tactile-viewgcn"
PYTHONS = ("3.11", "3.12", "3.13")


def requirements_of(pyproject):
    """Return the requirements of the dependencies and of every extra.

    Requirements of the project itself, which name its own extras, are left out.
    """
    project = tomllib.loads(pyproject)["project"]
    texts = [*project["dependencies"]]
    for extra in project["optional-dependencies"].values():
        texts += extra
    requirements = [Requirement(text) for text in texts]
    return [requirement for requirement in requirements if requirement.name != NAME]


def pins(text):
    """Return the requirement and the hashes of each package of a lock."""
    entries = []
    for line in text.replace("\\\n", "").splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            requirement, *hashes = line.split("--hash=")
            entries.append((Requirement(requirement), [text.strip() for text in hashes]))
    return entries


def unmet(pyproject, lock):
    """Return what pyproject.toml asks for and the lock does not pin on each Python, and why."""
    reasons = []
    entries = [requirement for requirement, _ in pins(lock)]
    for wanted in requirements_of(pyproject):
        for python in PYTHONS:
            here = {"python_version": python, "python_full_version": f"{python}.0"}
            versions = []
            for pin in entries:
                same = canonicalize_name(pin.name) == canonicalize_name(wanted.name)
                if same and (pin.marker is None or pin.marker.evaluate(here)):
                    versions += [specifier.version for specifier in pin.specifier]
            if len(versions) != 1:
                reasons.append(f"{wanted.name}: {len(versions)} pins on Python {python}")
            elif versions[0] not in wanted.specifier:
                reasons.append(f"{wanted.name}: {versions[0]} is not {wanted.specifier}")
    return reasons


@pytest.mark.parametrize("name", ["requirements.lock", "constraints.txt"])
def test_every_dependency_and_extra_has_one_version_that_it_allows_on_each_python(name):
    pyproject = (ROOT / "pyproject.toml").read_text()
    assert len(requirements_of(pyproject)) > 20
    assert unmet(pyproject, (ROOT / name).read_text()) == [], "run .ci/lock"


def test_a_lock_that_lacks_a_package_or_is_too_old_is_noticed():
    pyproject = """
        [project]
        dependencies = ["numpy>=2.0", "PyYAML>=6"]
        [project.optional-dependencies]
        test = ["tactile-viewgcn[all]", "pytest>=8"]
    """
    lock = (
        "numpy==1.26.4\npyyaml==6.0.1 ; python_version < '3.13'\npytest==8.0 \\\n    --hash=a:b\n"
    )
    old = "numpy: 1.26.4 is not >=2.0"
    assert unmet(pyproject, lock) == [old, old, old, "PyYAML: 0 pins on Python 3.13"]


def test_every_pin_of_the_lock_has_hashes_and_the_constraints_have_the_same_versions():
    lock = pins((ROOT / "requirements.lock").read_text())
    constraints = pins((ROOT / "constraints.txt").read_text())
    for _, hashes in lock:
        assert hashes
        for digest in hashes:
            assert re.fullmatch("sha256:[0-9a-f]{64}", digest)
    assert not any(hashes for _, hashes in constraints)
    assert [str(pin) for pin, _ in lock] == [str(pin) for pin, _ in constraints]
    assert all(re.fullmatch("==[^*]+", str(pin.specifier)) for pin, _ in lock)


@pytest.mark.parametrize("name", ["requirements.lock", "constraints.txt"])
def test_no_address_of_an_index_and_no_path_is_in_it(name):
    for line in (ROOT / name).read_text().splitlines():
        if not line.startswith("#"):
            address = re.search(
                r"://|(^|\s)(-i|-f|-e|--\S*index\S*|--find-links)\b|\s@\s|file:", line
            )
            assert address is None, line
    for pin, _ in pins((ROOT / name).read_text()):
        assert pin.url is None and not pin.extras
