"""Warp device code that looks along rays near given directions. No NumPy. Metres, radians, one frame for all."""

import warp as wp

wp.set_module_options({"enable_backward": False})

LIMIT = wp.constant(5.0)  # [m] residuals are cut to this on either side before their mean is taken


@wp.struct
class Rays:
    """Measured rays of R scans that share P directions, sorted into cells of a grid on the sphere.

    Rows are belts of equal height in elevation; every row is cut into cells of about equal width in azimuth.
    """

    direction: wp.array[wp.vec3]  # (P,) unit vectors, by cell
    ray: wp.array[wp.int32]  # (P,) which ray of the scan stands there
    row_start: wp.array[wp.int32]  # (rows + 1,) first cell of each row, and the end
    cell_start: wp.array[wp.int32]  # (cells + 1,) first place in `direction` of each cell, and the end
    row_height: wp.float32  # [rad]
    distance: wp.array2d[wp.float32]  # (R, P) measured, inf = no return
    expected: wp.array2d[wp.float32]  # (R, P) predicted along the same ray; (R, 0) where only points are known
    margin: wp.array2d[wp.float32]  # (R, P) of each such comparison
    element: wp.array2d[wp.int32]  # (R, P) predicted along the same ray
    width: wp.array2d[wp.float32]  # (R, P) half width [rad] of what a ray stands for; (R, 0) where it has none
    widest: wp.float32  # [rad] of those


@wp.struct
class Points:
    """N points of all scans, one scan after the other."""

    scan: wp.array[wp.int32]  # (N,)
    direction: wp.array[wp.vec3]  # (N,) unit vectors
    distance: wp.array[wp.float32]  # (N,)
    angle: wp.array[wp.float32]  # (N,) half width of the footprint
    margin: wp.array[wp.float32]  # (N,) of a comparison of ranges, where no range is predicted
    slope: wp.array[wp.float32]  # (N,) [m/rad] how fast that margin grows away from the point's own direction
    element: wp.array[wp.int32]  # (N,) only rays that should meet this element count; -1: all


@wp.func
def compare(rays: Rays, points: Points, point: int, place: int, apart: float):
    """0 beyond the point, 1 at it, 2 before it, 3 without a return, -1 if the ray tells nothing of it."""
    scan = points.scan[point]
    ray = rays.ray[place]
    found = rays.distance[scan, ray]
    limit = points.margin[point] + points.slope[point] * apart
    expected = points.distance[point]
    if rays.expected.shape[1] > 0:
        if points.element[point] >= 0 and rays.element[scan, ray] != points.element[point]:
            return -1
        expected = rays.expected[scan, ray]
        limit = rays.margin[scan, ray]
    if not wp.isfinite(found):
        return 3
    if found > expected + limit:
        return 0
    if found < expected - limit:
        return 2
    return 1


@wp.kernel
def look(first: int, rays: Rays, points: Points, count: wp.array2d[wp.int32], residual: wp.array[wp.float32]):
    """Count what the rays within a point's footprint met, and take the mean of their residuals. One thread a point."""
    point = first + wp.tid()
    toward = points.direction[point]
    own = points.angle[point]
    angle = wp.max(own, rays.widest)
    rows = rays.row_start.shape[0] - 1
    elevation = wp.asin(wp.clamp(toward[2], -1.0, 1.0))
    azimuth = wp.atan2(toward[1], toward[0])
    level = wp.cos(elevation)
    # Meridians that touch the footprint's circle; around a pole all of them do.
    half = float(wp.pi)
    if wp.abs(elevation) + angle < 0.5 * wp.pi:
        half = wp.asin(wp.min(1.0, wp.sin(angle) / level))
    low = wp.max(0, int(wp.floor((elevation - angle + 0.5 * wp.pi) / rays.row_height)))
    high = wp.min(rows - 1, int(wp.floor((elevation + angle + 0.5 * wp.pi) / rays.row_height)))
    # The chord tells small angles apart where the cosine cannot.
    reach = 2.0 * wp.sin(0.5 * wp.min(own, wp.pi))
    total = float(0.0)
    returns = int(0)
    for row in range(low, high + 1):
        begin = rays.row_start[row]
        cells = rays.row_start[row + 1] - begin
        left = int(wp.floor((azimuth - half + wp.pi) / (2.0 * wp.pi) * float(cells)))
        right = int(wp.floor((azimuth + half + wp.pi) / (2.0 * wp.pi) * float(cells)))
        if right - left >= cells:
            left = 0
            right = cells - 1
        for cell in range(left, right + 1):
            at = begin + (cell + cells) % cells
            for place in range(rays.cell_start[at], rays.cell_start[at + 1]):
                apart = wp.length(rays.direction[place] - toward)
                near = apart <= reach
                hides = not near and rays.width.shape[1] > 0
                if hides:
                    hides = apart <= rays.width[points.scan[point], rays.ray[place]]
                if near or hides:
                    side = compare(rays, points, point, place, apart)
                    # A point that is close to the sensor hides what is beside its own direction.
                    if (near and side >= 0) or side == 2:
                        count[point, side] += 1
                        if side < 3:
                            scan = points.scan[point]
                            ray = rays.ray[place]
                            expected = points.distance[point]
                            if rays.expected.shape[1] > 0:
                                expected = rays.expected[scan, ray]
                            total += wp.clamp(rays.distance[scan, ray] - expected, -LIMIT, LIMIT)
                            returns += 1
    if returns > 0:
        residual[point] = total / float(returns)
