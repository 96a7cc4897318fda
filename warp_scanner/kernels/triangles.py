"""Warp device code only: rays against the triangles of a wp.Mesh, whose tree is walked here. Lengths in metres.

Rays that share an origin travel in packets: the bounds of the packet's directions cull the nodes of the tree, nearest
first, and a triangle is tested against all rays of the packet at once. Other rays walk the tree alone.

A ray hits a triangle when it passes its three edges on the same side. The plane through the origin and an edge is the
same, up to its sign, for both triangles that share the edge, so no ray slips through between them. Both walks use the
same test, and of equal distances the triangle with the lower number wins: who travels with whom cannot show.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

PACKET = 64  # rays of a packet
PART = 16  # rays that still travel together where the whole packet spreads too far
COHERENT = 0.6  # greatest extent, along any axis, of the unit directions of a packet that travels together

PACKET_SIZE = wp.constant(PACKET)
PART_SIZE = wp.constant(PART)
COHERENT_EXTENT = wp.constant(COHERENT)


@wp.struct
class TriangleScene:
    """Triangles, what they belong to, and what is present in each of R views."""

    mesh: wp.uint64
    element: wp.array[int]  # (triangles,)
    semantic: wp.array[wp.uint8]  # (elements,)
    present: wp.array2d[wp.uint8]  # (views or 1, elements)


# Products of differences of floats are exact in double precision, so the planes of a shared edge are exact opposites.
_EDGES = """
    struct Edges { float ux, uy, uz, vx, vy, vz, wx, wy, wz, nx, ny, nz, k; };
    const auto edges_of = [](const wp::vec3& p, const wp::vec3& q, const wp::vec3& r, float ox, float oy, float oz) {
        const double ax = p[0] - ox, ay = p[1] - oy, az = p[2] - oz;
        const double bx = q[0] - ox, by = q[1] - oy, bz = q[2] - oz;
        const double cx = r[0] - ox, cy = r[1] - oy, cz = r[2] - oz;
        const double px = bx - ax, py = by - ay, pz = bz - az, qx = cx - ax, qy = cy - ay, qz = cz - az;
        const double nx = py * qz - pz * qy, ny = pz * qx - px * qz, nz = px * qy - py * qx;
        Edges e;
        e.ux = (float)(cy * bz - cz * by); e.uy = (float)(cz * bx - cx * bz); e.uz = (float)(cx * by - cy * bx);
        e.vx = (float)(ay * cz - az * cy); e.vy = (float)(az * cx - ax * cz); e.vz = (float)(ax * cy - ay * cx);
        e.wx = (float)(by * az - bz * ay); e.wy = (float)(bz * ax - bx * az); e.wz = (float)(bx * ay - by * ax);
        e.nx = (float)(nx); e.ny = (float)(ny); e.nz = (float)(nz);
        e.k = (float)(ax * nx + ay * ny + az * nz);
        return e;
    };
