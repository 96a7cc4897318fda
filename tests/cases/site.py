"""A site of two storeys as IFC with a schedule, and scans of it as it was in four weeks.

Ground floor: four outer walls, an inner wall, a column. Upper floor: the same outer walls. In the first week only the
ground floor's outer walls stand; the inner wall and the column follow; then the upper walls; in the last week the
inner wall is gone again, and the column stands 80 mm off its place.
"""

from pathlib import Path

import numpy as np

from jaxmm.commands.scanning import scan
from jaxmm.formats.poses import parse_pose
from jaxmm.formats.writers import write_scan
from tests.cases.box_building import shell_of, table_of
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.scenes.scenes import CEILING, FLOOR, PILLAR, WALL
from warp_scanner.sensors.sensors import Spinning

HEIGHT, OFF = 3.0, 0.08  # [m]
SENSOR = Spinning(480, 80, (-60.0, 60.0), range_limits=(0.3, 50.0))
INNER, COLUMN = "inner wall", "column"
POSE, UPPER_POSE = "1,-3,1.5,90", "1,-3,4.7,90"
DATES = ("2026-03-02", "2026-03-09", "2026-03-16", "2026-03-23")


def _parts() -> dict[str, tuple]:
    """Boxes (center, half size, semantic) by name."""
    lower, upper = shell_of(6.0, 5.0, HEIGHT), shell_of(6.0, 5.0, HEIGHT)
    up = np.array([0.0, 0.0, HEIGHT + 0.2])
    parts = {"slab": lower[0], "ceiling": lower[1]}
    parts |= {f"wall {number}": one for number, one in enumerate(lower[2:])}
    parts |= {f"upper wall {number}": (tuple(one[0] + up), *one[1:]) for number, one in enumerate(upper[2:])}
    parts["roof"] = (tuple(upper[1][0] + up), *upper[1][1:])
    parts[INNER] = ((-2.0, 1.0, HEIGHT / 2), (1.5, 0.1, HEIGHT / 2), WALL)
    parts[COLUMN] = ((3.0, 1.5, HEIGHT / 2), (0.2, 0.2, HEIGHT / 2), PILLAR)
    assert {one[2] for one in parts.values()} == {FLOOR, CEILING, WALL, PILLAR}
    return parts


PARTS = _parts()
UPPER = tuple(name for name in PARTS if name.startswith("upper"))


def stands(week: int) -> dict[str, tuple]:
    """What stands in a week, where it stands."""
    without = ((INNER, COLUMN, *UPPER, "roof"), (*UPPER, "roof"), (), (INNER,))[week]
    found = {name: part for name, part in PARTS.items() if name not in without}
    if week == 3:
        (x, y, z), *rest = found[COLUMN]
        found[COLUMN] = ((x + OFF, y, z), *rest)
    return found


def write_model(path: Path) -> dict[str, str]:
    """Write the model; returns the GlobalId of every part by its name."""
    import ifcopenshell

    guids = dict(zip(PARTS, write_room(path, table_of(tuple(PARTS.values())), 0).values(), strict=True))
    model = ifcopenshell.open(str(path))
    for name, guid in guids.items():
        model.by_guid(guid).Name = name
    (lower,) = model.by_type("IfcBuildingStorey")
    lower.Name = "Ground floor"
    upper = model.create_entity(
        "IfcBuildingStorey", ifcopenshell.guid.compress("1" * 32), Name="Upper floor",
        ObjectPlacement=lower.ObjectPlacement, Elevation=HEIGHT + 0.2,
    )  # fmt: skip
    (aggregate,) = [one for one in model.by_type("IfcRelAggregates") if lower in one.RelatedObjects]
    aggregate.RelatedObjects = [lower, upper]
    (contained,) = model.by_type("IfcRelContainedInSpatialStructure")
    above = [model.by_guid(guids[name]) for name in (*UPPER, "roof")]
    contained.RelatedElements = [one for one in contained.RelatedElements if one not in above]
    model.create_entity(
        "IfcRelContainedInSpatialStructure", ifcopenshell.guid.compress("2" * 32), RelatedElements=above,
        RelatingStructure=upper,
    )  # fmt: skip
    _add_tasks(model, guids, upper)
    path.write_text(model.to_string(), encoding="utf-8")
    return guids


def _add_tasks(model, guids: dict[str, str], upper) -> None:
    """A summary of three tasks: by what comes out, by what is worked on, and by a storey; and one that takes away."""
    import ifcopenshell

    def task(number: int, name: str, start: str, finish: str, kind: str = "CONSTRUCTION"):
        time = model.create_entity(
            "IfcTaskTime", ScheduleStart=f"{start}T08:00:00", ScheduleFinish=f"{finish}T17:00:00"
        )
        return model.create_entity(
            "IfcTask", ifcopenshell.guid.compress(f"{number:032x}"), Name=name, IsMilestone=False, TaskTime=time,
            PredefinedType=kind,
        )  # fmt: skip

    def relate(number: int, kind: str, **ends):
        model.create_entity(kind, ifcopenshell.guid.compress(f"{number:032x}"), **ends)

    whole = task(0xA0, "Shell", "2026-02-16", "2026-03-20")
    outer = task(0xA1, "Outer walls", "2026-02-16", "2026-03-02")
    inner = task(0xA2, "Inner walls and columns", "2026-03-03", "2026-03-06")
    top = task(0xA3, "Upper floor", "2026-03-07", "2026-03-14")
    down = task(0xA4, "Take the inner wall down", "2026-03-17", "2026-03-20", "DEMOLITION")
    relate(0xB0, "IfcRelNests", RelatingObject=whole, RelatedObjects=[outer, inner, top])
    for row in range(4):
        wall = model.by_guid(guids[f"wall {row}"])
        relate(0xC0 + row, "IfcRelAssignsToProduct", RelatedObjects=[outer], RelatingProduct=wall)
    parts = [model.by_guid(guids[name]) for name in (INNER, COLUMN)]
    relate(0xD0, "IfcRelAssignsToProcess", RelatedObjects=parts, RelatingProcess=inner)
    relate(0xD1, "IfcRelAssignsToProduct", RelatedObjects=[top], RelatingProduct=upper)
    relate(0xD2, "IfcRelAssignsToProcess", RelatedObjects=parts[:1], RelatingProcess=down)


def write_scans(folder: Path, week: int) -> list[tuple[Path, str]]:
    """Scans of a week with their poses: of the ground floor, and from the third week on of the upper one, too."""
    write_room(folder / "as_built.ifc", table_of(tuple(stands(week).values())), 0)
    found = []
    for name, pose in (("lower", POSE), ("upper", UPPER_POSE))[: 1 if week < 2 else 2]:
        found.append((folder / f"{name}{week}.ply", pose))
        write_scan(found[-1][0], scan(folder / "as_built.ifc", parse_pose(pose), sensor=SENSOR))
    (folder / "as_built.ifc").unlink()
    return found
