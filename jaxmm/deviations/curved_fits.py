"""Round bodies fitted to the rays that should meet them: how far off its place each stands.

K rays of one body. Positions are offsets from the prior's origin, world axes: metres, z up.
"""

import numpy as np

from jaxmm.deviations.fits import (
    CUT,
    IN_PLACE,
    LEAST_EXTENT,
    LEAST_RAYS,
    LEAST_SIGMA,
    ROUNDS,
    STANDS,
    TRIED,
    TRIES,
    UNKNOWN_SLOPE,
    Fit,
    axes_of,
    count_cells,
)
from jaxmm.deviations.meetings import LEAST_COSINE, MOST_OFF, Meetings

RADIUS = 0.002  # [m] that a shaft may be thicker or thinner than drawn, which looks like a shift toward the sensor
OVAL = 0.05  # of the radius, that a round shaft may be off a circle
LEAST_TOLD = 0.05  # of what a round body tells of its surest way, that it must tell of another


def fits_of_curved(body: Meetings) -> list[Fit]:
    """What all rays of a round body tell of its shift, along each way that they fix; none where it stands elsewhere.

    Every ray has its own normal, so off = normal . shift.
    """
    if len(body.off) < LEAST_RAYS:
        return []
    flat = body.normal[:, :2]
    on, reaches = np.abs(body.off) < IN_PLACE, body.off < IN_PLACE
    if on.sum() < max(LEAST_RAYS, STANDS * reaches.sum()):
        on = _shift_of_most(body.off, flat)
        if on is None:
            return []
    circle, shift = _circle(body), np.zeros(2)
    for _ in range(ROUNDS):
        ways, left = _laid(body, circle, shift)
        on = on & np.isfinite(left)
        shift = shift + np.linalg.lstsq(ways[on], left[on], rcond=None)[0]
        ways, left = _laid(body, circle, shift)
        on = on & np.isfinite(left)
        if not on.any():
            return []
        sigma = max(LEAST_SIGMA, 1.4826 * float(np.median(np.abs(left[on]))))
        width = min(max(CUT * sigma, 2.0 * LEAST_SIGMA), IN_PLACE)
        new = np.abs(left) < width
        if new.sum() < max(LEAST_RAYS, STANDS * np.sum(left < width)):
            return []
        if np.array_equal(new, on):
            break
        on = new
    through, measured = int(np.sum(left < -width)) * body.every, body.as_measured()
    for _ in range(ROUNDS):
        ways, apart = _laid(measured, circle, shift)
        on = on & np.isfinite(apart)
        shift = shift + np.linalg.lstsq(ways[on], apart[on], rcond=None)[0]
    ways, apart = _laid(measured, circle, shift)
    on = on & np.isfinite(apart)
    if on.sum() < LEAST_RAYS:
        return []
    sigma = max(LEAST_SIGMA, 1.4826 * float(np.median(np.abs(apart[on]))))
    worth = max(4.0, min(float(count_cells(body.end[on])), float(on.sum()))) / on.sum()
    square, axes = np.linalg.eigh(ways[on].T @ ways[on] * worth)
    middle, looks = measured.end[on].mean(axis=0), ways[on].sum(axis=0)
    up = measured.end[on][:, 2] - middle[2]
    if circle is not None:
        middle[:2] = circle[0] + shift  # a turn about its own axis moves no round shaft
    # How it leans: what is left, as it grows with the height.
    both = np.linalg.lstsq(np.column_stack([ways[on], ways[on] * up[:, None]]), apart[on], rcond=None)[0]
    shift, lean, high = shift + both[:2], both[2:], max(float(up.std()), LEAST_EXTENT)
    if np.linalg.norm(shift) > MOST_OFF:
        return []  # of a round body that stands so far off it tells nothing
    left, found = _laid(body, circle, shift)[1], []
    for told, way in zip(square[::-1], axes.T[::-1], strict=True):
        if told < LEAST_TOLD * square[-1]:
            continue
        normal = np.array([*way, 0.0]) * (1.0 if looks @ way >= 0.0 else -1.0)
        along = axes_of(normal)
        variance = np.diag([sigma**2 / told + RADIUS**2, UNKNOWN_SLOPE**2, sigma**2 / told / high**2])
        slope = np.array([0.0, along[1, 2] * float(normal[:2] @ lean)])
        found.append(Fit(
            middle, normal, along, float(normal[:2] @ shift), slope, variance, sigma,
            (body.end[on] @ along.T).std(axis=0), on, left, through, body.every, first=not found,
        ))  # fmt: skip
    return found


def _laid(body: Meetings, circle: tuple[np.ndarray, float] | None, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (K, 2) in plan, across the body where each ray meets it after a shift, and how far (K,) [m] off.

    By rays, not by where they ended: an end that errs lies about a shaft as often as on it, and always outside of it.
    Infinite of rays that do not meet it there.
    """
    if circle is None:
        return body.normal[:, :2], body.off - body.normal[:, :2] @ shift
    way = ((body.end - body.sensor) / body.reach[:, None])[:, :2]
    arm, square = body.sensor[:2] - circle[0] - shift, np.einsum("kc,kc->k", way, way)
    along = way @ arm
    with np.errstate(invalid="ignore", divide="ignore"):
        met = (-along - np.sqrt(along**2 - square * (arm @ arm - circle[1] ** 2))) / square
        across = (arm + way * met[:, None]) / circle[1]
        cosine = -np.einsum("kc,kc->k", across, way)
        off = np.where(cosine > LEAST_COSINE, (met - body.reach) * cosine, np.inf)
    return np.where(np.isfinite(off)[:, None], across, 0.0), off


def _circle(body: Meetings) -> tuple[np.ndarray, float] | None:
    """Middle (2,) [m] and radius [m] of a round shaft, by where its rays should end; None of any other."""
    way = (body.end - body.sensor) / body.reach[:, None]
    cosine = -np.einsum("kc,kc->k", body.normal, way)
    hit = (body.end + way * (body.off / cosine)[:, None])[:, :2]
    flat = body.normal[:, :2]
    # Of all lines along the normals, the place that is nearest to them.
    across = np.eye(2) - np.einsum("ki,kj->kij", flat, flat)
    middle = np.linalg.lstsq(across.sum(axis=0), np.einsum("kij,kj->i", across, hit), rcond=None)[0]
    reach = np.einsum("kc,kc->k", hit - middle, flat)
    radius = float(np.median(reach))
    return (middle, radius) if radius > 0.0 and np.abs(reach - radius).max() < OVAL * radius else None


def _shift_of_most(off: np.ndarray, flat: np.ndarray) -> np.ndarray | None:
    """(K,) bool: rays that end where they would on the body after the shift that most of them tell."""
    rng = np.random.default_rng(0)
    near = np.flatnonzero(np.abs(off) < MOST_OFF)
    if len(near) < LEAST_RAYS:
        return None
    picked = near[rng.integers(0, len(near), (TRIES, 2))]
    rows = flat[picked]
    right = np.abs(np.linalg.det(rows)) > 0.1
    if not right.any():
        return None
    shifts = np.linalg.solve(rows[right], off[picked][right][..., None])[..., 0]
    some = rng.permutation(near)[:TRIED]
    best = shifts[np.argmax(np.sum(np.abs(off[some] - shifts @ flat[some].T) < IN_PLACE / 2, axis=1))]
    on = np.abs(off - flat @ best) < IN_PLACE / 2
    # As of a face: less than half of it is something that stands before it.
    return on if on.sum() >= max(LEAST_RAYS, STANDS * np.sum(off < MOST_OFF)) else None