"""


@wp.func_native(
    (
        _EDGES
        + """
    const float *__restrict dx = ray.data + start, *__restrict dy = dx + PACKET, *__restrict dz = dy + PACKET;
    float *__restrict best = nearest.data + start; int *__restrict face = hit.data + start;
    const float o[3] = {origin[0], origin[1], origin[2]};
    float low[3], high[3], inverse_low[3], inverse_high[3];
    for (int axis = 0; axis < 3; ++axis) {
        const float *d = dx + axis * PACKET;
        float a = d[0], b = d[0];
        for (int i = 1; i < count; ++i) { a = d[i] < a ? d[i] : a; b = d[i] > b ? d[i] : b; }
        low[axis] = a; high[axis] = b; inverse_low[axis] = 1.0f / a; inverse_high[axis] = 1.0f / b;
    }
    const wp::Mesh mesh = wp::mesh_get(scene.mesh);
    // A distance that no ray of the packet undercuts when it enters the node; infinity when none can.
    const auto entry = [&](int node) {
        const wp::BVHPackedNodeHalf l = mesh.bvh.node_lowers[node], u = mesh.bvh.node_uppers[node];
        const float lows[3] = {l.x, l.y, l.z}, highs[3] = {u.x, u.y, u.z};
        float first = 0.0f, last = 3.0e38f;
        for (int axis = 0; axis < 3; ++axis) {
            const float slack = 1e-4f + 1e-5f * (highs[axis] - lows[axis]);
            const float near = lows[axis] - slack - o[axis], far = highs[axis] + slack - o[axis];
            float t0 = 0.0f, t1 = 3.0e38f;
            if (near > 0.0f) t0 = high[axis] > 0.0f ? near * inverse_high[axis] : 3.0e38f;
            else if (far < 0.0f) t0 = low[axis] < 0.0f ? far * inverse_low[axis] : 3.0e38f;
            if (low[axis] > 0.0f) t1 = far * inverse_low[axis];
            else if (high[axis] < 0.0f) t1 = near * inverse_high[axis];
            first = t0 > first ? t0 : first; last = t1 < last ? t1 : last;
        }
        return first * 0.9999f > last * 1.0001f ? 3.0e38f : first * 0.9999f;
    };
    int stack[128]; float when[128]; int size = 0; float farthest = 3.0e38f;
    stack[size] = *mesh.bvh.root; when[size++] = 0.0f;
    while (size > 0) {
        const int node = stack[--size];
        if (when[size] > farthest) continue;
        const wp::BVHPackedNodeHalf l = mesh.bvh.node_lowers[node], u = mesh.bvh.node_uppers[node];
        if (!l.b) {
            const int left = l.i, right = u.i;
            const float t0 = entry(left), t1 = entry(right);
            const bool swap = t1 < t0;  // the nearer one is pushed last
            const int far_node = swap ? left : right, near_node = swap ? right : left;
            const float far_t = swap ? t0 : t1, near_t = swap ? t1 : t0;
            if (far_t < 3.0e38f && far_t <= farthest) { stack[size] = far_node; when[size++] = far_t; }
            if (near_t < 3.0e38f && near_t <= farthest) { stack[size] = near_node; when[size++] = near_t; }
            continue;
        }
        for (int place = l.i; place < (int)u.i; ++place) {
            const int f = mesh.bvh.primitive_indices[place];
            if (!scene.present.data[view * scene.present.shape[1] + scene.element.data[f]]) continue;
            const int *corner = mesh.indices.data + 3 * f;
            const Edges e = edges_of(mesh.points.data[corner[0]], mesh.points.data[corner[1]],
                mesh.points.data[corner[2]], o[0], o[1], o[2]);
            int most = 0;
            for (int i = 0; i < count; ++i) {
                const float x = dx[i], y = dy[i], z = dz[i];
                const float a = e.ux * x + e.uy * y + e.uz * z;
                const float b = e.vx * x + e.vy * y + e.vz * z;
                const float c = e.wx * x + e.wy * y + e.wz * z;
                const float along = e.nx * x + e.ny * y + e.nz * z;
                const float t = e.k / along;
                const bool inside = ((a >= 0.0f) & (b >= 0.0f) & (c >= 0.0f))
                    | ((a <= 0.0f) & (b <= 0.0f) & (c <= 0.0f));
                const bool better = inside & (t >= 0.0f) & ((t < best[i]) | ((t == best[i]) & (f < face[i])));
                best[i] = better ? t : best[i];
                face[i] = better ? f : face[i];
                int bits;
                __builtin_memcpy(&bits, &best[i], 4);
                most = bits > most ? bits : most;
            }
            __builtin_memcpy(&farthest, &most, 4);
        }
    }
