"""Warp device code that fits planes to where rays and their neighbours end. No NumPy. Metres, one frame for all."""

import warp as wp

wp.set_module_options({"enable_backward": False})

NOWHERE = wp.constant(1e30)  # [m] a ray that ends no nearer did not come back
ROUNDS = wp.constant(3)  # of fits, at most, each to what lies on the plane before
MOST = 64  # neighbours: one bit of a uint64 each
STEEP = wp.constant(3.7)  # tangent of the incidence up to which neighbours are tried first
FEW = wp.constant(6)  # rays on a plane, below which another one is sought
ALONE = wp.constant(8)  # rays as far away that make one: by chance there are some
LEAST_COSINE = wp.constant(0.2)  # of the angle to a neighbour, which tells of the plane
RIDGE = wp.constant(wp.float64(1e-6))  # keeps the plane level across neighbours that are all in one line


@wp.struct
class Rays:
    """P rays from one place, and the neighbours of S of them."""

    direction: wp.array[wp.vec3]  # (P,) unit vectors
    distance: wp.array[wp.float32]  # (P,) [m]
    margin: wp.array[wp.float32]  # (P,) [m] within which this range is that of a plane
    chosen: wp.array[wp.int32]  # (S,) of P
    neighbour: wp.array2d[wp.int32]  # (S, K) of P, the chosen ray itself among them


@wp.struct
class Tangent:
    """The plane that touches the unit sphere at one ray's direction; on it, inverse ranges of planes are affine."""

    own: wp.vec3  # that direction
    first: wp.vec3  # and two unit vectors across it
    second: wp.vec3
    scale: float  # the inverse of the chord to the farthest neighbour, the unit of places on it


@wp.func
def aside_of(own: wp.vec3):
    """A unit vector across a direction."""
    other = wp.vec3(0.0, 0.0, 1.0)
    if wp.abs(own[2]) > 0.9:
        other = wp.vec3(1.0, 0.0, 0.0)
    return wp.normalize(wp.cross(other, own))


@wp.func
def tangent_of(rays: Rays, row: int):
    """The plane at a chosen ray."""
    tangent = Tangent()
    tangent.own = rays.direction[rays.chosen[row]]
    tangent.first = aside_of(tangent.own)
    tangent.second = wp.cross(tangent.own, tangent.first)
    widest = float(1e-6)
    for at in range(rays.neighbour.shape[1]):
        widest = wp.max(widest, wp.length(rays.direction[rays.neighbour[row, at]] - tangent.own))
    tangent.scale = 1.0 / widest
    return tangent


@wp.func
def crossing(tangent: Tangent, toward: wp.vec3, cosine: float):
    """1, and where a direction crosses the tangent plane."""
    return wp.vec3d(
        wp.float64(1.0),
        wp.float64(wp.dot(toward, tangent.first) / cosine * tangent.scale),
        wp.float64(wp.dot(toward, tangent.second) / cosine * tangent.scale),
    )


@wp.func
def within_reach(rays: Rays, one: int, other: int, steep: float):
    """Whether a surface of this slope [m/m] could go from the end of one ray to that of another."""
    margin = (rays.margin[one] + rays.margin[other]) / wp.sqrt(2.0)
    apart = rays.distance[one] * wp.length(rays.direction[other] - rays.direction[one])
    return wp.abs(rays.distance[other] - rays.distance[one]) <= margin + steep * apart


@wp.func
def bit(at: int):
    return wp.uint64(1) << wp.uint64(at)


@wp.func
def reached(rays: Rays, row: int, tangent: Tangent, steep: float):
    """Which neighbours a surface of this slope [m/m] could reach: a bit each."""
    which = wp.uint64(0)
    for at in range(rays.neighbour.shape[1]):
        ray = rays.neighbour[row, at]
        if wp.dot(rays.direction[ray], tangent.own) > LEAST_COSINE:
            if within_reach(rays, rays.chosen[row], ray, steep):
                which |= bit(at)
    return which


