"""Registration: the small motion that lays a robot scan, taken from about where it is believed, upon the prior.

World frame: metres, z up. N points of the scan. Motions are (4, 4) rigid transforms of the scan about the place of the
sensor. Surfaces that changed have nothing to lie upon: they are left out by how far off they are, first roughly, then
narrowly. What the surfaces leave open (along a corridor, or before one bare wall) stays as it was believed; and so does
a scan whose walls lie upon the prior's from the start, whatever else of it does not. Where one wall alone would move a
scan far, without a turn, it may as well be new, or have moved: then `held` is the motion without its step in plan.
"""

from typing import NamedTuple

import numpy as np
import small_gicp
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from jaxmm.rays.open_directions import open_directions

SPACING = 0.1  # [m] both clouds are thinned to it
NEIGHBOURS = 15  # that tell the normal of a point
# Reaches [m] within which points are matched, one after the other; which is right depends on how far off the start is.
LADDERS = ((0.2, 0.1), (0.5, 0.2, 0.1), (1.0, 0.5, 0.2, 0.1))
CUT = 0.1  # [m] farther off a surface, a point counts as no match
CLOSE, UPON = 0.03, 0.015  # [m] off it, up to which it lies closely, and as points of an exact pose do
UPRIGHT = 0.3  # a surface whose normal rises by less stands
ALIKE = 0.9  # cosine of the angle between the normals of one surface, at least
LEAST_WALLS = 30  # points, that must match walls to tell so
MOST_LEFT = 0.5  # share of what lies closely on walls at the start, that is on none after a motion to believe
FAR = 1.5  # surfaces that changed are as likely as a motion far beyond: one that fits moves no scan far
GIVEN = (0.2, 0.2, 0.2, 0.04, 0.04, 0.1)  # [m, rad] standard deviations of poses that are given
MOST_SHIFT, MOST_TURN = 0.8, np.radians(16.0)  # [m], [rad] beyond which a pose is of another place
TOLD, DEEP = 600, 0.15  # points that tell how many are on a plane, and [m] within which they are
LEAST_SURFACE = 30  # points of 0.1 m that are a surface; fewer are as much less of one
FINE = 0.05  # [m] off a surface, at which a point counts as no match where it is asked whether a scan stays
STAYS = 0.25  # surfaces that must lie better, for a motion in plan
WORTH = 0.02  # neighbouring points err alike: so many independent ones is each worth
RIVALS = 0.4  # surfaces more on the prior than where a scan was left, from which on another motion is worth a word
RIVAL_SHIFT, RIVAL_TURN = 0.05, np.radians(1.0)  # [m], [rad] by which it is another one
LONE_WAY = 0.95  # cosine of the angle between normals of one upright plane, at least
TRIED = 50  # planes, as wide as CUT to either side, of which one may hold most of a scan
AROUND, BESIDE = 8, 0.15  # points of a prior about a line of sight, and [m] off it: they say what it meets there
BEFORE = 0.3  # [m] before a point, from where on they hide it
LEAST_SIGMA = 0.005  # [m] of a point off its surface


class Rival(NamedTuple):
    """Another motion that would lay more surfaces upon the prior, and was not believed."""

    step: tuple[float, float, float]  # [m] of the sensor
    turn: float  # [rad]
    surfaces: float  # that would lie there, and now do not
    residual: float  # [m] of what then matches
    overlap: float  # share of the points that then match
    upright: float  # and of those on walls


class Registration(NamedTuple):
    """What moved a scan, and how well it then fits."""

    motion: np.ndarray  # (4, 4) float64: world points of the scan as believed -> as they fit the prior
    residual: float  # [m] robust standard deviation of the distances to the prior's surface, of what matches
    residual_before: float  # the same at the start; both NaN where nothing matches
    overlap: float  # share of the scan's points that match
    overlap_before: float  # the same at the start
    upright: float  # of its points on walls and the like that are asked, the share that match walls; NaN without any
    asked: float  # share of its points on walls that are asked: 1, or those that the prior could show; NaN without any
    closely: float  # `upright` less what may match by chance: 0 where that may be all but a few points
    lone: float = 0.0  # share of its points that lie on one upright plane
    rival: Rival | None = None
    left: float = 0.0  # share of its points that lay closely on walls at the start, that lie on none any more
    open: tuple[tuple[float, float, float], ...] = ()  # directions along which nothing holds its place


