"""The lock pins every package exactly, agrees with pyproject.toml, and names no address."""

import tomllib
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCK = [line for line in (ROOT / "requirements.lock").read_text().splitlines() if line]
INSTALLED_EXTRAS = [name for name in PROJECT["optional-dependencies"] if name != "peers"]
WANTED = PROJECT["dependencies"] + [
    text for name in INSTALLED_EXTRAS for text in PROJECT["optional-dependencies"][name]
]


def pinned(python: str) -> dict[str, str]:
    """Package -> version that the lock gives one Python on Linux."""
    environment = default_environment() | {"python_version": python, "python_full_version": f"{python}.0"}
    requirements = [Requirement(line) for line in LOCK]
    chosen = [item for item in requirements if item.marker is None or item.marker.evaluate(environment)]
    return {canonicalize_name(item.name): next(iter(item.specifier)).version for item in chosen}


def test_every_line_pins_one_exact_version_and_no_address():
    for line in LOCK:
        requirement = Requirement(line)
        assert requirement.url is None and "://" not in line and not line.startswith("-"), line
        assert [specifier.operator for specifier in requirement.specifier] == ["=="], line


@pytest.mark.parametrize("python", ["3.11", "3.12", "3.13", "3.14"])
@pytest.mark.parametrize("wanted", WANTED)
def test_the_lock_satisfies_the_project(wanted, python):
    requirement = Requirement(wanted)
    versions = pinned(python)
    name = canonicalize_name(requirement.name)
    assert name in versions, f"{name} is wanted by pyproject.toml but missing in requirements.lock"
    assert requirement.specifier.contains(versions[name]), f"{wanted}: the lock has {versions[name]}"
