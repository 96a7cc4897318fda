"""Warp device code that measures how far points are from the surfaces of primitives. No NumPy. Metres, world frame."""

import warp as wp

from warp_scanner.scenes.scenes import BOX, GAP

wp.set_module_options({"enable_backward": False})

KIND_BOX = wp.constant(BOX)
KIND_GAP = wp.constant(GAP)


@wp.struct
class Solids:
    """K primitives of R rooms; what is not there is a gap."""

    kind: wp.array2d[wp.uint8]  # (R, K)
    center: wp.array2d[wp.vec3]  # (R, K)
    half_size: wp.array2d[wp.vec3]  # (R, K)
    turn: wp.array2d[wp.vec2]  # (R, K) cosine and sine of the yaw


@wp.kernel
def measure(
    first: int, solids: Solids, room_of: wp.array[wp.int32], point: wp.array[wp.vec3], apart: wp.array[wp.float32]
):
    """Distance of each point to the nearest surface, whichever side it is on. One thread a point."""
    at = first + wp.tid()
    room = room_of[at]
    least = float(wp.inf)
    for slot in range(solids.kind.shape[1]):
        if int(solids.kind[room, slot]) != KIND_GAP:
            offset = point[at] - solids.center[room, slot]
            half = solids.half_size[room, slot]
            # Nothing of the solid is nearer than its bounding sphere; from inside of that, look closely.
            if wp.length(offset) - wp.length(half) < least:
                turn = solids.turn[room, slot]
                x = turn[0] * offset[0] + turn[1] * offset[1]
                y = turn[0] * offset[1] - turn[1] * offset[0]
                if int(solids.kind[room, slot]) == KIND_BOX:
                    beyond = wp.vec3(wp.abs(x) - half[0], wp.abs(y) - half[1], wp.abs(offset[2]) - half[2])
                else:
                    beyond = wp.vec3(wp.sqrt(x * x + y * y) - half[0], -1.0e9, wp.abs(offset[2]) - half[2])
                outside = wp.length(wp.max(beyond, wp.vec3(0.0, 0.0, 0.0)))
                inside = wp.max(beyond[0], wp.max(beyond[1], beyond[2]))
                least = wp.min(least, wp.where(inside < 0.0, -inside, outside))
    apart[at] = least
