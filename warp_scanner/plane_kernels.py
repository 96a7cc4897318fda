"""Warp device code that fits planes to where rays and their neighbours end. No NumPy. Metres, one frame for all."""

import warp as wp

wp.set_module_options({"enable_backward": False})

NOWHERE = wp.constant(1e30)  # [m] a ray that ends no nearer did not come back
ROUNDS = wp.constant(3)  # of fits, each to what lies on the plane before
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


@wp.func
def aside_of(own: wp.vec3):
    """A unit vector across a direction."""
    other = wp.vec3(0.0, 0.0, 1.0)
    if wp.abs(own[2]) > 0.9:
        other = wp.vec3(1.0, 0.0, 0.0)
    return wp.normalize(wp.cross(other, own))


@wp.func
def width_of(rays: Rays, row: int):
    """The chord to the farthest neighbour."""
    own = rays.direction[rays.chosen[row]]
    widest = float(1e-6)
    for at in range(rays.neighbour.shape[1]):
        widest = wp.max(widest, wp.length(rays.direction[rays.neighbour[row, at]] - own))
    return widest


@wp.func
def within_reach(rays: Rays, one: int, other: int, steep: float):
    """Whether a surface of this slope [m/m] could go from the end of one ray to that of another."""
    margin = (rays.margin[one] + rays.margin[other]) / wp.sqrt(2.0)
    apart = rays.distance[one] * wp.length(rays.direction[other] - rays.direction[one])
    return wp.abs(rays.distance[other] - rays.distance[one]) <= margin + steep * apart


@wp.func
def fit(rays: Rays, row: int, steep: float):
    """The range at which a chosen ray meets the plane, and how many rays lie on it; 0 where it does not itself.

    The fit begins with the neighbours that a surface of this slope [m/m] could reach. n . x = h along x = r d is
    1 / r = (n / h) . d: where directions cross the plane that touches the unit sphere at the chosen one, the inverse
    range is affine.
    """
    chosen = rays.chosen[row]
    own = rays.direction[chosen]
    reach = rays.distance[chosen]
    first = aside_of(own)
    second = wp.cross(own, first)
    scale = 1.0 / width_of(rays, row)
    plane = wp.vec3d()
    support = int(0)
    for turn in range(ROUNDS + 1):
        moments = wp.mat33d()
        right = wp.vec3d()
        many = int(0)
        itself = int(0)
        for at in range(rays.neighbour.shape[1]):
            ray = rays.neighbour[row, at]
            toward = rays.direction[ray]
            found = rays.distance[ray]
            cosine = wp.dot(toward, own)
            if cosine > LEAST_COSINE:
                axes = wp.vec3d(
                    wp.float64(1.0),
                    wp.float64(wp.dot(toward, first) / cosine * scale),
                    wp.float64(wp.dot(toward, second) / cosine * scale),
                )
                lies = False
                if turn == 0:
                    lies = within_reach(rays, chosen, ray, steep)
                else:
                    inverse = float(wp.dot(plane, axes)) * cosine
                    if inverse > 1e-6:
                        lies = wp.abs(found - 1.0 / inverse) <= rays.margin[ray]
                if lies:
                    many += 1
                    if ray == chosen:
                        itself = 1
                    moments += wp.outer(axes, axes)
                    right += axes / (wp.float64(found) * wp.float64(cosine))
        if turn == ROUNDS:
            support = many * itself
        elif many > 0:
            moments[1, 1] += RIDGE * wp.float64(many)
            moments[2, 2] += RIDGE * wp.float64(many)
            plane = wp.inverse(moments) * right
    settled = reach
    if plane[0] > wp.float64(1e-6):
        settled = float(wp.float64(1.0) / plane[0])
    return settled, support


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
    settled, many = fit(rays, row, STEEP)
    if many < FEW:
        again, more = fit(rays, row, 0.0)
        if more < ALONE:
            again = rays.distance[rays.chosen[row]]
            more = beside(rays, row)
        if more >= ALONE:
            settled = again
            many = more
    distance[row] = settled
    support[row] = many
