"""Leaves mirror images out of scans before anything is concluded from them, and says which surface shows them.

Positions are offsets from the prior's origin, world axes: metres, z up.
"""

from functools import partial

import numpy as np

from jaxmm.rays.mirror_images import Mirror, Surfaces, without_images
from jaxmm.rays.scan_rays import PosedScan, ScanRays
from jaxmm.vectors import lengths
from jaxmm.verdicts.building_evidence import surfaces_along
from jaxmm.verdicts.priors import Prior, distance_from
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.surface import incidence_of
from warp_scanner.sensors.triangles import TriangleScene, cast_faces, cast_triangles, face_normals

AT = 0.3  # [m] about where rays cross a mirror, within which an element of the model is it, or carries it
ASKED = 500  # rays
ON = 0.3  # [m] within which a point of a cloud is looked for
ALONG = 0.5  # [m] along a ray, from its end to the surface that it meets: along floors, little is a long way


def unmirrored(prior: Prior, scan: PosedScan, rays: ScanRays) -> tuple[PosedScan, tuple[str, ...]]:
    """A scan, where it lies, without mirror images; and what is to be said of that. `rays` are the scan's."""
    found = without_images(scan, surfaces_of(prior, rays))
    if not found.mirrors:
        return scan, ()
    where = dict.fromkeys(_name(prior, scan, one) for one in found.mirrors)
    return found.scan, (
        f"{found.share:.1%} of its points are mirror images in {' and '.join(where)} and were left out",
    )


def surfaces_of(prior: Prior, rays: ScanRays) -> Surfaces:
    """What the prior knows of the place that a scan's rays start from."""
    to_prior = distance_from(prior)

    def distance(points: np.ndarray, reach: float) -> np.ndarray:
        return to_prior(points + prior.origin, reach)

    if not prior.has_elements:
        return Surfaces(lambda: prior.cloud, distance, lambda _, ends: distance(ends, ON))
    return Surfaces(partial(surfaces_along, prior.scene, rays), distance, partial(_off, prior.scene))


def _off(scene: TriangleScene, starts: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(N,) [m] from the ends (N, 3) of rays to the planes of the first surfaces that they meet; inf without one."""
    way = ends - starts
    reach = lengths(way)
    rays = Rays(starts.astype(np.float32)[None], (way / reach[:, None]).astype(np.float32)[None])
    met, face = cast_faces(scene, rays)
    beside = np.abs(met.distance[0] - reach)
    cosine = np.cos(incidence_of(face_normals(scene.triangles, face), rays))[0]
    return np.where(beside < ALONG, beside * np.nan_to_num(cosine, nan=1.0), np.inf)


def _name(prior: Prior, scan: PosedScan, mirror: Mirror) -> str:
    """The element that most of its rays meet there: it mirrors, or a mirror hangs on it; else where it is."""
    if prior.has_elements:
        offset = mirror.places[:: max(1, len(mirror.places) // ASKED)] - scan.position
        reach = lengths(offset)
        met = cast_triangles(prior.scene, Rays(scan.position[None], (offset / reach[:, None]).astype(np.float32)))
        there = met.element[0][np.abs(met.distance[0] - reach) < AT]
        if len(there):
            table, row = prior.building.elements, int(np.argmax(np.bincount(there)))
            return repr(table.name[row] or table.guid[row])
    return "a surface at " + ", ".join(f"{value:.2f}" for value in np.median(mirror.places, axis=0) + prior.origin)
