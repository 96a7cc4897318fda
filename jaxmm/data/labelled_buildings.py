"""Pairs of a building's scans as labelled clouds with evidence, as labelled_rooms.py makes them of generated rooms.

Rooms have their middle at z = 0; a view of a building is shifted so that the floor and ceiling around its sensor lie
as those of a room do, for the height filter and the frame of the evidence go by that. R = 1: buildings are scanned one
view at a time.
"""

import dataclasses
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from jaxmm.config import Config
from jaxmm.data.evidence_sources import Seen
from jaxmm.data.labelled_rooms import Gatherer, clouds_of, truth_of
from jaxmm.data.preprocessed_pairs import Sides, sides_of
from jaxmm.data.simulator_settings import CloudSource, pair_config
from jaxmm.learning.batches import LabelledCloud
from jaxmm.learning.room_scores import RoomTruth
from jaxmm.rays.evidence import features_of, margins
from jaxmm.rays.noise_model import noise_of, sigma_at
from jaxmm.rays.pair_evidence import EVERY, Expected, frames_of, prior_views, robot_view_of
from warp_scanner.buildings.pairs import BuildingPairConfig, make_building_pairs
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.scenes.building import Building
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import Sensor
from warp_scanner.sensors.surface import incidence_of
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, cast_triangles, clearance, face_normals, prepare

LEVELS = (1.0, 99.0)  # percentiles of z that stand for floor and ceiling where the building has none
FARTHEST = 2.0  # [m] beyond which the distance to the prior's surface is not looked for


class View(NamedTuple):
    """One view of one change in a building, of one model."""

    cloud: LabelledCloud
    truth: RoomTruth
    sides: Sides  # both scans after preprocessing


def building_views(config: Config, building: Building, source: CloudSource, numbers: Iterable[int]) -> Iterator[View]:
    """The clouds of some views of one change in a building; the ones without furniture in view are left out.

    As of rooms, at least the share `furniture_share` of the occluded scan's rays must meet furniture, and the clean
    condition has the same views: else half of what is called occluded would not be.

    Args:
        config: sensor, preprocessing; evidence is exact, unless it is none.
        building: from a file.
        source: whose scene is its scenario; `seed` is that of the views.
        numbers: of the views.

    Raises:
        ValueError: the building lacks what is to be removed.
        RuntimeError: no place where a sensor sees such a change.
    """
    scene = prepare(building.triangles)
    pair = pair_config(config, source._replace(scene=source.scenario))
    asked = BuildingPairConfig(
        source.seed, source.scenario, "occluded", pair.sensor, pair.scene.standing,
        testable_margin=pair.testable_margin,
    )  # fmt: skip
    furniture = len(building.elements.guid) + source.scenario.endswith("added")
    for number in numbers:
        made = make_building_pairs(building, asked, np.array([number]))
        if np.mean(made.robot.element >= furniture) < pair.furniture_share:
            continue
        if source.condition == "clean":
            made = make_building_pairs(building, dataclasses.replace(asked, condition="clean"), np.array([number]))
        pairs, shift = _levelled(scene, made)
        sides = sides_of(config, pairs)
        (cloud,) = clouds_of(config, source, pairs, sides=sides, gatherer=_gatherer(scene, pair.sensor, shift))
        yield View(cloud, truth_of(source, pairs, 0, int(number)), sides)


def _gatherer(scene: TriangleScene, sensor: Sensor, shift: float) -> Gatherer:
    def gathered(
        config: Config, source: CloudSource, pairs: Pairs, seen: Seen, threads: int | None
    ) -> list[np.ndarray]:
        if config.preprocess.evidence == "none":
            return [np.zeros((len(kept.pixel), 0), np.float32) for kept in seen[0]]
        return [_evidence(scene, sensor, pairs, (source, seen, shift))]

    return gathered


def _levelled(scene: TriangleScene, pairs: Pairs) -> tuple[Pairs, float]:
    """The pair moved along z so that 0 is halfway from floor to ceiling, with that height as size; and the shift."""
    place = pairs.pose.position.astype(np.float64)
    vertical = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], np.float32)
    down, up = cast_triangles(scene, Rays(place, vertical)).distance[0].astype(np.float64)
    floor, ceiling = place[0, 2] - down, place[0, 2] + up
    if not (np.isfinite(floor) and np.isfinite(ceiling)):
        back = np.isfinite(pairs.dt.distance[0])
        low, high = np.percentile(points_of(pairs.pose, pairs.directions, pairs.dt.distance)[0, back, 2], LEVELS)
        floor, ceiling = (floor if np.isfinite(floor) else low), (ceiling if np.isfinite(ceiling) else high)
    shift = -(floor + ceiling) / 2
    up = np.array([0.0, 0.0, shift], np.float32)
    size = pairs.size.copy()
    size[:, 2] = max(ceiling - floor, 0.5)
    moved = (Pose(pose.position + up, pose.yaw, pose.pitch) for pose in (pairs.pose, pairs.true_pose))
    pose, true_pose = moved
    box = pairs.box._replace(center=pairs.box.center + up)
    return pairs._replace(pose=pose, true_pose=true_pose, box=box, size=size), float(shift)


def _evidence(scene: TriangleScene, sensor: Sensor, pairs: Pairs, what: tuple[CloudSource, Seen, float]) -> np.ndarray:
    """What rays say of the points of the side that is judged, against the building's triangles."""
    source, (judged, _, distances), shift = what
    place = pairs.pose.position - np.array([0.0, 0.0, shift], np.float32)
    expected = _expected(scene, sensor, pairs, pairs.pose._replace(position=place))
    if source.scenario.endswith("removed"):
        (view,) = prior_views(pairs, sensor, expected, (judged, distances))
    else:
        own = judged[0].points - np.array([0.0, 0.0, shift], np.float32)
        view = robot_view_of(pairs, expected, 0, judged[0], clearance(scene, own, FARTHEST))
    return features_of(view, frames_of(pairs, sensor)[0])


def _expected(scene: TriangleScene, sensor: Sensor, pairs: Pairs, pose: Pose) -> Expected:
    """What the building says that every ray should meet; as pair_evidence.expected_of of rooms."""
    rays = rays_of(sensor, pose)
    found, face = cast_faces(scene, rays)
    cosine = np.cos(incidence_of(face_normals(scene.triangles, face), rays))
    thin = slice(None, None, EVERY)
    with np.errstate(invalid="ignore"):  # no return where none was expected
        residual = (pairs.robot.distance - found.distance)[0, thin]
    noise = noise_of(residual, cosine[0, thin], found.distance[0, thin])
    margin = margins(cosine[0], sigma_at(noise, found.distance[0]))
    return Expected(found.distance, cosine, margin[None], [noise])
