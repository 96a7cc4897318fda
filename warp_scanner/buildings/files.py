"""Which reader a building file gets."""

from pathlib import Path

from warp_scanner.buildings.ifc_files import read_ifc
from warp_scanner.buildings.ifc_zips import SUFFIXES as IFC_SUFFIXES
from warp_scanner.buildings.mesh_files import SUFFIXES, read_mesh
from warp_scanner.scenes.building import AS_IT_IS, Building, ReadOptions


def read_building(path: Path | str, options: ReadOptions = AS_IT_IS) -> Building:
    """The building in an IFC or mesh file, by the ending of its name.

    Raises:
        ValueError: an ending that no reader knows; a file that its reader refuses.
        ImportError: an IFC file, and ifcopenshell is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix in IFC_SUFFIXES:
        return read_ifc(path, options)
    if suffix in SUFFIXES:
        return read_mesh(path, options)
    known = ", ".join((*IFC_SUFFIXES, *SUFFIXES))
    raise ValueError(f"{path}: expected a file ending in {known}, got {suffix or 'no ending'}")