class _Fit(NamedTuple):
    """How the scan lies on the prior after some motion; its thinned points (N,)."""

    off: np.ndarray  # (N,) [m] off the surface next to each, inf where none is near
    wall: np.ndarray  # (N,) bool: points on walls and the like
    on_wall: np.ndarray  # (N,) bool: of those, the points that match a wall
    matches: np.ndarray  # (N,) bool: points that match a surface as steep as theirs

    def upon(self, most: float) -> np.ndarray:
        """(N,) bool: points that match a wall and are at most so far [m] off it."""
        return self.on_wall & (np.abs(self.off) < most)

    @property
    def overlap(self) -> float:
        return float(np.mean(np.abs(self.off) < CUT))

    @property
    def residual(self) -> float:
        match = np.abs(self.off) < CUT
        return 1.4826 * float(np.median(np.abs(self.off[match]))) if match.any() else np.nan

    @property
    def upright(self) -> float:
        return float(self.on_wall[self.wall].mean()) if self.wall.any() else np.nan

    @property
    def closely(self) -> float:
        """Share of the points on walls that lies close to walls, less as many as lie about walls, but not close.

        What a wall of another place happens to cross lies as often in the outer half of CUT as in the inner one; but a
        wall that the motion drew onto another counts, and walls that are built a little off leave nothing. 0 where
        fewer than LEAST_WALLS points are left.
        """
        off = np.abs(self.off[self.wall & self.on_wall])
        left = int(np.sum(off < CUT / 2) - np.sum(off >= CUT / 2))
        return left / int(self.wall.sum()) if left >= LEAST_WALLS else 0.0


def register(scan: np.ndarray, prior: np.ndarray, sensor: np.ndarray, *, in_sight_only: bool = False) -> Registration:
    """Fit a scan to the prior (GICP: Segal et al. 2009; open directions as in Zhang et al. 2016).

    Args:
        scan: (N, 3) [m] world, as believed.
        prior: (M, 3) [m] world, what the prior shows from there, densely.
        sensor: (3,) [m] where the scan is believed to be taken from; motions turn about it.
        in_sight_only: whether the prior holds only what is in sight from there, as a scan does: walls behind that, or
            beside it, are then no sign of another place, and are not asked whether they match.

    Returns:
        The motion; none where either cloud has too few points to tell.
    """
    centre = np.asarray(sensor, np.float64)
    target, tree = _prepared(prior, centre)
    source, _ = _prepared(scan, centre)
    if min(target.size(), source.size()) < 4 * NEIGHBOURS:
        return Registration(np.eye(4), np.nan, np.nan, 0.0, 0.0, np.nan, np.nan, 0.0)
    cloud = (source.points()[:, :3], target, tree, _weights(source.points()[:, :3], source.normals()[:, :3]))
    motions = [np.eye(4)]
    for ladder in LADDERS:
        motion = np.eye(4)
        for reach in ladder:
            motion = small_gicp.align(
                target, source, tree, motion, registration_type="GICP", max_correspondence_distance=reach,
                max_iterations=30,
            ).T_target_source  # fmt: skip
        motions.append(_as_believed(cloud, motion))
    normals = source.normals()[:, :3]
    start = _fit(cloud, normals, np.eye(4))
    motions += [_upright_part(motion) for motion in motions[1:]]
    best = _cheapest(cloud, motions)
    stays = _cheapest(cloud, [motion for motion in motions if not _moves_in_plan(motion)])
    if _changed(cloud, stays, FINE) <= _changed(cloud, best, FINE) + _far(best) + STAYS:
        best = _cheapest(cloud, [np.eye(4), stays], CLOSE)  # nor does what lies closely come off it
    found = _fit(cloud, normals, best)
    about = _shifted(centre) @ best @ _shifted(-centre)
    asked = found
    if in_sight_only:
        asked = found._replace(wall=found.wall & _could_show(target.points()[:, :3], _moved(cloud[0], best)))
    share = float(asked.wall.sum() / found.wall.sum()) if found.wall.any() else np.nan
    rival = _rival_of(cloud, normals, motions, best)
    return Registration(
        about, found.residual, start.residual, found.overlap, start.overlap, asked.upright, share, asked.closely,
        _on_one_plane(cloud[0], normals), rival, _left(start, found),
        open_directions(_moved(cloud[0], best)[found.matches], normals[found.matches] @ best[:3, :3].T, found.residual),
    )  # fmt: skip


