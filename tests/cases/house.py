"""The house of the documentation: house.ifc, and scan.e57, taken in it after one of its columns was taken out."""

from pathlib import Path

from jaxmm.commands.scanning import scan
from jaxmm.formats.poses import parse_pose
from jaxmm.formats.writers import write_scan
from tests.cases.box_building import shell_of, table_of
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.scenes import PILLAR

POSE = "4,-3,1.5,90"
STANDS = (*shell_of(6.0, 5.0, 3.0), ((2.0, 2.0, 1.5), (0.15, 0.15, 1.5), PILLAR))
GONE = ((4.5, 1.0, 1.5), (0.2, 0.2, 1.5), PILLAR)


def write_house(folder: Path) -> None:
    """Write both files."""
    write_room(folder / "house.ifc", table_of((*STANDS, GONE)), 0)
    write_room(folder / "as_built.ifc", table_of(STANDS), 0)
    write_scan(folder / "scan.e57", scan(folder / "as_built.ifc", parse_pose(POSE)))
    (folder / "as_built.ifc").unlink()
