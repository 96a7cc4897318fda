"""Warp device code that fits planes to where rays and their neighbours end. No NumPy. Metres, one frame for all."""

import warp as wp

wp.set_module_options({"enable_backward": False})

ROUNDS = wp.constant(3)  # of fits, each to what lies on the plane before
STEEP = wp.constant(3.7)  # tangent of the incidence up to which neighbours are tried first
LEAST_COSINE = wp.constant(0.2)  # of the angle to a neighbour, which tells of the plane
RIDGE = wp.constant(wp.float64(1e-6))  # keeps the plane level across neighbours that are all in one line


@wp.struct
class Rays:
    """P rays from one place, and the neighbours of S of them."""

    direction: wp.array[wp.vec3]  # (P,) unit vectors
    distance: wp.array[wp.float32]  # (P,) [m]
    margin: wp.array[wp.float32]  # (P,) [m] within which a range is that of the plane
    chosen: wp.array[wp.int32]  # (S,) of P
    neighbour: wp.array2d[wp.int32]  # (S, K) of P, the chosen ray itself among them


@wp.func
def place_of(direction: wp.vec3, own: wp.vec3, scale: float):
    """Where a direction crosses the plane that touches the unit sphere at another: two axes, and the cosine."""
    aside = wp.vec3(0.0, 0.0, 1.0)
    if wp.abs(own[2]) > 0.9:
        aside = wp.vec3(1.0, 0.0, 0.0)
    first = wp.normalize(wp.cross(aside, own))
    second = wp.cross(own, first)
    cosine = wp.dot(direction, own)
    return wp.vec3(wp.dot(direction, first) / cosine * scale, wp.dot(direction, second) / cosine * scale, cosine)


@wp.kernel
def settle(first: int, rays: Rays, distance: wp.array[wp.float32], support: wp.array[wp.int32]):
    """The range at which each chosen ray meets the plane, and how many neighbours lie on it. One thread a ray.

    n . x = h along x = r d is 1 / r = (n / h) . d: the inverse range is affine in the two axes of `place_of`.
    """
    row = first + wp.tid()
    chosen = rays.chosen[row]
    own = rays.direction[chosen]
    reach = rays.distance[chosen]
    margin = rays.margin[chosen]
    count = rays.neighbour.shape[1]
    widest = float(1e-6)
    for at in range(count):
        widest = wp.max(widest, wp.length(rays.direction[rays.neighbour[row, at]] - own))
    scale = 1.0 / widest
    plane = wp.vec3d()
    for turn in range(ROUNDS + 1):
        moments = wp.mat33d()
        right = wp.vec3d()
        many = int(0)
        itself = int(0)
        for at in range(count):
            ray = rays.neighbour[row, at]
            found = rays.distance[ray]
            place = place_of(rays.direction[ray], own, scale)
            if place[2] > LEAST_COSINE:
                axes = wp.vec3d(wp.float64(1.0), wp.float64(place[0]), wp.float64(place[1]))
                lies = False
                if turn == 0:
                    apart = wp.length(rays.direction[ray] - own)
                    lies = wp.abs(found - reach) <= wp.sqrt(2.0) * margin + STEEP * reach * apart
                else:
                    inverse = float(wp.dot(plane, axes)) * place[2]
                    if inverse > 1e-6:
                        lies = wp.abs(found - 1.0 / inverse) <= margin
                if lies:
                    many += 1
                    if ray == chosen:
                        itself = 1
                    moments += wp.outer(axes, axes)
                    right += axes / (wp.float64(found) * wp.float64(place[2]))
        if turn == ROUNDS:
            support[row] = many * itself
        elif many > 0:
            moments[1, 1] += RIDGE * wp.float64(many)
            moments[2, 2] += RIDGE * wp.float64(many)
            plane = wp.inverse(moments) * right
    distance[row] = reach
    if plane[0] > wp.float64(1e-6):
        distance[row] = float(wp.float64(1.0) / plane[0])
