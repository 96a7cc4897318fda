"""Registration: the small motion that lays a robot scan, taken from about where it is believed, upon the prior.

World frame: metres, z up. N points of the scan. Motions are (4, 4) rigid transforms of the scan about the place of the
sensor. Surfaces that changed have nothing to lie upon: they are left out by how far off they are, first roughly, then
narrowly. What the surfaces leave open (along a corridor, or before one bare wall) stays as it was believed; and so does
a scan that hardly fits better elsewhere, whatever of it does not fit.

What counts are surfaces, not points: where a wall moved, or was removed and another one shows behind it, one surface
changed, and all others lie where they are believed to be; where the pose is off, all changed. Floors and large walls,
which fit after many a motion, must not outvote what tells motions apart. Where one surface alone would move a scan far,
it may as well be new, or have moved: then the scan stays, and that motion is its rival.
"""

from typing import NamedTuple

import numpy as np
import small_gicp
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from jaxmm.rays.open_directions import GIVEN, information, open_directions
from jaxmm.rays.scales import Scale, Surfaces, changed_of, scale_of, surfaces_off
from jaxmm.vectors import lengths

SPACING = 0.1  # [m] both clouds are thinned to it
NEIGHBOURS = 15  # that tell the normal of a point
# Reaches [m] within which points are matched, one after the other; which is right depends on how far off the start is.
LADDERS = ((0.2, 0.1), (0.5, 0.2, 0.1), (1.0, 0.5, 0.2, 0.1))
CUT = 0.1  # [m] farther off a surface, a point counts as no match
CLOSE = 0.03  # [m] off it, up to which it lies closely
UPRIGHT = 0.3  # a surface whose normal rises by less stands
ALIKE = 0.9  # cosine of the angle between the normals of one surface, at least
LEAST_WALLS = 30  # points, that must match walls to tell so
MOST_LEFT = 0.5  # share of what lies closely on walls at the start, that is on none after a motion to believe
FAR = 1.5  # surfaces that changed are as likely as a motion far beyond: one that fits moves no scan far
MOST_SHIFT, MOST_TURN = 0.8, np.radians(16.0)  # [m], [rad] beyond which a pose is of another place
TOLD, DEEP = 600, 0.15  # points that tell how many are on a plane, and [m] within which they are
LEAST_SURFACE = 30  # points of 0.1 m that are a surface; fewer are as much less of one
FINE = 0.05  # [m] off a surface, at which a point counts as no match where it is asked whether a scan stays
STAYS = 0.25  # surfaces that must lie better, for a motion in plan
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
    rival: Rival | None = None  # one, if there is
    left: float = 0.0  # share of its points that lay closely on walls at the start, that lie on none any more
    open: tuple[tuple[float, float, float], ...] = ()  # directions along which nothing holds its place
    gained: float = 0.0  # surfaces that lie better on the prior than at the start
    weakest: tuple[float, float, float] = (0.0, 0.0, 0.0)  # direction in plan along which fewest walls tell its place
    telling: float = np.inf  # how many do
    scale: Scale | None = None  # a size at which it fits better, if there is


class _Clouds(NamedTuple):
    """What is laid upon what: N thinned points about the eye."""

    points: np.ndarray  # (N, 3) [m] of the scan
    normals: np.ndarray  # (N, 3) unit vectors
    weight: np.ndarray  # (N,) that sum to 1 on each surface
    target: small_gicp.PointCloud  # the prior
    tree: small_gicp.KdTree  # of it


class _Fit(NamedTuple):
    """How the scan lies on the prior after some motion; its thinned points (N,)."""

    motion: np.ndarray  # (4, 4)
    weight: np.ndarray  # (N,) that sum to 1 on each surface
    off: np.ndarray  # (N,) [m] off the surface next to each, inf where none is near
    wall: np.ndarray  # (N,) bool: points on walls and the like
    on_wall: np.ndarray  # (N,) bool: of those, the points that match a wall
    matches: np.ndarray  # (N,) bool: points that match a surface as steep as theirs

    def changed(self, cut: float = CUT) -> float:
        """Surfaces that do not lie on the prior: up to `cut` [m] off it they count as 0 to 1, beyond as 1."""
        return surfaces_off(self.weight, self.off, cut)

    @property
    def cost(self) -> float:
        """Surfaces that changed; a far motion counts as up to FAR of them."""
        return self.changed() + _far(self.motion)

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


