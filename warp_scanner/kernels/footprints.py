"""Warp device code that finds room for rectangles on the floor, one room per thread. Metres, float64.

A rectangle is stored as center x, y, half size x, y, and cosine and sine of its yaw.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

CENTER_X = wp.constant(0)
CENTER_Y = wp.constant(1)
HALF_X = wp.constant(2)
HALF_Y = wp.constant(3)
COSINE = wp.constant(4)
SINE = wp.constant(5)


@wp.func
def axis_gap(
    x: wp.float64,
    y: wp.float64,
    a: wp.array2d[wp.float64],
    n: int,
    b: wp.array2d[wp.float64],
    m: int,
    cosine: wp.float64,
    sine: wp.float64,
) -> wp.float64:
    """The larger gap along the two axes of rectangle n of `a`; cosine and sine >= 0 of the turn between the two."""
    along = wp.abs(a[n, COSINE] * x + a[n, SINE] * y) - a[n, HALF_X] - (b[m, HALF_X] * cosine + b[m, HALF_Y] * sine)
    across = wp.abs(a[n, COSINE] * y - a[n, SINE] * x) - a[n, HALF_Y] - (b[m, HALF_X] * sine + b[m, HALF_Y] * cosine)
    return wp.max(along, across)


@wp.func
def gap_between(a: wp.array2d[wp.float64], n: int, b: wp.array2d[wp.float64], m: int) -> wp.float64:
    """Gap along the best separating axis: never more than the true distance, negative where the two overlap."""
    x = b[m, CENTER_X] - a[n, CENTER_X]
    y = b[m, CENTER_Y] - a[n, CENTER_Y]
    cosine = wp.abs(a[n, COSINE] * b[m, COSINE] + a[n, SINE] * b[m, SINE])
    sine = wp.abs(a[n, COSINE] * b[m, SINE] - a[n, SINE] * b[m, COSINE])
    return wp.max(axis_gap(x, y, a, n, b, m, cosine, sine), axis_gap(x, y, b, m, a, n, cosine, sine))


@wp.func
def is_clear(
    a: wp.array2d[wp.float64], n: int, b: wp.array2d[wp.float64], b_valid: wp.array[wp.bool], gap: wp.float64
) -> bool:
    """Rectangle n of `a` is more than `gap` away from all of `b`."""
    for m in range(b.shape[0]):
        if b_valid[m]:
            if gap_between(a, n, b, m) <= gap:
                return False
    return True


@wp.func
def is_crowded(a: wp.array2d[wp.float64], n: int, by: wp.array[wp.bool], before: int, apart: wp.float64) -> bool:
    """Rectangle n is less than `apart` away from one of those marked in `by`, of the first `before`."""
    for m in range(before):
        if by[m]:
            if gap_between(a, n, a, m) < apart:
                return True
    return False


@wp.kernel
def settle(
    marks: wp.array3d[wp.float64],  # (rooms, N, 6)
    valid: wp.array2d[wp.bool],  # (rooms, N)
    others: wp.array3d[wp.float64],  # (rooms, M, 6)
    others_valid: wp.array2d[wp.bool],
    gap: wp.float64,  # to the others
    apart: wp.float64,  # to each other
    rounds: int,
    waiting: wp.array2d[wp.bool],  # (rooms, N) scratch
    stays: wp.array2d[wp.bool],  # out (rooms, N), all False before
):
    room = wp.tid()
    own = marks[room]
    count = valid.shape[1]
    for n in range(count):
        if valid[room, n]:
            valid[room, n] = is_clear(own, n, others[room], others_valid[room], gap)
    for _ in range(rounds):
        for n in range(count):
            waits = valid[room, n] and not stays[room, n]
            waiting[room, n] = waits and not is_crowded(own, n, stays[room], count, apart)
        for n in range(count):
            if waiting[room, n]:
                stays[room, n] = not is_crowded(own, n, waiting[room], n, apart)


@wp.kernel
def first_clear(
    marks: wp.array3d[wp.float64],  # (rooms, N, 6)
    valid: wp.array2d[wp.bool],  # (rooms, N)
    others: wp.array3d[wp.float64],  # (rooms, M, 6)
    others_valid: wp.array2d[wp.bool],
    gap: wp.float64,
    first: wp.array[int],  # out (rooms,), -1 where none is
):
    room = wp.tid()
    first[room] = -1
    for n in range(valid.shape[1]):
        if valid[room, n]:
            if is_clear(marks[room], n, others[room], others_valid[room], gap):
                first[room] = n
                break


@wp.func
def point_is_clear(
    x: wp.float64, y: wp.float64, b: wp.array2d[wp.float64], b_valid: wp.array[wp.bool], gap: wp.float64
) -> bool:
    for m in range(b.shape[0]):
        if b_valid[m]:
            dx = x - b[m, CENTER_X]
            dy = y - b[m, CENTER_Y]
            zero = wp.float64(0.0)
            along = wp.max(wp.abs(b[m, COSINE] * dx + b[m, SINE] * dy) - b[m, HALF_X], zero)
            across = wp.max(wp.abs(b[m, COSINE] * dy - b[m, SINE] * dx) - b[m, HALF_Y], zero)
            if wp.sqrt(along * along + across * across) <= gap:
                return False
    return True


@wp.kernel
def first_clear_point(
    points: wp.array3d[wp.float64],  # (rooms, N, 2)
    others: wp.array3d[wp.float64],  # (rooms, M, 6)
    others_valid: wp.array2d[wp.bool],
    gap: wp.float64,
    first: wp.array[int],  # out (rooms,), -1 where none is
):
    room = wp.tid()
    first[room] = -1
    for n in range(points.shape[1]):
        if point_is_clear(points[room, n, 0], points[room, n, 1], others[room], others_valid[room], gap):
            first[room] = n
            break
