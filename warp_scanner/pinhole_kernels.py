"""Warp device code for pinhole cameras only: all rays of an image share one origin, and that makes them cheap.

Along a pixel's ray the inverse depth q at which it meets a plane is linear in the pixel's column and row. A box is
entered where the least of the q of its facing planes exceeds the q of the planes through which rays leave it, so in
one image row it covers one span of columns, whose ends are linear in the row. An image is cut into tiles; each tile
keeps the greatest q and its primitive in fast memory, and no pixel ever needs a division until its range is written.

An image has W columns and H rows; column i and row j count from the top left. Lengths in metres.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

TILE_ROWS, TILE_COLUMNS = 16, 64
TILE_PIXELS = TILE_ROWS * TILE_COLUMNS
LINES = 6  # corners of a box's outline, at most

ROWS = wp.constant(TILE_ROWS)
COLUMNS = wp.constant(TILE_COLUMNS)
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


# The hot spot, in explicit vectors of eight pixels. A primitive wins a pixel where its q is strictly greater: drawn in
# the order of the slots, of two at the same distance the lower slot stays.
_PREAMBLE = """
    typedef float f8 __attribute__((vector_size(32)));
    typedef int i8 __attribute__((vector_size(32)));
    typedef f8 f8_at __attribute__((aligned(4)));
    typedef i8 i8_at __attribute__((aligned(4)));
    const f8 lanes = {0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f};
    float left[ROWS], right[ROWS];
    for (int r = 0; r < ROWS; ++r) { left[r] = 0.0f; right[r] = COLUMNS - 1.0f; }
    for (int k = 0; k < LINES; ++k) {
        const float la = s.left_at[k], ls = s.left_step[k], ra = s.right_at[k], rs = s.right_step[k];
        for (int r = 0; r < ROWS; ++r) {
            const float row = (float)(top + r), l = la + ls * row - x0, e = ra + rs * row - x0;
            left[r] = l > left[r] ? l : left[r];
            right[r] = e < right[r] ? e : right[r];
        }
    }
    for (int r = first_row; r <= last_row; ++r) {
        if (!(left[r] <= right[r])) continue;
        const f8 from = left[r] + 0.0f * lanes, to = right[r] + 0.0f * lanes;
        const int start = (int)left[r] & ~7, stop = (int)right[r];
        const double row = (double)(top + r), column = (double)x0;
"""
_LOOP = """
        for (int i = start; i <= stop; i += 8) {
            f8_at *const q_at = (f8_at *)(q.data + r * COLUMNS + i);
            i8_at *const hit_at = (i8_at *)(hit.data + r * COLUMNS + i);
            const f8 x = lanes + (float)i, q_old = *q_at;
"""
_WIN = """
            const i8 old = *hit_at;
            *q_at = wins ? v : q_old;
            *hit_at = wins ? (s.code + 0 * old) : old;
        }
    }
"""


def _native(text: str) -> str:
    for name, value in (("ROWS", TILE_ROWS), ("COLUMNS", TILE_COLUMNS), ("LINES", LINES)):
        text = text.replace(name, str(value))
    return text


@wp.func_native(
    _native(
        _PREAMBLE
        + """
        const float a0 = (float)(s.form0[0] + s.form0[1] * column + s.form0[2] * row), b0 = (float)s.form0[1];
        const float a1 = (float)(s.form1[0] + s.form1[1] * column + s.form1[2] * row), b1 = (float)s.form1[1];
        const float a2 = (float)(s.form2[0] + s.form2[1] * column + s.form2[2] * row), b2 = (float)s.form2[1];
"""
        + _LOOP
        + """
            const f8 v0 = a0 + b0 * x, v1 = a1 + b1 * x, v2 = a2 + b2 * x;
            const f8 v01 = v0 < v1 ? v0 : v1, v = v01 < v2 ? v01 : v2;
            const i8 wins = (v > q_old) & (x >= from) & (x <= to);
"""
        + _WIN
    )
)
def draw_box(s: Outline, x0: int, top: int, first_row: int, last_row: int, q: wp.array[float], hit: wp.array[int]): ...


@wp.func_native(
    _native(
        _PREAMBLE
        + """
        const float ax = (float)(s.form0[0] + s.form0[1] * column + s.form0[2] * row), bx = (float)s.form0[1];
        const float ay = (float)(s.form1[0] + s.form1[1] * column + s.form1[2] * row), by = (float)s.form1[1];
        const float az = (float)(s.form2[0] + s.form2[1] * column + s.form2[2] * row), bz = (float)s.form2[1];
        const float ae = (float)(s.exit0[0] + s.exit0[1] * column + s.exit0[2] * row), be = (float)s.exit0[1];
        const float ao = (float)(s.exit1[0] + s.exit1[1] * column + s.exit1[2] * row), bo = (float)s.exit1[1];
        const float ox = (float)s.axis[0], oy = (float)s.axis[1], over = (float)(1.0 / s.axis[2]);
        const float squared = (float)s.squared_radius;
