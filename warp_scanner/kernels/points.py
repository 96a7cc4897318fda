"""Warp device code that turns ranges into points, and picks those of tall objects. No NumPy. Metres, world frame."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.struct
class Ranges:
    """Scans of R rooms, P rays."""

    position: wp.array[wp.vec3]  # (R,)
    rotation: wp.array[wp.mat33]  # (R,) sensor frame to world
    direction: wp.array[wp.vec3]  # (P,) unit vectors, sensor frame
    distance: wp.array2d[wp.float32]  # (R, P), inf = no return
    element: wp.array2d[wp.int32]  # (R, P)


@wp.struct
class Heights:
    """What is known of the heights of E elements in each room, and the limits they are judged by."""

    floor: wp.array[wp.float32]  # (R,)
    ceiling: wp.array[wp.float32]  # (R,)
    threshold: wp.float32  # above the floor
    tolerance: wp.float32
    top: wp.array2d[wp.float32]  # (R, E)
    count: wp.array3d[wp.int32]  # (R, E, 5) returns: all, below the floor's band, up to its end, and so of the ceiling
    verdict: wp.array2d[wp.uint8]  # (R, E) 1 stays, 0 goes


@wp.struct
class Kept:
    """The points that stay, packed to the front of each room's row."""

    point: wp.array2d[wp.vec3]  # (R, P)
    pixel: wp.array2d[wp.int64]  # (R, P)
    count: wp.array[wp.int32]  # (R,)
    unsure: wp.array[wp.bool]  # (R,) some median cannot be told from the counts, and the other fields mean nothing


@wp.func
def point_at(scan: Ranges, room: int, ray: int):
    return scan.position[room] + scan.distance[room, ray] * (scan.rotation[room] * scan.direction[ray])


@wp.kernel
def find_points(first: int, scan: Ranges, point: wp.array2d[wp.vec3]):
    """The point of every ray; NaN for misses. One thread a room."""
    room = first + wp.tid()
    for ray in range(scan.direction.shape[0]):
        if wp.isfinite(scan.distance[room, ray]):
            point[room, ray] = point_at(scan, room, ray)
        else:
            point[room, ray] = wp.vec3(wp.nan, wp.nan, wp.nan)


@wp.func
def side_of(rank: int, below: int, upto: int):
    """Where the return of that rank lies: below a band, in it, or above."""
    if rank < below:
        return -1
    if rank < upto:
        return 0
    return 1


@wp.kernel
def keep_tall(first: int, scan: Ranges, heights: Heights, kept: Kept):
    """Keep the returns of elements that reach high, or whose median height is that of floor or ceiling."""
    room = first + wp.tid()
    floor = heights.floor[room]
    ceiling = heights.ceiling[room]
    for ray in range(scan.direction.shape[0]):
        if wp.isfinite(scan.distance[room, ray]):
            e = scan.element[room, ray]
            z = point_at(scan, room, ray)[2]
            heights.top[room, e] = wp.max(heights.top[room, e], z)
            heights.count[room, e, 0] += 1
            if z - floor < -heights.tolerance:
                heights.count[room, e, 1] += 1
            if z - floor <= heights.tolerance:
                heights.count[room, e, 2] += 1
            if z - ceiling < -heights.tolerance:
                heights.count[room, e, 3] += 1
            if z - ceiling <= heights.tolerance:
                heights.count[room, e, 4] += 1

    kept.unsure[room] = False
    for e in range(heights.top.shape[1]):
        heights.verdict[room, e] = wp.uint8(0)
        count = heights.count[room, e, 0]
        if count > 0:
            if heights.top[room, e] - floor >= heights.threshold:
                heights.verdict[room, e] = wp.uint8(1)
            else:
                # The median is the mean of two returns; where both lie on one side of a limit, so does it.
                for band in range(2):
                    below = heights.count[room, e, 1 + 2 * band]
                    upto = heights.count[room, e, 2 + 2 * band]
                    lower = side_of((count - 1) // 2, below, upto)
                    if lower != side_of(count // 2, below, upto):
                        kept.unsure[room] = True
                    elif lower == 0:
                        heights.verdict[room, e] = wp.uint8(1)

    filled = int(0)
    for ray in range(scan.direction.shape[0]):
        if wp.isfinite(scan.distance[room, ray]):
            if heights.verdict[room, scan.element[room, ray]] == wp.uint8(1):
                kept.point[room, filled] = point_at(scan, room, ray)
                kept.pixel[room, filled] = wp.int64(ray)
                filled += 1
    kept.count[room] = filled
