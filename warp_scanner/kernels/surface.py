"""Device code for what rays meet: normals of primitives, and the angle at which they are hit. Lengths in metres.

One thread takes a packet of consecutive rays of a room, so that what they share is fetched once and the loop over them
can become vector instructions.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

PACKET = 256  # rays of a packet
PACKET_SIZE = wp.constant(PACKET)
BOX_KIND = wp.constant(1)
RIGHT_ANGLE = wp.constant(1.5707963267948966)


@wp.func
def box_normal(point: wp.vec3, half_size: wp.vec3) -> wp.vec3:
    """Normal of the face that the point lies on, in the box's own frame: of all six, the plane nearest to it."""
    x = wp.abs(wp.abs(point[0]) - half_size[0])
    y = wp.abs(wp.abs(point[1]) - half_size[1])
    z = wp.abs(wp.abs(point[2]) - half_size[2])
    if x <= y and x <= z:
        return wp.vec3(wp.sign(point[0]), 0.0, 0.0)
    if y <= z:
        return wp.vec3(0.0, wp.sign(point[1]), 0.0)
    return wp.vec3(0.0, 0.0, wp.sign(point[2]))


@wp.func
def cylinder_normal(point: wp.vec3, half_size: wp.vec3) -> wp.vec3:
    """Normal of mantle or end, in the cylinder's own frame."""
    reach = wp.sqrt(point[0] * point[0] + point[1] * point[1])
    if wp.abs(reach - half_size[0]) <= wp.abs(wp.abs(point[2]) - half_size[2]):
        return wp.vec3(point[0], point[1], 0.0) / wp.max(reach, 1.0e-12)
    return wp.vec3(0.0, 0.0, wp.sign(point[2]))


@wp.kernel
def primitive_normals(
    kind: wp.array2d[wp.uint8],  # (rooms, slots)
    center: wp.array2d[wp.vec3],
    half_size: wp.array2d[wp.vec3],
    turn: wp.array2d[wp.vec2],  # cosine and sine of the yaw
    slot: wp.array2d[int],  # (rooms, rays) which primitive was hit, -1 none
    distance: wp.array2d[float],
    origin: wp.array2d[wp.vec3],  # (rooms, 1 or rays)
    direction: wp.array2d[wp.vec3],  # (1 or rooms, rays)
    rotation: wp.array[wp.mat33],  # (1 or rooms,)
    normal: wp.array2d[wp.vec3],  # out (rooms, rays) world, against the ray; NaN where nothing was hit
):
    room, packet = wp.tid()
    turned = rotation[wp.min(room, rotation.shape[0] - 1)]
    row = wp.min(room, direction.shape[0] - 1)
    for ray in range(packet * PACKET_SIZE, wp.min((packet + 1) * PACKET_SIZE, slot.shape[1])):
        hit = slot[room, ray]
        if hit < 0:
            normal[room, ray] = wp.vec3(wp.nan, wp.nan, wp.nan)
        else:
            toward = turned * direction[row, ray]
            world = origin[room, wp.min(ray, origin.shape[1] - 1)] + distance[room, ray] * toward - center[room, hit]
            cosine = turn[room, hit][0]
            sine = turn[room, hit][1]
            point = wp.vec3(cosine * world[0] + sine * world[1], cosine * world[1] - sine * world[0], world[2])
            own = wp.vec3()
            if int(kind[room, hit]) == BOX_KIND:
                own = box_normal(point, half_size[room, hit])
            else:
                own = cylinder_normal(point, half_size[room, hit])
            outward = wp.vec3(cosine * own[0] - sine * own[1], sine * own[0] + cosine * own[1], own[2])
            # Seen from inside, the surface's other side faces the ray.
            normal[room, ray] = wp.where(wp.dot(outward, toward) > 0.0, -outward, outward)


@wp.func
def angle_between(along: float, across: float) -> float:
    """The angle [rad] in [0, pi/2] whose cosine and sine are as `along` to `across`, both at least 0; NaN for 0 to 0.

    The arc cosine would lose half its digits near zero. The arc tangent's polynomial is Abramowitz and Stegun's 4.4.49,
    wrong by 2e-8 at most: less than float32 rounds, and a fraction of the time of the library's.
    """
    x = wp.min(along, across) / wp.max(along, across)
    s = x * x
    p = 0.0429096138 + s * (-0.0161657367 + s * 0.0028662257)
    p = -0.1420889944 + s * (0.1065626393 + s * (-0.0752896400 + s * p))
    angle = x * (1.0 + s * (-0.3333314528 + s * (0.1999355085 + s * p)))
    return wp.where(across > along, RIGHT_ANGLE - angle, angle)


@wp.kernel
def angles(
    normal: wp.array2d[wp.vec3],  # (rooms, rays) world, of any length and either sign; NaN where there is none
    direction: wp.array2d[wp.vec3],  # (1 or rooms, rays)
    rotation: wp.array[wp.mat33],  # (1 or rooms,)
    incidence: wp.array2d[float],  # out (rooms, rays) [rad]
):
    room, packet = wp.tid()
    turned = rotation[wp.min(room, rotation.shape[0] - 1)]
    row = wp.min(room, direction.shape[0] - 1)
    for ray in range(packet * PACKET_SIZE, wp.min((packet + 1) * PACKET_SIZE, normal.shape[1])):
        toward = turned * direction[row, ray]
        along = wp.abs(wp.dot(normal[room, ray], toward))
        across = wp.length(wp.cross(normal[room, ray], toward))
        incidence[room, ray] = angle_between(along, across)
