"""Gathers the evidence of generated pairs in the ways in which real ones come: as geometry and rays, or as clouds.

R pairs, N points of the side that is judged. World frame: metres, z up.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from jaxmm.config import Config
from jaxmm.data.preprocessed_pairs import own_draws
from jaxmm.data.simulator_settings import CloudSource, pair_config
from jaxmm.inputs import InputError
from jaxmm.rays.cloud_evidence import CloudPair, frame_of_pair, prior_view, robot_view
from jaxmm.rays.evidence import features_of
from jaxmm.rays.pair_evidence import expected_of, frames_of, prior_views, robot_views
from jaxmm.rays.pools import normals_of
from jaxmm.rays.viewpoint import estimate
from warp_scanner.clouds.points import Kept
from warp_scanner.rooms.pairs import Pairs, pairs_at
from warp_scanner.sensors.sensors import Pinhole, Sensor

KINDS = ("exact", "cloud", "points")
SHARES = (0.5, 0.25, 0.25)  # of the kinds, where they are mixed

Seen = tuple[list[Kept], list[Kept], list[np.ndarray]]


def gather(
    config: Config, source: CloudSource, pairs: Pairs, seen: Seen, threads: int | None = None
) -> list[np.ndarray]:
    """What rays say of the points that a scenario's model sees, (N, F) float32 for each pair; F is 0 for `none`.

    Args:
        config: which kind of evidence, and how far off an estimated viewpoint is.
        source: what the pairs are of.
        pairs: scans of R rooms.
        seen: of each pair the points that are judged, those of the other side, and the distances from the first to
            the nearest of the second (N,) [m].
        threads: how many to use; by default one for each core it may run on.
    """
    rooms = len(pairs.pose.yaw)
    if config.preprocess.evidence == "none":
        return [np.zeros((len(kept.pixel), 0), np.float32) for kept in seen[0]]
    draws = [own_draws(pairs, row, 1) for row in range(rooms)]
    kinds = np.array([_kind(config, rng) for rng in draws])
    found: dict[int, np.ndarray] = {}
    exact = np.flatnonzero(kinds == "exact")
    if len(exact):
        some = tuple([field[row] for row in exact] for field in seen)
        features = _exact(config, source, pairs_at(pairs, exact), some, threads)
        found |= dict(zip(exact.tolist(), features, strict=True))

    def from_clouds(row: int) -> np.ndarray:
        one = tuple(field[row] for field in seen)
        return _from_clouds(config, source, (pairs, row, kinds[row] == "cloud"), one, draws[row])

    others = np.flatnonzero(kinds != "exact").tolist()
    with ThreadPoolExecutor(threads) as pool:  # rooms are shared out, not rays
        found |= dict(zip(others, pool.map(from_clouds, others), strict=True))
    return [found[row] for row in range(rooms)]


def _exact(config: Config, source: CloudSource, pairs: Pairs, seen: Seen, threads: int | None) -> list[np.ndarray]:
    """Ray by ray, against the prior's geometry."""
    sensor = pair_config(config, source).sensor
    expected = expected_of(pairs, sensor, threads)
    if source.scenario.endswith("removed"):
        views = prior_views(pairs, sensor, expected, (seen[0], seen[2]), threads)
    else:
        views = robot_views(pairs, expected, seen[0], threads)
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(features_of, views, frames_of(pairs, sensor)))


def _from_clouds(
    config: Config,
    source: CloudSource,
    which: tuple[Pairs, int, bool],
    seen: tuple[Kept, Kept, np.ndarray],
    rng: np.random.Generator,
) -> np.ndarray:
    """From both clouds as they are left after preprocessing, and a viewpoint that is not quite right."""
    (pairs, row, elements_known), (judged, other, apart) = which, seen
    removed = source.scenario.endswith("removed")
    prior, robot = (judged, other) if removed else (other, judged)
    sensor = pairs.pose.position[row] + config.preprocess.viewpoint_error * rng.standard_normal(3)
    if rng.random() < config.preprocess.viewpoint_estimated:
        told = _estimated(
            (prior.points, robot.points), pair_config(config, source).sensor, float(pairs.pose.pitch[row])
        )
        sensor = sensor if told is None else told
    element = pairs.dt.element[row, prior.pixel] if elements_known else None
    pair = CloudPair(prior.points, robot.points, sensor, element)
    surfaces = normals_of(judged.points)  # which both steps below ask for
    view = (prior_view if removed else robot_view)(pair, apart, 1, surfaces)
    return features_of(view, frame_of_pair(pair), surfaces)


def _estimated(clouds: tuple[np.ndarray, ...], sensor: Sensor, pitch: float) -> np.ndarray | None:
    """Where the clouds were scanned from, as the first of them that tells says; None where none does."""
    if isinstance(sensor, Pinhole):
        for points in clouds:
            try:
                return estimate(points, sensor.horizontal_fov, sensor.vertical_fov, pitch=pitch).position
            except InputError:
                continue
    return None


def _kind(config: Config, rng: np.random.Generator) -> str:
    kind = config.preprocess.evidence
    return str(rng.choice(KINDS, p=SHARES)) if kind == "mixed" else kind
