"""The arrows of the architecture: who may know whom, as the tables of docs/house.md have it, and no circles."""

import ast
import functools
import graphlib
import importlib
from pathlib import Path

import pytest

from tests.conftest import FIRST

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("jaxmm", "warp_scanner")
SCRIPTS = {"benchmarks", "paper", "tests"}
PEERS = {"torch", "open3d", "embreex", "py4dgeo", "bcf"}
FACELESS = ("warp_scanner", "warp_scanner.kernels")  # of whose files none is for users of the package as such
MOST_FILES, MOST_OF_A_ROOM, MOST_LINES = 40, 30, 350


def tables() -> dict[str, dict[str, dict[str, str]]]:
    """Package -> room -> column -> text, out of docs/house.md."""
    found, package, header = {}, None, []
    for line in (ROOT / "docs" / "house.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            package = line[3:].split(":")[0]
        cells = [cell.strip() for cell in line.strip("|").split("|")] if line.startswith("|") else []
        if cells and package in PACKAGES:
            if cells[0] == "room":
                header = cells
            elif not cells[0].startswith("---"):
                found.setdefault(package, {})[cells[0].strip("`")] = dict(zip(header, cells, strict=True))
    return found


HOUSE = tables()


def imports_of(path: Path) -> set[str]:
    """Dotted names imported anywhere in a file; `from a import b` counts as both a and a.b."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: import by the full name"
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


def files_of(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def room_of(path: Path) -> str:
    parts = path.relative_to(ROOT).parts
    return parts[1] if len(parts) > 2 else "root"


def rooms_in(names: set[str], package: str) -> set[str]:
    """The rooms of a package that some dotted names are in."""
    rooms = set()
    for name in names:
        parts = name.split(".")
        if parts[0] == package and len(parts) > 1:
            folder, file = ROOT / package / parts[1], ROOT / package / f"{parts[1]}.py"
            rooms |= {parts[1]} if folder.is_dir() else {"root"} if file.is_file() else set()
    return rooms


@pytest.mark.parametrize("package", PACKAGES)
def test_every_room_stands_in_the_table_and_every_row_is_a_room(package):
    rooms = {path.parent.name for path in (ROOT / package).glob("*/__init__.py")} - {"weights"}
    assert HOUSE[package].keys() - {"root"} == rooms


@pytest.mark.parametrize("package", PACKAGES)
def test_arrows_between_rooms_are_those_of_the_table(package):
    paths = files_of(package)
    assert paths
    seen = {room: set() for room in HOUSE[package]}
    for path in paths:
        room = room_of(path)
        if room == "weights" or path.name == "__main__.py":  # which only starts the command line
            continue
        found = rooms_in(imports_of(path), package) - {room, "weights"}
        assert found <= _allowed(package, room), f"{path}: imports {found - _allowed(package, room)}"
        seen[room] |= found
    # A row that allows what nobody does would let a new arrow in unseen.
    assert {room: found | {"root"} for room, found in seen.items()} == {
        room: _allowed(package, room) | {"root"} for room in HOUSE[package]
    }


def _allowed(package: str, room: str) -> set[str]:
    return {name.strip() for name in HOUSE[package][room]["may import"].split(",")} - {""}


@pytest.mark.parametrize("package", PACKAGES)
def test_the_table_has_no_circle(package):
    graph = {room: _allowed(package, room) for room in HOUSE[package]}
    order = list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError naming the circle
    assert set(order) == HOUSE[package].keys()
    assert all(order.index(other) < order.index(room) for room, others in graph.items() for other in others)


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_know_neither_scripts_nor_peers_nor_what_is_not_theirs(package):
    for path in files_of(package):
        forbidden = SCRIPTS | PEERS | ({"jax", "flax", "optax", "jaxmm"} if package == "warp_scanner" else {"warp"})
        assert forbidden.isdisjoint(name.split(".")[0] for name in imports_of(path)), path


def test_rooms_that_know_the_scanner_are_those_of_the_table():
    knows = dict.fromkeys(HOUSE["jaxmm"], False)
    for path in files_of("jaxmm"):
        if room_of(path) != "weights":
            knows[room_of(path)] |= any(name.split(".")[0] == "warp_scanner" for name in imports_of(path))
    assert knows == {room: row["scanner"] == "yes" for room, row in HOUSE["jaxmm"].items()}


@pytest.mark.parametrize("folder", (*PACKAGES, "benchmarks", "paper"))
def test_code_imports_from_where_things_stand(folder):
    """The faces of packages and rooms are for users: a name that they find hides the arrow, and what a stage runs."""
    for path in files_of(folder):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module.split(".")[0] in PACKAGES:
                place = ROOT / Path(*node.module.split("."))
                if place.is_dir() and node.module != "jaxmm.weights":
                    for alias in node.names:
                        there = (place / f"{alias.name}.py").is_file() or (place / alias.name).is_dir()
                        assert there, f"{path}: from {node.module} import {alias.name}"


@pytest.mark.parametrize("package", PACKAGES)
def test_rooms_say_what_they_may_import_as_the_table_does(package):
    for room, row in HOUSE[package].items():
        if room != "root":
            told = importlib.import_module(f"{package}.{room}").__doc__
            assert told.endswith(f" May import: {row['may import'] or 'nothing'}."), told


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_imports_in_a_circle(package):
    paths = (path.relative_to(ROOT) for path in files_of(package))
    modules = {".".join(path.with_suffix("").parts).removesuffix(".__init__"): ROOT / path for path in paths}
    graph = {name: imports_of(path) & modules.keys() - {name} for name, path in modules.items()}
    order = tuple(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError naming the circle
    assert set(order) == modules.keys()


@pytest.mark.parametrize("package", PACKAGES)
def test_what_a_room_names_for_users_is_there_and_is_its_own(package):
    for path in [ROOT / package / "__init__.py", *(ROOT / package).glob("*/__init__.py")]:
        name = ".".join(path.parent.relative_to(ROOT).parts)
        if name == "jaxmm.weights":
            continue
        room = importlib.import_module(name)
        assert room.__doc__ and "\n" not in room.__doc__, f"{path}: expected one line that says what goes in and out"
        assert getattr(room, "__all__", ()) or name in FACELESS, f"{name} names nothing for users"
        for public in getattr(room, "__all__", ()):
            assert getattr(room, public) is not None
            assert public in _defined_below(path.parent), f"{name}.{public} is defined elsewhere: it has two homes"


@functools.cache
def _defined_below(folder: Path) -> set[str]:
    """Names of the functions, classes and constants that the files of a folder define."""
    names = set()
    for path in folder.rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                names.add(node.name)
            elif isinstance(node, ast.Assign):
                names |= {part.id for target in node.targets for part in ast.walk(target) if isinstance(part, ast.Name)}
    return names


def test_no_folder_and_no_file_outgrows_its_bounds():
    folders = [ROOT / name for name in (*PACKAGES, "benchmarks", "paper", "tests")]
    paths = [path for folder in folders for path in folder.rglob("*.py")]
    for folder in {path.parent for path in paths}:
        count = len([path for path in folder.glob("*.py") if path.name != "__init__.py"])
        most = MOST_OF_A_ROOM if folder.relative_to(ROOT).parts[0] in PACKAGES else MOST_FILES
        assert count <= most, f"{folder}: {count} files"
    for path in paths:
        lines = len(path.read_text(encoding="utf-8").splitlines())
        assert lines <= MOST_LINES, f"{path}: {lines} lines"


def test_tests_mirror_the_rooms():
    rooms = {path.name for path in (ROOT / "jaxmm").iterdir() if (path / "__init__.py").is_file()} - {"weights"}
    folders = {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")}
    assert folders == rooms | {"warp_scanner", "benchmarks", "paper"}
    assert not list((ROOT / "tests" / "cases").glob("test_*.py"))


def test_files_that_run_first_are_there():
    for name in FIRST:
        assert (ROOT / "tests" / name).is_file(), name