def _could_show(prior: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether a prior (M, 3) lies in the direction of each point (N, 3), and none before it: [m] about the eye."""
    far, near = (np.maximum(np.linalg.norm(cloud, axis=1, keepdims=True), 1e-6) for cloud in (prior, points))
    apart, place = cKDTree(prior / far).query(points / near, k=AROUND)
    reach = np.where(apart * far[place, 0] <= BESIDE, far[place, 0], np.inf).min(axis=1)
    return np.isfinite(reach) & (reach >= near[:, 0] - BEFORE)


def _moved(points: np.ndarray, motion: np.ndarray) -> np.ndarray:
    return points @ motion[:3, :3].T + motion[:3, 3]


def _prepared(points: np.ndarray, centre: np.ndarray):
    points = np.ascontiguousarray(np.asarray(points, np.float64) - centre)
    return small_gicp.preprocess_points(points, downsampling_resolution=SPACING, num_neighbors=NEIGHBOURS)


def _off(cloud: tuple, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every moved point: how far (N,) off the surface next to it, [m] inf where none is near; it, and the normal."""
    points, target, tree = cloud[:3]
    moved = _moved(points, motion)
    place, square = tree.batch_nearest_neighbor_search(np.column_stack([moved, np.ones(len(moved))]))
    place = np.asarray(place)
    normal = target.normals()[place, :3]
    off = np.einsum("nc,nc->n", moved - target.points()[place, :3], normal)
    return np.where(np.asarray(square) < (2 * SPACING) ** 2, off, np.inf), moved, normal


def _fit(cloud: tuple, normals: np.ndarray, motion: np.ndarray) -> _Fit:
    """How the scan, with normals (N, 3), lies after a motion."""
    off, _, facing = _off(cloud, motion)
    normals = normals @ motion[:3, :3].T
    wall = np.abs(normals[:, 2]) < UPRIGHT
    alike = np.abs(np.einsum("nc,nc->n", normals, facing)) > ALIKE
    matches = alike & (np.abs(off) < CUT)
    return _Fit(off, wall, wall & matches, matches)


def _left(start: _Fit, best: _Fit) -> float:
    """Share of the points closely on walls at the start that a motion leaves on none; 0 where they are too few."""
    close = start.upon(CLOSE)
    return float(np.mean(~best.on_wall[close])) if close.sum() >= LEAST_WALLS else 0.0


def _rival_of(cloud: tuple, normals: np.ndarray, motions: list[np.ndarray], best: np.ndarray) -> Rival | None:
    """The motion that lays most surfaces upon the prior, if these are more, and it ends elsewhere, than the best."""
    there = min((one for one in motions if np.isfinite(_far(one))), key=lambda one: _changed(cloud, one, CUT))
    more = _changed(cloud, best, CUT) - _changed(cloud, there, CUT)
    apart = _step_of(there @ np.linalg.inv(best))
    if more < RIVALS or (np.linalg.norm(apart[:3]) < RIVAL_SHIFT and np.linalg.norm(apart[3:]) < RIVAL_TURN):
        return None
    fit = _fit(cloud, normals, there)
    step, turn = tuple(float(one) for one in apart[:3]), float(np.linalg.norm(apart[3:]))
    return Rival(step, turn, more, fit.residual, fit.overlap, fit.upright)


def _on_one_plane(points: np.ndarray, normals: np.ndarray) -> float:
    """The largest share of points (N, 3), with normals (N, 3), that one upright plane holds, of some that are tried."""
    upright = np.flatnonzero(np.abs(normals[:, 2]) < UPRIGHT)
    tried = upright[:: max(1, len(upright) // TRIED)]
    facing = normals[:, :2] / np.maximum(np.linalg.norm(normals[:, :2], axis=1, keepdims=True), 1e-9)

    def share(one: int) -> float:
        near = np.abs((points[:, :2] - points[one, :2]) @ facing[one]) < CUT
        alike = np.abs(facing @ facing[one]) > LONE_WAY
        return float(np.mean(near & alike & (np.abs(normals[:, 2]) < UPRIGHT)))

    return max(map(share, tried), default=0.0)


def _moves_in_plan(motion: np.ndarray) -> bool:
    return bool(np.any(_step_of(motion)[[0, 1, 5]] != 0.0))


def _upright_part(motion: np.ndarray) -> np.ndarray:
    """What of a motion raises and tilts, without its step and turn in plan."""
    step = _step_of(motion)
    kept = np.eye(4)
    kept[:3, :3], kept[2, 3] = Rotation.from_rotvec([*step[3:5], 0.0]).as_matrix(), step[2]
    return kept


def _cheapest(cloud: tuple, motions: list[np.ndarray], cut: float = CUT) -> np.ndarray:
    """The motion that needs the fewest surfaces to have changed; far ones count as most of one.

    Where a wall moved, or was removed and another one shows behind it, one surface changed, and all others lie where
    they are believed to be; where the pose is off, all changed. So it is surfaces that count, not points: floors and
    large walls, which fit after many a motion, must not outvote what tells motions apart.
    """
    return min(motions, key=lambda motion: _changed(cloud, motion, cut) + _far(motion))


def _changed(cloud: tuple, motion: np.ndarray, cut: float) -> float:
    """Surfaces that do not lie on the prior after a motion: up to `cut` [m] off they count as 0 to 1, beyond as 1."""
    return float(cloud[3] @ np.minimum(np.square(_off(cloud, motion)[0] / cut), 1.0))


def _far(motion: np.ndarray) -> float:
    """What a motion costs, in surfaces that changed: half a metre is about as likely as a third."""
    step = _step_of(motion)
    if np.linalg.norm(step[:3]) > MOST_SHIFT or np.linalg.norm(step[3:]) > MOST_TURN:
        return np.inf
    return FAR * float(1.0 - np.exp(-0.5 * np.sum(np.square(step / GIVEN))))


def _weights(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Weights (N,) of points (N, 3) that sum to 1 on each plane of enough of them."""
    some = np.random.default_rng(0).permutation(len(points))[:TOLD]
    size = np.zeros(len(points))
    for part in np.array_split(np.arange(len(points)), len(points) // 2000 + 1):
        deep = np.abs(np.einsum("nc,nc->n", normals[part], points[part])[:, None] - normals[part] @ points[some].T)
        size[part] = np.count_nonzero((np.abs(normals[part] @ normals[some].T) > ALIKE) & (deep < DEEP), axis=1)
    return 1.0 / np.maximum(size * (len(points) / len(some)), LEAST_SURFACE)


def _as_believed(cloud: tuple, motion: np.ndarray) -> np.ndarray:
    """The motion as far as the surfaces tell it, and none in the directions that they leave open."""
    off, moved, normal = _off(cloud, motion)
    match = np.abs(off) < CUT
    if not match.any():
        return np.eye(4)
    sigma = max(LEAST_SIGMA, 1.4826 * float(np.median(np.abs(off[match]))))
    slope = np.column_stack([normal[match], np.cross(moved[match], normal[match])])
    told = slope.T @ slope * (WORTH / sigma**2)
    believed = np.diag(1.0 / np.square(GIVEN))
    step = np.linalg.solve(told + believed, told @ _step_of(motion))
    kept = np.eye(4)
    kept[:3, :3], kept[:3, 3] = Rotation.from_rotvec(step[3:]).as_matrix(), step[:3]
    return kept


def _step_of(motion: np.ndarray) -> np.ndarray:
    """Shift [m] and rotation vector [rad] (6,)."""
    return np.concatenate([motion[:3, 3], Rotation.from_matrix(motion[:3, :3]).as_rotvec()])


def _shifted(by: np.ndarray) -> np.ndarray:
    motion = np.eye(4)
    motion[:3, 3] = by
    return motion
