"""Warp device code only: no allocation on the host, no NumPy, no configuration. Lengths in metres.

One thread casts a packet of consecutive rays: the packet's bounds cull the primitives, the survivors are sorted by the
earliest distance at which any ray of the packet can enter them, and each is then tested against all rays of the packet
until none can come nearer. Bounds only ever cull too little, so every ray gets exactly what testing all primitives
gives, whatever its neighbours; rays that share no origin and no direction merely cull less.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

PACKET = 128  # rays of a packet; the inner loops below are unrolled into vector instructions over it
BATCH = 256  # primitives culled and sorted at a time, so that scratch memory has a fixed size

PACKET_SIZE = wp.constant(PACKET)
BATCH_SIZE = wp.constant(BATCH)
BOX_KIND = wp.constant(1)


@wp.struct
class Shape:
    """One primitive as the inner loops want it."""

    center: wp.vec3
    half_size: wp.vec3
    cosine: float
    sine: float
    slot: int


@wp.struct
class Scene:
    """The primitives of all rooms; `shape`, `low` and `high` hold only what is present, packed to the front."""

    kind: wp.array2d[wp.uint8]  # (rooms, slots)
    element: wp.array2d[int]
    semantic: wp.array2d[wp.uint8]
    shape: wp.array2d[Shape]
    low: wp.array2d[wp.vec3]  # world bounds a little wider than the primitive
    high: wp.array2d[wp.vec3]
    count: wp.array[int]  # (rooms,) how many are present


@wp.struct
class Bounds:
    """Intervals of the origins and directions of a packet, with the reciprocals that culling needs."""

    origin_low: wp.vec3
    origin_high: wp.vec3
    inverse_low: wp.vec3  # 1 / least direction
    inverse_high: wp.vec3  # 1 / greatest direction
    direction_low: wp.vec3
    direction_high: wp.vec3


@wp.kernel
def prepare_shapes(
    present: wp.array2d[wp.bool],  # (rooms, slots)
    center: wp.array2d[wp.vec3],
    half_size: wp.array2d[wp.vec3],
    yaw: wp.array2d[float],
    scene: Scene,  # out: shape, low, high, count
):
    room = wp.tid()
    filled = int(0)
    for slot in range(present.shape[1]):
        if present[room, slot]:
            primitive = Shape()
            primitive.center = center[room, slot]
            primitive.half_size = half_size[room, slot]
            primitive.cosine = wp.cos(yaw[room, slot])
            primitive.sine = wp.sin(yaw[room, slot])
            primitive.slot = slot
            reach = half_size[room, slot]
            if int(scene.kind[room, slot]) == BOX_KIND:
                c = wp.abs(primitive.cosine)
                s = wp.abs(primitive.sine)
                reach = wp.vec3(c * reach[0] + s * reach[1], s * reach[0] + c * reach[1], reach[2])
            # The slack pays for every rounding between here and the distance a ray reports.
            middle = primitive.center
            reach = reach * 1.0001 + wp.vec3(1.0e-4, 1.0e-4, 1.0e-4)
            reach = reach + 1.0e-6 * wp.vec3(wp.abs(middle[0]), wp.abs(middle[1]), wp.abs(middle[2]))
            scene.shape[room, filled] = primitive
            scene.low[room, filled] = middle - reach
            scene.high[room, filled] = middle + reach
            filled += 1
    scene.count[room] = filled


@wp.func
def entry_along(low: float, high: float, bounds: Bounds, axis: int) -> wp.vec2:
    """Earliest and latest distance at which a ray of the packet can be between two planes of one axis."""
    near = low - bounds.origin_high[axis]
    far = high - bounds.origin_low[axis]
    first = float(0.0)
    last = float(wp.inf)
    if near > 0.0:
        first = wp.inf
        if bounds.direction_high[axis] > 0.0:
            first = near * bounds.inverse_high[axis]
    elif far < 0.0:
        first = wp.inf
        if bounds.direction_low[axis] < 0.0:
            first = far * bounds.inverse_low[axis]
    if bounds.direction_low[axis] > 0.0:
        last = far * bounds.inverse_low[axis]
    elif bounds.direction_high[axis] < 0.0:
        last = near * bounds.inverse_high[axis]
    return wp.vec2(first, last)


@wp.func
def packet_entry(low: wp.vec3, high: wp.vec3, bounds: Bounds) -> float:
    """A distance that no ray of the packet undercuts when it enters the bounds; infinity when none can."""
    x = entry_along(low[0], high[0], bounds, 0)
    y = entry_along(low[1], high[1], bounds, 1)
    z = entry_along(low[2], high[2], bounds, 2)
    first = wp.max(x[0], wp.max(y[0], z[0]))
    last = wp.min(x[1], wp.min(y[1], z[1]))
    if first * 0.9999 > last * 1.0001:
        return wp.inf
    return first * 0.9999


# The two loops below are the hot spot. As plain C++ over arrays that cannot overlap they become vector instructions,
# which Warp's own array access does not. A start inside a solid reports the surface where
# the ray leaves it. Of equal distances the lower slot wins, so that the order of testing cannot show. Both return the
# farthest of the nearest hits; taken over the bits, which order like the floats, as only integer maxima vectorise.
@wp.func_native(
    """
    const float *__restrict px = ray.data, *__restrict py = px + PACKET, *__restrict pz = py + PACKET;
    const float *__restrict ux = pz + PACKET, *__restrict uy = ux + PACKET, *__restrict uz = uy + PACKET;
    float *__restrict t_best = nearest.data; int *__restrict s_best = hit.data;
    const float cx = s.center[0], cy = s.center[1], cz = s.center[2];
    const float hx = s.half_size[0], hy = s.half_size[1], hz = s.half_size[2];
    const float c = s.cosine, n = s.sine; const int slot = s.slot;
    int farthest = 0;
    for (int i = 0; i < PACKET; ++i) {
        const float ex = px[i] - cx, ey = py[i] - cy, oz = pz[i] - cz;
        const float ox = c * ex + n * ey, oy = c * ey - n * ex;
        float dx = c * ux[i] + n * uy[i], dy = c * uy[i] - n * ux[i], dz = uz[i];
        dx = (dx < 1e-20f && dx > -1e-20f) ? 1e-20f : dx;
        dy = (dy < 1e-20f && dy > -1e-20f) ? 1e-20f : dy;
        dz = (dz < 1e-20f && dz > -1e-20f) ? 1e-20f : dz;
        const float ix = 1.0f / dx, iy = 1.0f / dy, iz = 1.0f / dz;
        const float x0 = (-hx - ox) * ix, x1 = (hx - ox) * ix;
        const float y0 = (-hy - oy) * iy, y1 = (hy - oy) * iy;
        const float z0 = (-hz - oz) * iz, z1 = (hz - oz) * iz;
        float a = x0 < x1 ? x0 : x1, b = x0 < x1 ? x1 : x0;
        const float ya = y0 < y1 ? y0 : y1, yb = y0 < y1 ? y1 : y0;
        const float za = z0 < z1 ? z0 : z1, zb = z0 < z1 ? z1 : z0;
        a = a > ya ? a : ya; a = a > za ? a : za;
        b = b < yb ? b : yb; b = b < zb ? b : zb;
        const float t = a >= 0.0f ? a : b;
        const bool better = (a <= b) & (b >= 0.0f) & ((t < t_best[i]) | ((t == t_best[i]) & (slot < s_best[i])));
        t_best[i] = better ? t : t_best[i];
        s_best[i] = better ? slot : s_best[i];
        int bits;
        __builtin_memcpy(&bits, &t_best[i], 4);
        farthest = bits > farthest ? bits : farthest;
    }
    float result;
    __builtin_memcpy(&result, &farthest, 4);
    return result;
