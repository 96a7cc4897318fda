"""Warp device code: what a primitive looks like to a pinhole camera, as forms that are linear in column and row.

All rays of an image share one origin. Along them the inverse depth q at which a plane is met is linear in the pixel's
column and row, and so are the ends of the span of columns that a box covers in one row.

An image has W columns and H rows; column i and row j count from the top left. Lengths in metres.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

LINES = 6  # corners of a box's outline, at most

BOX_KIND = wp.constant(1)
NEVER = wp.constant(wp.float64(1.0e30))  # inverse depth of a plane that does not bound the entry
TOUCHING = wp.constant(wp.float64(1.0e-6))  # [m] a sensor this near to a plane is not told to be on either side
NEAREST_DEPTH = wp.constant(1.0e-3)  # [m] corners nearer to the image plane are not projected

line6 = wp.types.vector(length=LINES, dtype=float)


@wp.struct
class Camera:
    """Pixel (i, j) looks along (1, first_u + step_u i, first_v + step_v j) in the sensor frame."""

    first_u: wp.float64
    step_u: wp.float64
    first_v: wp.float64
    step_v: wp.float64
    width: int
    height: int


@wp.struct
class Outline:
    """One primitive as the image sees it; a form (a, b, c) stands for a + b i + c j."""

    form0: wp.vec3d  # box: q of the facing planes across x, y and z; cylinder: x and y of the ray, q of the facing lid
    form1: wp.vec3d
    form2: wp.vec3d
    exit0: wp.vec3d  # cylinder: q of the lids through which rays leave
    exit1: wp.vec3d
    axis: wp.vec3d  # cylinder: sensor from the axis x, y [m], and its squared distance from the wall along a tangent
    squared_radius: wp.float64
    left_at: line6  # the columns from `left_at + left_step j` (the greatest) ...
    left_step: line6
    right_at: line6  # ... to `right_at + right_step j` (the least) are inside the outline
    right_step: line6
    kind: int
    code: int  # slot + 1


@wp.struct
class View:
    """What the rooms' sensors see; `outline` and `window` hold only what is in the image, in the order of the slots."""

    outline: wp.array2d[Outline]  # (rooms, slots)
    window: wp.array2d[wp.vec4i]  # (rooms, slots) first and last column, first and last row
    count: wp.array[int]  # (rooms,)
    general: wp.array[wp.bool]  # (rooms,) True: the sensor touches a primitive or is inside one


@wp.func
def bound(outline: Outline, line: int, entry: wp.vec3d, leave: wp.vec3d) -> Outline:
    """Cut the outline where the plane of entry is met later than the plane of leaving."""
    difference = entry - leave
    slope = difference[1]
    if wp.abs(slope) < wp.float64(1.0e-20):
        slope = wp.where(slope < wp.float64(0.0), wp.float64(-1.0e-20), wp.float64(1.0e-20))
    at = wp.clamp(-difference[0] / slope, wp.float64(-1.0e30), wp.float64(1.0e30))
    step = wp.clamp(-difference[2] / slope, wp.float64(-1.0e30), wp.float64(1.0e30))
    if slope > wp.float64(0.0):
        outline.left_at[line] = float(at)
        outline.left_step[line] = float(step)
    else:
        outline.right_at[line] = float(at)
        outline.right_step[line] = float(step)
    return outline


@wp.func
def window_of(sensor: wp.vec3d, half_size: wp.vec3d, to_local: wp.mat33d, camera: Camera) -> wp.vec4i:
    """Pixels that may see a box; the whole image where a corner lies beside or behind the sensor."""
    low_u = float(1.0e9)
    high_u = float(-1.0e9)
    low_v = float(1.0e9)
    high_v = float(-1.0e9)
    ahead = int(0)
    for corner in range(8):
        sign_x = wp.where((corner & 1) != 0, wp.float64(1.0), wp.float64(-1.0))
        sign_y = wp.where((corner & 2) != 0, wp.float64(1.0), wp.float64(-1.0))
        sign_z = wp.where((corner & 4) != 0, wp.float64(1.0), wp.float64(-1.0))
        place = wp.vec3d(sign_x * half_size[0], sign_y * half_size[1], sign_z * half_size[2]) - sensor
        seen = wp.transpose(to_local) * place  # the columns of to_local are the sensor's axes
        depth = float(seen[0])
        if depth > NEAREST_DEPTH:
            ahead += 1
            u = float(seen[1]) / depth
            v = float(seen[2]) / depth
            low_u = wp.min(low_u, u)
            high_u = wp.max(high_u, u)
            low_v = wp.min(low_v, v)
            high_v = wp.max(high_v, v)
    if ahead == 0:
        return wp.vec4i(0, -1, 0, -1)
    if ahead < 8:
        return wp.vec4i(0, camera.width - 1, 0, camera.height - 1)
    # Columns count to the right and rows down, against y and z of the sensor frame. One pixel more pays for rounding.
    left = (high_u - float(camera.first_u)) / float(camera.step_u) - 1.0
    right = (low_u - float(camera.first_u)) / float(camera.step_u) + 1.0
    top = (high_v - float(camera.first_v)) / float(camera.step_v) - 1.0
    bottom = (low_v - float(camera.first_v)) / float(camera.step_v) + 1.0
    if right < 0.0 or bottom < 0.0 or left > float(camera.width) or top > float(camera.height):
        return wp.vec4i(0, -1, 0, -1)
    return wp.vec4i(
        int(wp.max(wp.floor(left), 0.0)),
        int(wp.min(wp.ceil(right), float(camera.width - 1))),
        int(wp.max(wp.floor(top), 0.0)),
        int(wp.min(wp.ceil(bottom), float(camera.height - 1))),
    )