"""
    ).replace("PACKET", str(PACKET))
)
def walk_together(
    scene: TriangleScene,
    view: int,
    origin: wp.vec3,
    start: int,
    count: int,
    ray: wp.array2d[float],
    nearest: wp.array[float],
    hit: wp.array[int],
): ...  # fmt: skip


@wp.func_native(
    _EDGES
    + """
    const float d[3] = {direction[0], direction[1], direction[2]}, o[3] = {origin[0], origin[1], origin[2]};
    float inverse[3];
    for (int axis = 0; axis < 3; ++axis) {
        const float safe = d[axis] < 1e-20f && d[axis] > -1e-20f ? 1e-20f : d[axis];
        inverse[axis] = 1.0f / safe;
    }
    const wp::Mesh mesh = wp::mesh_get(scene.mesh);
    const auto entry = [&](int node) {
        const wp::BVHPackedNodeHalf l = mesh.bvh.node_lowers[node], u = mesh.bvh.node_uppers[node];
        const float slack_x = 1e-4f + 1e-5f * (u.x - l.x), slack_y = 1e-4f + 1e-5f * (u.y - l.y);
        const float slack_z = 1e-4f + 1e-5f * (u.z - l.z);
        const float x0 = (l.x - slack_x - o[0]) * inverse[0], x1 = (u.x + slack_x - o[0]) * inverse[0];
        const float y0 = (l.y - slack_y - o[1]) * inverse[1], y1 = (u.y + slack_y - o[1]) * inverse[1];
        const float z0 = (l.z - slack_z - o[2]) * inverse[2], z1 = (u.z + slack_z - o[2]) * inverse[2];
        const float xa = x0 < x1 ? x0 : x1, xb = x0 < x1 ? x1 : x0;
        const float ya = y0 < y1 ? y0 : y1, yb = y0 < y1 ? y1 : y0;
        const float za = z0 < z1 ? z0 : z1, zb = z0 < z1 ? z1 : z0;
        float first = xa > ya ? xa : ya; first = first > za ? first : za; first = first > 0.0f ? first : 0.0f;
        float last = xb < yb ? xb : yb; last = last < zb ? last : zb;
        return first * 0.9999f > last * 1.0001f ? 3.0e38f : first * 0.9999f;
    };
    float best = __builtin_inff(); int face = -1;
    int stack[128]; float when[128]; int size = 0;
    stack[size] = *mesh.bvh.root; when[size++] = 0.0f;
    while (size > 0) {
        const int node = stack[--size];
        if (when[size] > best) continue;
        const wp::BVHPackedNodeHalf l = mesh.bvh.node_lowers[node], u = mesh.bvh.node_uppers[node];
        if (!l.b) {
            const int left = l.i, right = u.i;
            const float t0 = entry(left), t1 = entry(right);
            const bool swap = t1 < t0;
            const int far_node = swap ? left : right, near_node = swap ? right : left;
            const float far_t = swap ? t0 : t1, near_t = swap ? t1 : t0;
            if (far_t < 3.0e38f && far_t <= best) { stack[size] = far_node; when[size++] = far_t; }
            if (near_t < 3.0e38f && near_t <= best) { stack[size] = near_node; when[size++] = near_t; }
            continue;
        }
        for (int place = l.i; place < (int)u.i; ++place) {
            const int f = mesh.bvh.primitive_indices[place];
            if (!scene.present.data[view * scene.present.shape[1] + scene.element.data[f]]) continue;
            const int *corner = mesh.indices.data + 3 * f;
            const Edges e = edges_of(mesh.points.data[corner[0]], mesh.points.data[corner[1]],
                mesh.points.data[corner[2]], o[0], o[1], o[2]);
            const float a = e.ux * d[0] + e.uy * d[1] + e.uz * d[2];
            const float b = e.vx * d[0] + e.vy * d[1] + e.vz * d[2];
            const float c = e.wx * d[0] + e.wy * d[1] + e.wz * d[2];
            const float along = e.nx * d[0] + e.ny * d[1] + e.nz * d[2];
            const float t = e.k / along;
            const bool inside = ((a >= 0.0f) & (b >= 0.0f) & (c >= 0.0f)) | ((a <= 0.0f) & (b <= 0.0f) & (c <= 0.0f));
            if (inside && t >= 0.0f && (t < best || (t == best && f < face))) { best = t; face = f; }
        }
    }
    nearest.data[place_of_ray] = best; hit.data[place_of_ray] = face;