def register(
    scan: np.ndarray,
    prior: np.ndarray,
    sensor: np.ndarray,
    *,
    in_sight_only: bool = False,
    zero: np.ndarray | None = None,
) -> Registration:
    """Fit a scan to the prior (GICP: Segal et al. 2009; open directions as in Zhang et al. 2016).

    Args:
        scan: (N, 3) [m] world, as believed.
        prior: (M, 3) [m] world, what the prior shows from there, densely.
        sensor: (3,) [m] where the scan is believed to be taken from; motions turn about it.
        in_sight_only: whether the prior holds only what is in sight from there, as a scan does: walls behind that, or
            beside it, are then no sign of another place, and are not asked whether they match.
        zero: (3,) [m] of the frame that the scan's file is in; None: nobody asks whether it fits at another size.

    Returns:
        The motion; none where either cloud has too few points to tell.
    """
    centre = np.asarray(sensor, np.float64)
    target, tree = _prepared(prior, centre)
    source, _ = _prepared(scan, centre)
    if min(target.size(), source.size()) < 4 * NEIGHBOURS:
        return Registration(np.eye(4), np.nan, np.nan, 0.0, 0.0, np.nan, np.nan, 0.0)
    points, normals = source.points()[:, :3], source.normals()[:, :3]
    clouds = _Clouds(points, normals, _weights(points, normals), target, tree)
    motions = [_as_believed(clouds, _climbed(source, clouds, ladder)) for ladder in LADDERS]
    motions = [motion for motion in motions if np.isfinite(_far(motion))]
    free = [_fit(clouds, motion) for motion in motions]
    level = [_fit(clouds, motion) for motion in (np.eye(4), *map(_upright_part, motions))]
    start, found = level[0], _best(level, free)
    about = _shifted(centre) @ found.motion @ _shifted(-centre)
    moved, asked = _moved(points, found.motion), found
    if in_sight_only:
        asked = found._replace(wall=found.wall & _could_show(target.points()[:, :3], moved))
    share = float(asked.wall.sum() / found.wall.sum()) if found.wall.any() else np.nan
    facing = normals @ found.motion[:3, :3].T
    return Registration(
        about, found.residual, start.residual, found.overlap, start.overlap, asked.upright, share, asked.closely,
        _on_one_plane(points, normals), _rival_of([*level, *free], found), _left(start, found),
        open_directions(moved[found.matches], facing[found.matches], found.residual),
        start.changed() - found.changed(), *_weakest(facing[found.on_wall], clouds.weight[found.on_wall]),
        None if zero is None else _scale_of(clouds, [*level, *free], found, np.asarray(zero, np.float64) - centre),
    )  # fmt: skip


def _scale_of(clouds: _Clouds, fits: list[_Fit], found: _Fit, zero: np.ndarray) -> Scale | None:
    """The size at which a scan fits better than by any motion, about the zero (3,) [m] of its frame or elsewhere."""
    prior, facing = clouds.target.points()[:, :3], clouds.target.normals()[:, :3]
    seen = Surfaces(*clouds[:3], prior, facing, cKDTree(prior))
    least = min(changed_of(seen, fit.motion[:3, :3], fit.motion[:3, 3]) for fit in fits)
    motions = [fits[0].motion] if found is fits[0] else [fits[0].motion, found.motion]
    return scale_of(seen, motions, least, zero)


def _weakest(normals: np.ndarray, weight: np.ndarray) -> tuple[tuple[float, float, float], float]:
    """The direction in plan along which fewest walls tell where a scan is, and how many: of points on them (n, 3)."""
    told, ways = np.linalg.eigh((normals[:, :2] * weight[:, None]).T @ normals[:, :2])
    return (float(ways[0, 0]), float(ways[1, 0]), 0.0), float(told[0])


def _climbed(source: small_gicp.PointCloud, clouds: _Clouds, ladder: tuple[float, ...]) -> np.ndarray:
    """The motion (4, 4) that GICP ends at, within one reach [m] after the other."""
    motion = np.eye(4)
    for reach in ladder:
        motion = small_gicp.align(
            clouds.target, source, clouds.tree, motion, registration_type="GICP", max_correspondence_distance=reach,
            max_iterations=30,
        ).T_target_source  # fmt: skip
    return motion


def _best(level: list[_Fit], free: list[_Fit]) -> _Fit:
    """The cheapest fit; of those without a step in plan, the first of which is the start, unless others fit better."""
    best, stays = min([*level, *free], key=lambda fit: fit.cost), min(level, key=lambda fit: fit.cost)
    if stays.changed(FINE) > best.changed(FINE) + _far(best.motion) + STAYS:
        return best
    # Nor does what lies closely come off it.
    return min(level[0], stays, key=lambda fit: fit.changed(CLOSE) + _far(fit.motion))