"""
        + _LOOP
        + """
            const f8 dx = ax + bx * x, dy = ay + by * x;
            const f8 along = ox * dx + oy * dy, across = ox * dy - oy * dx;
            const f8 rest = squared * (dx * dx + dy * dy) - across * across;
            const f8 root = __builtin_elementwise_sqrt(rest > 0.0f ? rest : 0.0f * rest);
            const f8 into = (root - along) * over, out = (-root - along) * over;
            const f8 lid = az + bz * x, e0 = ae + be * x, e1 = ao + bo * x;
            const f8 e01 = e0 > e1 ? e0 : e1, leave = out > e01 ? out : e01;
            const f8 v = into < lid ? into : lid;
            const i8 wins = (rest >= 0.0f) & (v >= leave) & (v > q_old) & (x >= from) & (x <= to);
"""
        + _WIN
    )
)
def draw_cylinder(
    s: Outline, x0: int, top: int, first_row: int, last_row: int, q: wp.array[float], hit: wp.array[int]
): ...


@wp.struct
class Image:
    """Where a launch writes; arrays without data are not wanted. All (rooms, H * W)."""

    distance: wp.array2d[float]
    slot: wp.array2d[int]
    element: wp.array2d[int]
    semantic: wp.array2d[wp.uint8]
    element_of: wp.array2d[int]  # in: (rooms, slots + 1) by code
    semantic_of: wp.array2d[wp.uint8]  # in: likewise


@wp.func_native(
    _native("""
    typedef float f8 __attribute__((vector_size(32)));
    typedef int i8 __attribute__((vector_size(32)));
    typedef f8 f8_at __attribute__((aligned(4)));
    typedef i8 i8_at __attribute__((aligned(4)));
    const f8 lanes = {0.0f, 1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f, 7.0f};
    const int width = camera.width, height = camera.height;
    const int columns = width - left < COLUMNS ? width - left : COLUMNS;
    const int rows = height - top < ROWS ? height - top : ROWS;
    const int *__restrict names = image.element_of.data + (size_t)room * image.element_of.shape[1];
    const wp::uint8 *__restrict classes = image.semantic_of.data + (size_t)room * image.element_of.shape[1];
    const float u0 = (float)(camera.first_u + camera.step_u * left), du = (float)camera.step_u;
    for (int row = 0; row < rows; ++row) {
        const size_t at = ((size_t)room * height + top + row) * width + left;
        const float *__restrict inverse = q.data + row * COLUMNS;
        const int *__restrict code = hit.data + row * COLUMNS;
        float *__restrict range = image.distance.data + at;
        int *__restrict slot = image.slot.data ? image.slot.data + at : nullptr;
        int *__restrict name = image.element.data ? image.element.data + at : nullptr;
        wp::uint8 *__restrict kind = image.semantic.data ? image.semantic.data + at : nullptr;
        const double v = camera.first_v + camera.step_v * (top + row);
        const float depth = (float)(1.0 + v * v);
        // A pixel's ray is longer than its depth by the root.
        for (int i = 0; i < columns; i += 8) {
            const f8 u = u0 + du * (lanes + (float)i);
            const f8 away = __builtin_elementwise_sqrt(depth + u * u) / *(const f8_at *)(inverse + i);
            const i8 codes = *(const i8_at *)(code + i);
            const int first = codes[0];
            if (i + 8 <= columns && __builtin_reduce_and(codes == first) != 0) {  // one surface, as nearly everywhere
                *(f8_at *)(range + i) = away;
                if (slot) *(i8_at *)(slot + i) = codes - 1;
                if (name) *(i8_at *)(name + i) = names[first] + 0 * codes;
                if (kind) __builtin_memset(kind + i, classes[first], 8);
                continue;
            }
            const int count = columns - i < 8 ? columns - i : 8;
            for (int k = 0; k < count; ++k) {
                range[i + k] = away[k];
                if (slot) slot[i + k] = codes[k] - 1;
                if (name) name[i + k] = names[codes[k]];
                if (kind) kind[i + k] = classes[codes[k]];
            }
        }
    }
""")
)
def write_tile(
    room: int, top: int, left: int, camera: Camera, q: wp.array[float], hit: wp.array[int], image: Image
): ...


@wp.kernel
def draw_tiles(
    first_tile: int,
    view: View,
    camera: Camera,
    image: Image,  # out
):
    tile = first_tile + wp.tid()
    across = (camera.width + COLUMNS - 1) // COLUMNS
    down = (camera.height + ROWS - 1) // ROWS
    room = tile // (across * down)
    place = tile - room * across * down
    top = (place // across) * ROWS
    left = (place - (place // across) * across) * COLUMNS

    q = wp.zeros(shape=(TILE_PIXELS,), dtype=float)
    hit = wp.zeros(shape=(TILE_PIXELS,), dtype=int)
    for p in range(view.count[room]):
        window = view.window[room, p]
        if window[0] < left + COLUMNS and window[1] >= left and window[2] < top + ROWS and window[3] >= top:
            first_row = wp.max(window[2] - top, 0)
            last_row = wp.min(window[3] - top, ROWS - 1)
            if view.outline[room, p].kind == BOX_KIND:
                draw_box(view.outline[room, p], left, top, first_row, last_row, q, hit)
            else:
                draw_cylinder(view.outline[room, p], left, top, first_row, last_row, q, hit)
    write_tile(room, top, left, camera, q, hit, image)