@wp.func
def outline_of(sensor: wp.vec3d, half_size: wp.vec3d, ray: wp.mat33d, kind: int) -> Outline:
    """The outline of a box around the origin; `ray` holds the ray's forms along its three axes."""
    outline = Outline()
    for line in range(LINES):
        outline.left_at[line] = -1.0e30
        outline.right_at[line] = 1.0e30
    facing = wp.mat33d()
    leaving = wp.mat33d()
    opposite = wp.mat33d()  # where the sensor is between the two planes of an axis, rays may leave through either
    outside = wp.vec3i(0, 0, 0)
    for axis in range(3):
        offset = sensor[axis]
        half = half_size[axis]
        # A sensor in a face's plane sees that face edge on, and counts as just inside of it.
        if wp.abs(wp.abs(offset) - half) < TOUCHING:
            offset = wp.sign(offset) * (half - TOUCHING)
        if wp.abs(offset) > half:
            side = wp.sign(offset)
            outside[axis] = 1
            facing[axis] = ray[axis] / (side * half - offset)
            leaving[axis] = ray[axis] / (-side * half - offset)
            opposite[axis] = leaving[axis]
        else:
            facing[axis] = wp.vec3d(NEVER, wp.float64(0.0), wp.float64(0.0))
            leaving[axis] = ray[axis] / (half - offset)
            opposite[axis] = ray[axis] / (-half - offset)
    line = int(0)
    for axis in range(3):
        if outside[axis] == 1:
            for turn in range(1, 3):
                other = (axis + turn) % 3
                outline = bound(outline, line, facing[axis], leaving[other])
                line += 1
                if outside[other] == 0:
                    outline = bound(outline, line, facing[axis], opposite[other])
                    line += 1
    outline.kind = kind
    outline.form0 = facing[0]
    outline.form1 = facing[1]
    outline.form2 = facing[2]
    if kind != BOX_KIND:
        outline.form0 = ray[0]
        outline.form1 = ray[1]
        outline.exit0 = leaving[2]
        outline.exit1 = opposite[2]
        outline.squared_radius = half_size[0] * half_size[0]
        reach = sensor[0] * sensor[0] + sensor[1] * sensor[1] - outline.squared_radius
        outline.axis = wp.vec3d(sensor[0], sensor[1], reach)
    return outline


@wp.func
def touches(sensor: wp.vec3d, half_size: wp.vec3d, kind: int) -> wp.bool:
    """Whether the sensor is in a primitive, at its surface, or in line with a cylinder: too near for forms."""
    gap_x = wp.abs(sensor[0]) - half_size[0]
    gap_y = wp.abs(sensor[1]) - half_size[1]
    gap_z = wp.abs(sensor[2]) - half_size[2]
    if kind == BOX_KIND:
        return wp.max(gap_x, wp.max(gap_y, gap_z)) < TOUCHING
    return wp.sqrt(sensor[0] * sensor[0] + sensor[1] * sensor[1]) - half_size[0] < TOUCHING


@wp.kernel
def prepare_view(
    present: wp.array2d[wp.uint8],  # (rooms, slots) kind of what is present, 0 of all else
    center: wp.array2d[wp.vec3],
    half_size: wp.array2d[wp.vec3],
    yaw: wp.array2d[float],
    position: wp.array[wp.vec3],  # (rooms,) of the sensor
    rotation: wp.array[wp.mat33],  # (rooms,) sensor frame to world
    camera: Camera,
    view: View,  # out
):
    room = wp.tid()
    filled = int(0)
    view.general[room] = False
    to_world = wp.mat33d(rotation[room])
    for slot in range(present.shape[1]):
        kind = int(present[room, slot])
        if kind != 0:
            c = wp.float64(wp.cos(yaw[room, slot]))
            s = wp.float64(wp.sin(yaw[room, slot]))
            turn = wp.mat33d(
                c, s, wp.float64(0.0), -s, c, wp.float64(0.0), wp.float64(0.0), wp.float64(0.0), wp.float64(1.0)
            )
            size = wp.vec3d(half_size[room, slot])
            sensor = turn * (wp.vec3d(position[room]) - wp.vec3d(center[room, slot]))
            to_local = turn * to_world
            window = window_of(sensor, size, to_local, camera)
            if touches(sensor, size, kind):
                view.general[room] = True
            elif window[0] <= window[1] and window[2] <= window[3]:
                ray = wp.mat33d()
                for axis in range(3):
                    ray[axis] = wp.vec3d(
                        to_local[axis, 0] + camera.first_u * to_local[axis, 1] + camera.first_v * to_local[axis, 2],
                        camera.step_u * to_local[axis, 1],
                        camera.step_v * to_local[axis, 2],
                    )
                outline = outline_of(sensor, size, ray, kind)
                outline.code = slot + 1
                view.outline[room, filled] = outline
                view.window[room, filled] = window
                filled += 1
    view.count[room] = filled
