"""Which files a building model is in: one, or all models of a folder, and others that are named besides."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from warp_scanner.buildings.ifc_zips import SUFFIXES as IFC_SUFFIXES
from warp_scanner.buildings.ifc_zips import is_ifc
from warp_scanner.buildings.mesh_files import SUFFIXES as MESH_SUFFIXES

KNOWN = (*IFC_SUFFIXES, *MESH_SUFFIXES)
_REPORT = "report.json"  # in a folder of results: the models beside it are no part of the building


class ModelFile(NamedTuple):
    """One file of a building model."""

    path: Path
    name: str  # what it goes by: below the folder of the model, or with as many folders as tell it from the others


class Model(NamedTuple):
    """All files of a building model, in the order of their names."""

    path: Path  # that it was asked for by: a file, or a folder
    files: tuple[ModelFile, ...]
    first: str | None  # name of the file whose frame is that of the whole; None: of most elements

    @property
    def name(self) -> str:
        """What the whole goes by."""
        return self.path.name or self.path.resolve().name

    @property
    def suffix(self) -> str:
        """Ending of the file; empty where there are several."""
        return self.files[0].path.suffix if len(self.files) == 1 else ""

    @property
    def has_ifc(self) -> bool:
        """Whether any of them is IFC, which says its unit and axes itself."""
        return any(is_ifc(one.path) for one in self.files)


def model_of(path: Path | str, also: Sequence[Path | str] = (), option: str = "--also") -> Model:
    """The files of a model.

    Args:
        path: a file of any kind, or a folder: all IFC and mesh files in it and below. Folders of results are passed
            over, and so is what is hidden.
        also: IFC or mesh files that belong to it as well.
        option: what users call these, for errors.

    Raises:
        ValueError: nothing there; a folder without models; a file that is no model beside others; one line.
    """
    path, also = Path(path), [Path(one) for one in also]
    own = _in_folder(path) if path.is_dir() else [path]
    if not own:
        raise ValueError(f"{path}: expected a folder with models ({', '.join(KNOWN)}), found none in it")
    if not path.is_dir() and also:
        _check(path, path, f"beside {option}")
    for one in also:
        _check(one, path, option)
    known = {one.resolve(): one for one in [*also, *own]}
    named = {one: one.relative_to(path).as_posix() for one in own} if path.is_dir() else {}
    taken = set(named.values())
    files = [ModelFile(one, named.get(one) or _name(one, [*known.values()], taken)) for one in known.values()]
    files.sort(key=lambda one: one.name)
    first = None if path.is_dir() else next(one.name for one in files if one.path.resolve() == path.resolve())
    return Model(path, tuple(files), first)


def _check(one: Path, path: Path, option: str) -> None:
    if not one.is_file():
        found = "a folder" if one.is_dir() else "nothing there"
        raise ValueError(f"{option}: expected an IFC or mesh file, found {found}: {one}")
    if one.suffix.lower() not in KNOWN or not has_surface(one):
        raise ValueError(
            f"{option}: expected a model ending in {', '.join(KNOWN)}, with surfaces, got {one.name}: only such can be "
            f"put together with {path.name}"
        )


def _in_folder(folder: Path) -> list[Path]:
    found = []
    for place, folders, names in os.walk(folder):
        if _REPORT in names:
            folders.clear()
            continue
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        files = [Path(place) / name for name in names if not name.startswith((".", "~"))]
        found += [one for one in files if one.suffix.lower() in KNOWN and has_surface(one)]
    return sorted(found)


def _name(one: Path, others: list[Path], taken: set[str]) -> str:
    """A file's name with as many of its folders as tell it from all others."""
    parts = one.absolute().parts
    names = [other.absolute().parts for other in others if other != one]
    for depth in range(1, len(parts)):
        name = Path(*parts[-depth:]).as_posix()
        if name not in taken and not any(other[-depth:] == parts[-depth:] for other in names):
            return name
    return Path(*parts[1:]).as_posix()


def has_surface(path: Path) -> bool:
    """Whether a file of a model's ending has surfaces: a PLY file without faces is a point cloud."""
    if path.suffix.lower() != ".ply":
        return True
    with open(path, "rb") as file:
        header = file.read(65536).split(b"end_header")[0]
    return any(
        words[:2] == [b"element", b"face"] and len(words) > 2 and words[2] != b"0"
        for words in (line.split() for line in header.splitlines())
    )