"""
)
def walk_alone(
    scene: TriangleScene, view: int, origin: wp.vec3, direction: wp.vec3, place_of_ray: int,
    nearest: wp.array[float], hit: wp.array[int],
): ...  # fmt: skip


@wp.func
def extent_of(ray: wp.array2d[float], start: int, count: int) -> float:
    """Greatest extent of some rays' directions along any axis."""
    low = wp.vec3(2.0, 2.0, 2.0)
    high = wp.vec3(-2.0, -2.0, -2.0)
    for i in range(start, start + count):
        direction = wp.vec3(ray[0, i], ray[1, i], ray[2, i])
        low = wp.min(low, direction)
        high = wp.max(high, direction)
    return wp.max(high - low)


@wp.kernel
def cast_packets(
    first_packet: int,
    scene: TriangleScene,
    ray_origin: wp.array2d[wp.vec3],  # (views, rays or 1)
    ray_direction: wp.array2d[wp.vec3],  # (views or 1, rays)
    rotation: wp.array[wp.mat33],  # (views or 1,) turns the directions into the world
    distance: wp.array2d[float],  # out (views, rays)
    hit_face: wp.array2d[int],  # out (views, rays), -1 on a miss
    hit_element: wp.array2d[int],  # out (views, rays), -1 on a miss
    hit_semantic: wp.array2d[wp.uint8],  # out (views, rays), 0 on a miss
):
    packet = first_packet + wp.tid()
    ray_count = distance.shape[1]
    packets_per_view = (ray_count + PACKET_SIZE - 1) // PACKET_SIZE
    view = packet // packets_per_view
    start = (packet - view * packets_per_view) * PACKET_SIZE
    filled = wp.min(PACKET_SIZE, ray_count - start)

    ray = wp.zeros(shape=(3, PACKET), dtype=float)
    nearest = wp.zeros(shape=(PACKET,), dtype=float)
    hit = wp.zeros(shape=(PACKET,), dtype=int)
    turn = rotation[wp.min(view, rotation.shape[0] - 1)]
    direction_view = wp.min(view, ray_direction.shape[0] - 1)
    present_view = wp.min(view, scene.present.shape[0] - 1)
    for i in range(PACKET_SIZE):
        direction = turn * ray_direction[direction_view, start + wp.min(i, filled - 1)]
        for axis in range(3):
            ray[axis, i] = direction[axis]
        nearest[i] = wp.inf
        hit[i] = -1
    shared = ray_origin.shape[1] == 1
    if shared and extent_of(ray, 0, PACKET_SIZE) <= COHERENT_EXTENT:
        walk_together(scene, present_view, ray_origin[view, 0], 0, PACKET_SIZE, ray, nearest, hit)
    else:
        for first in range(0, filled, PART_SIZE):
            if shared and extent_of(ray, first, PART_SIZE) <= COHERENT_EXTENT:
                walk_together(scene, present_view, ray_origin[view, 0], first, PART_SIZE, ray, nearest, hit)
            else:
                for i in range(first, wp.min(first + PART_SIZE, filled)):
                    origin = ray_origin[view, wp.min(start + i, ray_origin.shape[1] - 1)]
                    walk_alone(scene, present_view, origin, wp.vec3(ray[0, i], ray[1, i], ray[2, i]), i, nearest, hit)
    for i in range(filled):
        face = hit[i]
        distance[view, start + i] = nearest[i]
        hit_face[view, start + i] = face
        hit_element[view, start + i] = -1
        hit_semantic[view, start + i] = wp.uint8(0)
        if face >= 0:
            hit_element[view, start + i] = scene.element[face]
            hit_semantic[view, start + i] = scene.semantic[scene.element[face]]


@wp.kernel
def find_closest(
    mesh: wp.uint64,
    point: wp.array[wp.vec3],
    reach: float,
    distance: wp.array[float],  # out, reach where nothing is nearer
):
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, point[i], reach)
    distance[i] = reach
    if query.result:
        distance[i] = wp.length(point[i] - wp.mesh_eval_position(mesh, query.face, query.u, query.v))