""".replace("PACKET", str(PACKET))
)
def test_box(s: Shape, ray: wp.array2d[float], nearest: wp.array[float], hit: wp.array[int]) -> float: ...


@wp.func_native(
    """
    const float *__restrict px = ray.data, *__restrict py = px + PACKET, *__restrict pz = py + PACKET;
    const float *__restrict ux = pz + PACKET, *__restrict uy = ux + PACKET, *__restrict uz = uy + PACKET;
    float *__restrict t_best = nearest.data; int *__restrict s_best = hit.data;
    const float cx = s.center[0], cy = s.center[1], cz = s.center[2];
    const float r = s.half_size[0], hz = s.half_size[2]; const int slot = s.slot;
    int farthest = 0;
    for (int i = 0; i < PACKET; ++i) {
        const float ox = px[i] - cx, oy = py[i] - cy, oz = pz[i] - cz;
        const float dx = ux[i], dy = uy[i];
        const float dz = (uz[i] < 1e-20f && uz[i] > -1e-20f) ? 1e-20f : uz[i];
        const float iz = 1.0f / dz;
        const float z0 = (-hz - oz) * iz, z1 = (hz - oz) * iz;
        const float along = dx * dx + dy * dy, to = ox * dx + oy * dy, across = ox * dy - oy * dx;
        // The squared half chord through its distance from the axis: no difference of large squares.
        const float rest = r * r * along - across * across;
        const bool upright = along < 1e-12f, within = ox * ox + oy * oy <= r * r;
        const float root = __builtin_sqrtf(rest > 0.0f ? rest : 0.0f), inverse = 1.0f / (upright ? 1.0f : along);
        const float ca = upright ? (within ? -1e30f : 1e30f) : (-to - root) * inverse;
        const float cb = upright ? (within ? 1e30f : -1e30f) : (-to + root) * inverse;
        const float za = z0 < z1 ? z0 : z1, zb = z0 < z1 ? z1 : z0;
        const float a = ca > za ? ca : za, b = cb < zb ? cb : zb;
        const float t = a >= 0.0f ? a : b;
        const bool better = (upright | (rest >= 0.0f)) & (a <= b) & (b >= 0.0f)
            & ((t < t_best[i]) | ((t == t_best[i]) & (slot < s_best[i])));
        t_best[i] = better ? t : t_best[i];
        s_best[i] = better ? slot : s_best[i];
        int bits;
        __builtin_memcpy(&bits, &t_best[i], 4);
        farthest = bits > farthest ? bits : farthest;
    }
    float result;
    __builtin_memcpy(&result, &farthest, 4);
    return result;