@wp.func
def lying(rays: Rays, row: int, tangent: Tangent, plane: wp.vec3d):
    """Which neighbours lie on a plane: a bit each."""
    which = wp.uint64(0)
    for at in range(rays.neighbour.shape[1]):
        ray = rays.neighbour[row, at]
        toward = rays.direction[ray]
        cosine = wp.dot(toward, tangent.own)
        if cosine > LEAST_COSINE:
            inverse = float(wp.dot(plane, crossing(tangent, toward, cosine))) * cosine
            if inverse > 1e-6:
                if wp.abs(rays.distance[ray] - 1.0 / inverse) <= rays.margin[ray]:
                    which |= bit(at)
    return which


@wp.func
def plane_of(rays: Rays, row: int, tangent: Tangent, which: wp.uint64):
    """The plane of some neighbours, a bit each, by least squares: the inverse range along the ray, and its slopes."""
    moments = wp.mat33d()
    right = wp.vec3d()
    many = int(0)
    for at in range(rays.neighbour.shape[1]):
        if (which & bit(at)) != wp.uint64(0):
            ray = rays.neighbour[row, at]
            toward = rays.direction[ray]
            cosine = wp.dot(toward, tangent.own)
            axes = crossing(tangent, toward, cosine)
            moments += wp.outer(axes, axes)
            right += axes / (wp.float64(rays.distance[ray]) * wp.float64(cosine))
            many += 1
    moments[1, 1] += RIDGE * wp.float64(many)
    moments[2, 2] += RIDGE * wp.float64(many)
    return wp.inverse(moments) * right


@wp.func
def support_of(rays: Rays, row: int, which: wp.uint64):
    """How many bits are set; 0 where that of the ray itself is not."""
    many = int(0)
    itself = int(0)
    for at in range(rays.neighbour.shape[1]):
        if (which & bit(at)) != wp.uint64(0):
            many += 1
            if rays.neighbour[row, at] == rays.chosen[row]:
                itself = 1
    return many * itself


@wp.func
def fit(rays: Rays, row: int, tangent: Tangent, steep: float):
    """The range at which a chosen ray meets the plane, and how many rays lie on it; 0 where it does not itself.

    The fit begins with the neighbours that a surface of this slope [m/m] could reach, and ends when those on it stay
    the same, or after ROUNDS. n . x = h along x = r d is 1 / r = (n / h) . d: where directions cross the plane that
    touches the unit sphere at the chosen one, the inverse range is affine.
    """
    plane = wp.vec3d()
    which = reached(rays, row, tangent, steep)
    before = wp.uint64(0)
    turn = int(0)
    while turn < ROUNDS and which != before and which != wp.uint64(0):
        plane = plane_of(rays, row, tangent, which)
        before = which
        which = lying(rays, row, tangent, plane)
        turn += 1
    settled = rays.distance[rays.chosen[row]]
    if plane[0] > wp.float64(1e-6):
        settled = float(wp.float64(1.0) / plane[0])
    return settled, support_of(rays, row, which)


@wp.func
def beside(rays: Rays, row: int):
    """How many neighbours a surface of 45 degrees could reach, round or not."""
    many = int(0)
    for at in range(rays.neighbour.shape[1]):
        if within_reach(rays, rays.chosen[row], rays.neighbour[row, at], 1.0):
            many += 1
    return many


@wp.kernel
def settle(first: int, rays: Rays, distance: wp.array[wp.float32], support: wp.array[wp.int32]):
    """The plane of each chosen ray. One thread a ray.

    Before a wall that is near, a narrow thing takes the wall's rays for its own, and loses itself: then what is as far
    away as the ray is tried alone. What is on no plane but has enough beside it, as of a shaft, stays where it is.
    """
    row = first + wp.tid()
    if rays.distance[rays.chosen[row]] >= NOWHERE:
        distance[row] = rays.distance[rays.chosen[row]]
        support[row] = 0
        return
    tangent = tangent_of(rays, row)
    settled, many = fit(rays, row, tangent, STEEP)
    if many < FEW:
        again, more = fit(rays, row, tangent, 0.0)
        if more < ALONE:
            again = rays.distance[rays.chosen[row]]
            more = beside(rays, row)
        if more >= ALONE:
            settled = again
            many = more
    distance[row] = settled
    support[row] = many
