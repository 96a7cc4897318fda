"""A generated room with its IFC file, its scan, and a detection whose every answer is the simulator's own."""

import csv
import io
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxmm.rays.evidence import BLOCKED, SUPPORT, THROUGH
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict, Mismatch, PriorFile, ScanRecord
from jaxmm.verdicts.verdicts import OCCLUDED, PRESENT, REMOVED, UNSCANNED
from warp_scanner.buildings.ifc_files import read_ifc
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.clouds.points import points_of
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.rooms.pairs import PairConfig, Pairs, make_pairs
from warp_scanner.scenes.building import Building
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.poses import rotation_of

HOSTILE = (
    "=HYPERLINK(1)", "+1", "-1", "@SUM(A1)", "\t=1", 'a "quoted", name', "two\r\nlines", "a|b | c", "`code`",
    "**bold**", "_under_", "snake_case", "<img src=x onerror=alert(1)>", "[link](http://x)", "# heading", "- item",
    "1. item", "2) x", "&amp;", "$x$", "\\", "~~gone~~", "Stütze Ø 30", "柱", "![i](x)", "<!-- -->", "</table>", "---",
    "1.5 m", "a\\|b",
)  # fmt: skip


class Case(NamedTuple):
    """One room."""

    ifc: Path
    building: Building
    pairs: Pairs  # R = 1
    detection: Detection


def true_case(folder: Path, scenario: str = "pillar_and_wall_removed", number: int = 0) -> Case:
    """Room `number` of a scenario, its prior written to `folder` as IFC4, and all that is true of it."""
    pairs = make_pairs(PairConfig(scenario=scenario, condition="occluded", seed=11), np.array([number]))
    ifc = folder / "room.ifc"
    guid = write_room(ifc, pairs.prior, 0)
    building = read_ifc(ifc)
    drawing = _drawing(pairs, building, guid)
    mismatches = _mismatches(pairs, guid)
    position, corners = pairs.pose.position[0], drawing.fields_of_view
    pose = (*(float(value) for value in position), float(pairs.pose.yaw[0]), float(pairs.pose.pitch[0]))
    scan = ScanRecord(
        "robot.ply", len(drawing.robot), pose, "given", None,
        {"shift": 0.01, "turn": 0.1, "residual": 0.004, "overlap": 0.97, "overlap_before": 0.95},
        {PRESENT: 5, REMOVED: sum(one.mismatch_type == "removed" for one in mismatches), OCCLUDED: 1, UNSCANNED: 0},
    )  # fmt: skip
    assert len(corners) == 1
    file = PriorFile(ifc.name, "ifc", building.unit, building.project)
    detection = Detection(
        mismatches, _elements(pairs, building, mismatches, drawing, pose), (scan,),
        {"refined": True, "residual": 0.004}, {"preset": "default", "change_prior": 0.02}, {"total": 1.0},
        ("note: all of this is made up, and true",), drawing, file,
    )  # fmt: skip
    return Case(ifc, building, pairs, detection)


def _drawing(pairs: Pairs, building: Building, guid: dict[int, str]) -> Drawing:
    sides = []
    for scan, changed in ((pairs.robot, pairs.changed_robot), (pairs.dt, pairs.changed_dt)):
        pixel = np.flatnonzero(np.isfinite(scan.distance[0]))
        points = points_of(pairs.pose, pairs.directions, scan.distance)[0, pixel]
        chosen = thin_clouds([points], 0.1)[0]
        sides.append((points[chosen], pixel[chosen], changed[0, pixel[chosen]]))
    (robot, pixel, new), (prior, ray, gone) = sides
    row_of = {name: row for row, name in enumerate(building.elements.guid)}
    element = np.array([row_of[guid[int(number)]] for number in pairs.dt.element[0, ray]], np.int32)
    before = pairs.robot.distance[0] < pairs.dt.distance[0] - 0.1
    corners = np.array([[1, -y, z] for y in (-1, 1) for z in (-1, 1)])[[0, 1, 3, 2]] * [1, np.tan(0.7), np.tan(0.48)]
    corners = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    return Drawing(
        building.origin,
        robot, np.where(new, 0.97, 0.02).astype(np.float32), np.where(before[pixel], BLOCKED, SUPPORT).astype(np.uint8),
        np.zeros(len(robot), np.int32),
        prior, np.where(gone, 0.97, 0.01).astype(np.float32),
        np.where(gone, THROUGH, np.where(before[ray], BLOCKED, SUPPORT)).astype(np.uint8), element,
        building.elements.guid, building.triangles.vertices, building.triangles.faces, building.triangles.element,
        ((corners @ rotation_of(pairs.pose.yaw, pairs.pose.pitch)[0].T).astype(np.float32),),
    )  # fmt: skip


def _mismatches(pairs: Pairs, guid: dict[int, str]) -> tuple[Mismatch, ...]:
    found, box = [], pairs.box
    for one in range(box.change.shape[1]):
        removed = box.change[0, one] < 0
        kind = "pillar" if box.object_type[0, one] == PILLAR else "wall"
        found.append(Mismatch(
            kind, "removed" if removed else "added", box.center[0, one].astype(float), box.size[0, one].astype(float),
            float(box.yaw[0, one]), 0.97, guid[int(box.element[0, one])] if removed else None, None,
            float(pairs.observable_fraction[0, one]),
        ))  # fmt: skip
    return tuple(found)


def _elements(pairs, building: Building, mismatches, drawing: Drawing, pose) -> tuple[ElementVerdict, ...]:
    gone, verdicts = {one.element for one in mismatches}, []
    for row in np.flatnonzero(np.isin(building.elements.semantic, (WALL, PILLAR))):
        name, points = building.elements.guid[row], int((drawing.prior_element == row).sum())
        verdict = REMOVED if name in gone else UNSCANNED if not points else PRESENT if points > 40 else OCCLUDED
        rays = {REMOVED: (90, 2, 8, 0), PRESENT: (1, 400, 80, 3), OCCLUDED: (0, 1, 700, 9), UNSCANNED: (0, 0, 0, 0)}
        table = building.elements
        verdicts.append(ElementVerdict(
            name, table.ifc_class[row], table.name[row], building.storeys.name[table.storey[row]], verdict,
            {REMOVED: 0.97, PRESENT: 0.004}.get(verdict, 0.02), points, rays[verdict],
            pose if verdict == OCCLUDED else None,
        ))  # fmt: skip
    return tuple(verdicts)


def named(names):
    """Occluded elements of some names, which a report lists in full."""
    return tuple(ElementVerdict(name, name, name, name, "occluded", 0.02, 3, (1, 2, 3, 4)) for name in names)


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text, newline=""), strict=True))


def thinned(detection: Detection) -> Detection:
    """The same with a tenth of the points, for speed."""
    drawing = detection.drawing
    names = [f"{side}{name}" for side in ("robot", "prior") for name in ("", "_probability", "_evidence")]
    thin = {name: getattr(drawing, name)[::10] for name in (*names, "robot_scan", "prior_element")}
    return detection._replace(drawing=drawing._replace(**thin))
