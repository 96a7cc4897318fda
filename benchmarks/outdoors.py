"""What `detect` tells of buildings that are scanned from outdoors, where trees, cars and other houses stand around.

    python -m benchmarks.outdoors FOLDER --out runs/outdoors [--views 12] [--seed 3]

Every IFC file below FOLDER, from places 2 to 8 m outside of the circle around it, by a camera of 320 x 200 and a
spinning sensor; ideal, and as such devices err, then with a place that is off by 0.1 m (standard deviation) in every
direction. In six of ten views one wall or column is gone that at least 1 % of the rays would meet. What stands around
is in no model, and nothing in the building is new. A JSON file for each file and sensor; what is there is not made
again. Prints Markdown.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.views.building_views import asked_for, kept_views, scanned, tell_views
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import Judges
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.outdoors import is_outdoors
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import REMOVED, VERDICTS
from warp_scanner.scenes.building import Triangles, bounds
from warp_scanner.scenes.building_edits import join
from warp_scanner.scenes.scenes import OTHER, PILLAR, WALL
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import Pinhole, sensor_named
from warp_scanner.sensors.triangles import cast_triangles, prepare

SENSORS = ("oak-d-pro-small", "oak-d-pro-small-real", "ouster-64", "ouster-64-real")
FULL, SMOKE = {"views": 12, "sensors": SENSORS}, {"views": 1, "sensors": ("oak-d-pro-small", "ouster-64-real")}
GONE, LEAST_RAYS = 0.6, 0.01  # share of views in which something is gone; share of the rays that would meet it
AWAY, HEIGHT = (2.0, 8.0), 1.6  # [m] outside of the circle around the building, above its lowest storey
OFF = 0.1  # [m]
TRIES = 400


class Street(NamedTuple):
    """Where a building stands."""

    middle: np.ndarray  # (2,) [m] of what it spans
    half: np.ndarray  # (2,) [m]
    ground: float  # [m]


def _view(prior: Prior, judges: Judges, sensor_name: str, which: tuple[int, int]) -> dict[str, Any] | None:
    """What is told of one view; None where no place shows any wall."""
    building, draw, sensor = prior.building, np.random.default_rng(which), sensor_named(sensor_name)
    street, own = _street_of(prior), len(building.elements.guid)
    for _ in range(TRIES):
        pose = _pose(street, draw, isinstance(sensor, Pinhole))
        if not is_outdoors(prior, pose.position[0]):
            continue
        rays = rays_of(sensor, pose)
        meets = cast_triangles(prior.scene, rays).element[0]
        count = np.bincount(meets[meets >= 0], minlength=own)
        shown = np.isin(building.triangles.semantic, (WALL, PILLAR)) & (count >= LEAST_RAYS * len(meets))
        if shown.any():
            break
    else:
        return None
    gone = int(draw.choice(np.flatnonzero(shown))) if draw.random() < GONE else -1
    whole = join(building.triangles, _things_around(street, pose.position[0].astype(np.float64), draw))
    posed, _ = scanned(prepare(whole), np.arange(len(whole.semantic)) != gone, (sensor, pose), which)
    off = draw.normal(0.0, OFF, 3) if sensor_name.endswith("-real") else np.zeros(3)
    posed = posed._replace(points=(posed.points + off).astype(np.float32), position=posed.position + off)
    return _told(prior, judges, NamedScan(posed, "scan", len(posed.points), "given"), gone)


def _told(prior: Prior, judges: Judges, scan: NamedScan, gone: int) -> dict[str, Any]:
    told: dict[str, Any] = {"gone": gone >= 0}
    try:
        found = detect_scans(prior, [scan], judges, DetectSettings(propose_views=False))
    except InputError as error:
        return told | {"refused": str(error)}
    guid = prior.building.elements.guid[gone] if gone >= 0 else None
    wrong = [one.guid for one in found.elements if one.verdict == REMOVED and one.guid != guid]
    verdict = next((one.verdict for one in found.elements if one.guid == guid), None)
    new = [one for one in found.mismatches if one.mismatch_type == "added"]
    return told | {"verdict": verdict, "wrong": wrong, "new": len(new), "doubts": list(found.doubts)}


def _street_of(prior: Prior) -> Street:
    low, high = (corner.astype(np.float64) for corner in bounds(prior.building.triangles))
    floors = prior.building.storeys.elevation
    floors = floors[floors >= low[2] - 0.1]
    ground = float(floors.min()) if len(floors) else float(low[2])
    return Street((low + high)[:2] / 2, (high - low)[:2] / 2, ground)


def _pose(street: Street, draw: np.random.Generator, is_camera: bool) -> Pose:
    """A place around the building, turned toward it (R = 1)."""
    turn, radius = draw.uniform(0.0, 2.0 * np.pi), np.linalg.norm(street.half) + draw.uniform(*AWAY)
    plan = street.middle + radius * np.array([np.cos(turn), np.sin(turn)])
    x, y = street.middle + street.half * draw.uniform(-0.7, 0.7, 2) - plan
    pitch = draw.uniform(-5.0, 15.0) if is_camera else 0.0
    place, yaw = np.array([*plan, street.ground + HEIGHT]), np.degrees(np.arctan2(y, x))
    return Pose(*(np.array([value], np.float32) for value in (place, yaw, pitch)))


def _things_around(street: Street, place: np.ndarray, draw: np.random.Generator) -> Triangles:
    """Ground, trees, posts, cars and people within 15 m of a place, and one to three houses, an element each."""
    import trimesh  # slow to import

    ground = street.ground - 0.05
    shapes = [(trimesh.creation.box([200.0, 200.0, 0.1]), street.middle, ground - 0.05, 0.0)]
    for kind in draw.integers(0, 4, draw.integers(4, 10)):
        plan = place[:2] + draw.uniform(-15.0, 15.0, 2)
        in_house = np.all(np.abs(plan - street.middle) < street.half + 2.5)
        if in_house or np.linalg.norm(plan - place[:2]) < 2.5:
            continue
        shape = (
            trimesh.creation.cylinder(radius=draw.uniform(0.1, 0.3), height=6.0, sections=24),
            trimesh.creation.box([0.2, 0.2, 3.5]),
            trimesh.creation.box([4.2, 1.8, 1.5]),
            trimesh.creation.box([0.5, 0.3, 1.8]),
        )[kind]
        shapes.append((shape, plan, ground + shape.extents[2] / 2, draw.uniform(0.0, np.pi)))
    for _ in range(draw.integers(1, 4)):
        turn, radius = draw.uniform(0.0, 2.0 * np.pi), np.linalg.norm(street.half) + draw.uniform(16.0, 24.0)
        house = trimesh.creation.box([draw.uniform(8.0, 15.0), 8.0, draw.uniform(5.0, 9.0)])
        plan = street.middle + radius * np.array([np.cos(turn), np.sin(turn)])
        shapes.append((house, plan, ground + house.extents[2] / 2, draw.uniform(0.0, np.pi)))
    for shape, plan, height, turn in shapes:
        shape.apply_transform(trimesh.transformations.rotation_matrix(turn, [0.0, 0.0, 1.0]))
        shape.apply_translation([*plan, height])
    vertices, faces = ([getattr(shape, field) for shape, *_ in shapes] for field in ("vertices", "faces"))
    before = np.cumsum([0, *map(len, vertices)])
    return Triangles(
        np.concatenate(vertices).astype(np.float32),
        np.concatenate([own + start for own, start in zip(faces, before, strict=False)]).astype(np.int32),
        np.repeat(np.arange(len(shapes), dtype=np.int32), list(map(len, faces))),
        np.full(len(shapes), OTHER, np.uint8),
    )


def table(out: Path, seed: int) -> str:
    """All sensors, as Markdown."""
    lines = [
        f"| sensor | views | refused | something gone | {' | '.join(f'told {name}' for name in VERDICTS)} "
        "| present, told removed | nothing new, told new |",
        f"|{' --- |' * (6 + len(VERDICTS))}",
    ]
    for sensor in SENSORS:
        views = kept_views(out, sensor, seed)
        believed = [one for one in views if "refused" not in one]
        gone = [one for one in believed if one["gone"]]
        counts = [len(views), len(views) - len(believed), len(gone)]
        counts += [sum(one["verdict"] == name for one in gone) for name in VERDICTS]
        counts += [sum(len(one["wrong"]) for one in believed), sum(one["new"] for one in believed)]
        lines.append(f"| {sensor} | {' | '.join(map(str, counts))} |")
    return "\n".join(lines)


if __name__ == "__main__":
    asked = asked_for(__doc__, FULL, SMOKE)
    tell_views(_view, asked)
    print(table(asked.out, asked.seed))