""".replace("PACKET", str(PACKET))
)
def test_cylinder(s: Shape, ray: wp.array2d[float], nearest: wp.array[float], hit: wp.array[int]) -> float: ...


@wp.func
def packet_bounds(ray: wp.array2d[float]) -> Bounds:
    bounds = Bounds()
    for axis in range(3):
        low = float(wp.inf)
        high = float(-wp.inf)
        direction_low = float(wp.inf)
        direction_high = float(-wp.inf)
        for i in range(PACKET_SIZE):
            low = wp.min(low, ray[axis, i])
            high = wp.max(high, ray[axis, i])
            direction_low = wp.min(direction_low, ray[axis + 3, i])
            direction_high = wp.max(direction_high, ray[axis + 3, i])
        bounds.origin_low[axis] = low
        bounds.origin_high[axis] = high
        bounds.direction_low[axis] = direction_low
        bounds.direction_high[axis] = direction_high
        bounds.inverse_low[axis] = 1.0 / direction_low
        bounds.inverse_high[axis] = 1.0 / direction_high
    return bounds


@wp.kernel
def cast_packets(
    first_packet: int,
    scene: Scene,
    ray_origin: wp.array2d[wp.vec3],  # (rooms, rays or 1)
    ray_direction: wp.array2d[wp.vec3],  # (rooms or 1, rays)
    rotation: wp.array[wp.mat33],  # (rooms or 1,) turns the directions into the world
    distance: wp.array2d[float],  # out (rooms, rays)
    hit_slot: wp.array2d[int],  # out (rooms, rays), -1 on a miss
    hit_element: wp.array2d[int],  # out (rooms, rays), -1 on a miss
    hit_semantic: wp.array2d[wp.uint8],  # out (rooms, rays), 0 on a miss
):
    packet = first_packet + wp.tid()
    ray_count = distance.shape[1]
    packets_per_room = (ray_count + PACKET_SIZE - 1) // PACKET_SIZE
    room = packet // packets_per_room
    start = (packet - room * packets_per_room) * PACKET_SIZE
    filled = wp.min(PACKET_SIZE, ray_count - start)

    ray = wp.zeros(shape=(6, PACKET), dtype=float)
    nearest = wp.zeros(shape=(PACKET,), dtype=float)
    hit = wp.zeros(shape=(PACKET,), dtype=int)
    turn = rotation[wp.min(room, rotation.shape[0] - 1)]
    direction_room = wp.min(room, ray_direction.shape[0] - 1)
    for i in range(PACKET_SIZE):
        index = start + wp.min(i, filled - 1)  # the last ray fills an incomplete packet up
        origin = ray_origin[room, wp.min(index, ray_origin.shape[1] - 1)]
        direction = turn * ray_direction[direction_room, index]
        for axis in range(3):
            ray[axis, i] = origin[axis]
            ray[axis + 3, i] = direction[axis]
        nearest[i] = wp.inf
        hit[i] = -1
    bounds = packet_bounds(ray)

    entry = wp.zeros(shape=(BATCH,), dtype=float)
    candidate = wp.zeros(shape=(BATCH,), dtype=int)
    farthest = float(wp.inf)
    for base in range(0, scene.count[room], BATCH_SIZE):
        found = int(0)
        for p in range(base, wp.min(base + BATCH_SIZE, scene.count[room])):
            t = packet_entry(scene.low[room, p], scene.high[room, p], bounds)
            if t < wp.inf:
                place = found
                while place > 0 and entry[wp.max(place - 1, 0)] > t:
                    entry[place] = entry[place - 1]
                    candidate[place] = candidate[place - 1]
                    place -= 1
                entry[place] = t
                candidate[place] = p
                found += 1
        for k in range(found):
            if entry[k] > farthest:
                break
            primitive = scene.shape[room, candidate[k]]
            if int(scene.kind[room, primitive.slot]) == BOX_KIND:
                farthest = test_box(primitive, ray, nearest, hit)
            else:
                farthest = test_cylinder(primitive, ray, nearest, hit)
    for i in range(filled):
        distance[room, start + i] = nearest[i]
        hit_slot[room, start + i] = hit[i]
        hit_element[room, start + i] = -1
        hit_semantic[room, start + i] = wp.uint8(0)
        if hit[i] >= 0:
            hit_element[room, start + i] = scene.element[room, hit[i]]
            hit_semantic[room, start + i] = scene.semantic[room, hit[i]]
