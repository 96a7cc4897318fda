"""Device code for what rays meet: normals of primitives, and the angle at which they are hit. Lengths in metres."""

import warp as wp

wp.set_module_options({"enable_backward": False})

BOX_KIND = wp.constant(1)


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
    yaw: wp.array2d[float],
    slot: wp.array2d[int],  # (rooms, rays) which primitive was hit, -1 none
    distance: wp.array2d[float],
    origin: wp.array2d[wp.vec3],  # (rooms, 1 or rays)
    direction: wp.array2d[wp.vec3],  # (1 or rooms, rays)
    rotation: wp.array[wp.mat33],  # (1 or rooms,)
    normal: wp.array2d[wp.vec3],  # out (rooms, rays) world, against the ray; NaN where nothing was hit
):
    room, ray = wp.tid()
    hit = slot[room, ray]
    if hit < 0:
        normal[room, ray] = wp.vec3(wp.nan, wp.nan, wp.nan)
        return
    turn = rotation[room % rotation.shape[0]]
    toward = turn * direction[room % direction.shape[0], ray]
    world = origin[room, ray % origin.shape[1]] + distance[room, ray] * toward - center[room, hit]
    cosine = wp.cos(yaw[room, hit])
    sine = wp.sin(yaw[room, hit])
    point = wp.vec3(cosine * world[0] + sine * world[1], cosine * world[1] - sine * world[0], world[2])
    own = wp.vec3()
    if int(kind[room, hit]) == BOX_KIND:
        own = box_normal(point, half_size[room, hit])
    else:
        own = cylinder_normal(point, half_size[room, hit])
    outward = wp.vec3(cosine * own[0] - sine * own[1], sine * own[0] + cosine * own[1], own[2])
    # Seen from inside, the surface's other side faces the ray.
    normal[room, ray] = wp.where(wp.dot(outward, toward) > 0.0, -outward, outward)


@wp.kernel
def angles(
    normal: wp.array2d[wp.vec3],  # (rooms, rays) world, of any length and either sign; NaN where there is none
    direction: wp.array2d[wp.vec3],  # (1 or rooms, rays)
    rotation: wp.array[wp.mat33],  # (1 or rooms,)
    incidence: wp.array2d[float],  # out (rooms, rays) [rad]
):
    room, ray = wp.tid()
    toward = rotation[room % rotation.shape[0]] * direction[room % direction.shape[0], ray]
    along = wp.abs(wp.dot(normal[room, ray], toward))
    # The arc cosine would lose half its digits near zero.
    across = wp.length(wp.cross(normal[room, ray], toward))
    incidence[room, ray] = wp.where(along + across > 0.0, wp.atan2(across, along), wp.nan)