def _could_show(prior: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether a prior (M, 3) lies in the direction of each point (N, 3), and none before it: [m] about the eye."""
    far, near = (np.maximum(lengths(cloud)[:, None], 1e-6) for cloud in (prior, points))
    apart, place = cKDTree(prior / far).query(points / near, k=AROUND)
    reach = np.where(apart * far[place, 0] <= BESIDE, far[place, 0], np.inf).min(axis=1)
    return np.isfinite(reach) & (reach >= near[:, 0] - BEFORE)


def _moved(points: np.ndarray, motion: np.ndarray) -> np.ndarray:
    return points @ motion[:3, :3].T + motion[:3, 3]


def _prepared(points: np.ndarray, centre: np.ndarray):
    points = np.ascontiguousarray(np.asarray(points, np.float64) - centre)
    return small_gicp.preprocess_points(points, downsampling_resolution=SPACING, num_neighbors=NEIGHBOURS)


def _off(clouds: _Clouds, motion: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every moved point: how far (N,) off the surface next to it, [m] inf where none is near; it, and the normal."""
    moved = _moved(clouds.points, motion)
    place, square = clouds.tree.batch_nearest_neighbor_search(np.column_stack([moved, np.ones(len(moved))]))
    place = np.asarray(place)
    normal = clouds.target.normals()[place, :3]
    off = np.einsum("nc,nc->n", moved - clouds.target.points()[place, :3], normal)
    return np.where(np.asarray(square) < (2 * SPACING) ** 2, off, np.inf), moved, normal


def _fit(clouds: _Clouds, motion: np.ndarray) -> _Fit:
    """How the scan lies after a motion."""
    off, _, facing = _off(clouds, motion)
    normals = clouds.normals @ motion[:3, :3].T
    wall = np.abs(normals[:, 2]) < UPRIGHT
    alike = np.abs(np.einsum("nc,nc->n", normals, facing)) > ALIKE
    matches = alike & (np.abs(off) < CUT)
    return _Fit(motion, clouds.weight, off, wall, wall & matches, matches)


def _left(start: _Fit, best: _Fit) -> float:
    """Share of the points closely on walls at the start that a motion leaves on none; 0 where they are too few."""
    close = start.upon(CLOSE)
    return float(np.mean(~best.on_wall[close])) if close.sum() >= LEAST_WALLS else 0.0


def _rival_of(fits: list[_Fit], found: _Fit) -> Rival | None:
    """The fit with most surfaces upon the prior, if these are more than was found, and it is elsewhere."""
    there = min(fits, key=lambda fit: fit.changed())
    more = found.changed() - there.changed()
    step = there.motion[:3, 3] - found.motion[:3, 3]
    turn = float(np.linalg.norm(_step_of(there.motion @ np.linalg.inv(found.motion))[3:]))
    if more < RIVALS or (np.linalg.norm(step) < RIVAL_SHIFT and turn < RIVAL_TURN):
        return None
    return Rival(tuple(float(one) for one in step), turn, more, there.residual, there.overlap, there.upright)


def _on_one_plane(points: np.ndarray, normals: np.ndarray) -> float:
    """The largest share of points (N, 3), with normals (N, 3), that one upright plane holds, of some that are tried."""
    upright = np.flatnonzero(np.abs(normals[:, 2]) < UPRIGHT)
    tried = upright[:: max(1, len(upright) // TRIED)]
    facing = normals[:, :2] / np.maximum(lengths(normals[:, :2])[:, None], 1e-9)

    def share(one: int) -> float:
        near = np.abs((points[:, :2] - points[one, :2]) @ facing[one]) < CUT
        alike = np.abs(facing @ facing[one]) > LONE_WAY
        return float(np.mean(near & alike & (np.abs(normals[:, 2]) < UPRIGHT)))

    return max(map(share, tried), default=0.0)


def _upright_part(motion: np.ndarray) -> np.ndarray:
    """What of a motion raises and tilts, without its step and turn in plan."""
    step = _step_of(motion)
    kept = np.eye(4)
    kept[:3, :3], kept[2, 3] = Rotation.from_rotvec([*step[3:5], 0.0]).as_matrix(), step[2]
    return kept


def _far(motion: np.ndarray) -> float:
    """What a motion costs, in surfaces that changed: half a metre is as likely as a third; inf if it is not near."""
    step = _step_of(motion)
    if not is_near(np.linalg.norm(step[:3]), np.linalg.norm(step[3:])):
        return np.inf
    return FAR * float(1.0 - np.exp(-0.5 * np.sum(np.square(step / GIVEN))))


def is_near(shift: float, turn: float) -> bool:
    """Whether a pose may be off by so much [m], [rad]; if by more, it is of another place."""
    return bool(shift <= MOST_SHIFT and turn <= MOST_TURN)


def _weights(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Weights (N,) of points (N, 3) that sum to 1 on each plane of enough of them."""
    some = np.random.default_rng(0).permutation(len(points))[:TOLD]
    size = np.zeros(len(points))
    for part in np.array_split(np.arange(len(points)), len(points) // 2000 + 1):
        deep = np.abs(np.einsum("nc,nc->n", normals[part], points[part])[:, None] - normals[part] @ points[some].T)
        size[part] = np.count_nonzero((np.abs(normals[part] @ normals[some].T) > ALIKE) & (deep < DEEP), axis=1)
    return 1.0 / np.maximum(size * (len(points) / len(some)), LEAST_SURFACE)


def _as_believed(clouds: _Clouds, motion: np.ndarray) -> np.ndarray:
    """The motion as far as the surfaces tell it, and none in the directions that they leave open."""
    off, moved, normal = _off(clouds, motion)
    match = np.abs(off) < CUT
    if not match.any():
        return np.eye(4)
    sigma = max(LEAST_SIGMA, 1.4826 * float(np.median(np.abs(off[match]))))
    told = information(moved[match], normal[match], sigma)
    step = np.linalg.solve(told + np.diag(1.0 / np.square(GIVEN)), told @ _step_of(motion))
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
