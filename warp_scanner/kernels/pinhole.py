"""Warp device code for pinhole cameras only: draws outlines into tiles of an image, and writes what each pixel sees.

A box is entered where the least of the inverse depths q of its facing planes exceeds the q of the planes through which
rays leave it. An image is cut into tiles; each keeps the greatest q and its primitive in fast memory, and no pixel ever
needs a division until its range is written.

An image has W columns and H rows; column i and row j count from the top left. Lengths in metres.
"""

import warp as wp

from warp_scanner.kernels.outlines import BOX_KIND, LINES, Camera, Outline, View

wp.set_module_options({"enable_backward": False})

TILE_ROWS, TILE_COLUMNS = 16, 64
TILE_PIXELS = TILE_ROWS * TILE_COLUMNS

ROWS = wp.constant(TILE_ROWS)
COLUMNS = wp.constant(TILE_COLUMNS)

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
