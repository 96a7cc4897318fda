"""Rays per second on rooms of primitives, beside Open3D's RaycastingScene (Embree) on the same rays.

    python -m benchmarks.rays [--json FILE]        a minute or two; needs the `peers` extra

Ours answers with range, element and semantic class of the first surface along every ray, and prepares its scene while
the clock runs: once as an image of a pinhole camera, and once by the general kernel that takes any rays. Open3D gets
the rooms as triangles, cylinders with 64 sides; its scenes are built and its rays laid out
before the clock starts, and what it costs to turn its triangle ids into elements is not counted either.
"""

import sys

import numpy as np

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.timing import Timing, measure_in_turns, write_report
from warp_scanner import draws
from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.rooms.standing import Standing, draw_poses
from warp_scanner.scenes.scenes import BOX, GAP, Primitives, scene_mesh, take
from warp_scanner.sensors.pinhole import cast_image, cast_image_slots
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Rays, cast_rays, cast_slots
from warp_scanner.sensors.sensors import OAK_D_PRO, OAK_D_PRO_SMALL, Pinhole

PRIMITIVES = (130, 170)  # rooms of about 150 primitives
FULL = {"cases": ((OAK_D_PRO_SMALL, 32, 15), (OAK_D_PRO, 8, 9))}  # sensor, rooms, repeats
SMOKE = {"cases": ((OAK_D_PRO_SMALL, 2, 1),)}


class Embree:
    """Open3D's ray caster on the rooms of a table."""

    def __init__(self, primitives: Primitives, rays: Rays):
        import open3d

        self.core = open3d.core
        self.scenes, self.slots, self.rays = [], [], []
        for room in range(len(primitives.kind)):
            vertices, triangles, slot = scene_mesh(primitives, room)
            scene = open3d.t.geometry.RaycastingScene()
            scene.add_triangles(
                self.core.Tensor(vertices.astype(np.float32)), self.core.Tensor(triangles.astype(np.uint32))
            )
            directions = rays.direction @ rays.rotation[room].T
            origin = np.broadcast_to(rays.origin[room], directions.shape)
            self.rays.append(self.core.Tensor(np.concatenate([origin, directions], axis=1).astype(np.float32)))
            self.scenes.append(scene)
            self.slots.append(np.append(slot, -1).astype(np.int32))

    def cast(self, threads: int) -> list[dict]:
        """What Open3D answers, room by room."""
        return [scene.cast_rays(rays, nthreads=threads) for scene, rays in zip(self.scenes, self.rays, strict=True)]

    def cast_slots(self) -> tuple[np.ndarray, np.ndarray]:
        """Distance and slot of the primitive hit, each (R, P), as ours."""
        answers = self.cast(threads=0)
        # The id of a miss is the largest uint32; the last entry of the table stands for it.
        slots = [
            slot[np.minimum(answer["primitive_ids"].numpy(), len(slot) - 1)]
            for answer, slot in zip(answers, self.slots, strict=True)
        ]
        return np.stack([answer["t_hit"].numpy() for answer in answers]), np.stack(slots)


def rooms_and_poses(count: int) -> tuple[Primitives, Pose]:
    """Generated rooms with about 150 primitives and a sensor in free space in each."""
    config, index = RoomConfig(), np.arange(40 * count)
    primitives = make_rooms(config, 0, index)
    pose, found = draw_poses(primitives, config.size, Standing(), draws.keys(0, index))
    size = np.sum(primitives.kind != GAP, axis=1)
    chosen = np.flatnonzero(found & (size >= PRIMITIVES[0]) & (size <= PRIMITIVES[1]))[:count]
    return take(primitives, chosen), Pose(*(field[chosen] for field in pose))


def rays_of(sensor: Pinhole, pose: Pose) -> Rays:
    """The rays of the sensor's pixels."""
    return Rays(pose.position, sensor.directions(), rotation_of(pose.yaw, pose.pitch))


def agreement(primitives: Primitives, ours: tuple, peer: tuple) -> dict[str, float]:
    """How far two answers (distance, slot) agree: rays with the same primitive, and how ranges differ there."""
    (distance, slot), (peer_distance, peer_slot) = ours, peer
    same = slot == peer_slot
    difference = np.abs(distance - peer_distance)[same]
    # Cylinders are polygons to the peer, so only boxes can agree to rounding.
    box = (np.take_along_axis(primitives.kind, np.maximum(slot, 0), axis=1) == BOX)[same]
    return {
        "same_primitive_share": float(same.mean()),
        "box_range_difference_max_m": float(difference[box].max(initial=0.0)),
        "range_difference_p999_m": float(np.quantile(difference, 0.999)),
    }


def rows_of(sensor: Pinhole, room_count: int, repeat: int) -> list[dict]:
    """One row per kernel and thread count, with the agreement of the answers in each."""
    primitives, pose = rooms_and_poses(room_count)
    rays = rays_of(sensor, pose)
    peer = Embree(primitives, rays)
    image, general = cast_image_slots(primitives, None, sensor, pose), cast_slots(primitives, None, rays)
    answers = {"pinhole": image, "any rays": general}
    agreed = {name: agreement(primitives, answer, peer.cast_slots()) for name, answer in answers.items()}
    agreed["pinhole"]["same_as_general_share"] = float(np.mean(image[1] == general[1]))
    ray_count = len(primitives.kind) * len(rays.direction)

    def speed(timing: Timing) -> float:
        return round(ray_count / timing.median / 1e6, 2)

    rows = []
    for threads in (1, 2):
        contestants = [
            lambda n=threads: cast_image(primitives, None, sensor, pose, threads=n),
            lambda n=threads: cast_rays(primitives, None, rays, threads=n),
            lambda n=threads: peer.cast(n),
        ]
        *ours, theirs = measure_in_turns(contestants, repeat)
        for name, timing in zip(answers, ours, strict=True):
            row = {
                "case": f"{name}, {sensor.width}x{sensor.height}, {threads} thread{'s' * (threads > 1)}",
                "ours": speed(timing),
                "peer": speed(theirs),
                "peer_name": "Open3D RaycastingScene (Embree)",
                "unit": "Mrays/s",
                "ratio": round(theirs.median / timing.median, 2),
                "ours_first_call_s": round(timing.first, 3),
                "peer_first_call_s": round(theirs.first, 3),
                "rooms": len(primitives.kind),
                "primitives": float(np.mean(np.sum(primitives.kind != GAP, axis=1))),
            }
            rows.append(row | agreed[name])
    return rows


def first_call() -> float:
    """Seconds of the first cast of this process: fetching the kernels, or compiling them when the cache is empty."""
    primitives, pose = rooms_and_poses(1)
    both = [
        lambda: cast_image(primitives, None, OAK_D_PRO_SMALL, pose),
        lambda: cast_rays(primitives, None, rays_of(OAK_D_PRO_SMALL, pose)),
    ]
    return sum(timing.first for timing in measure_in_turns(both, repeat=1))


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    options = parser.parse_args()
    start = first_call()
    print(f"first casts of this process, kernels fetched or compiled: {start:.2f} s")
    rows = []
    for sensor, rooms, repeat in options.cases if peers.has("open3d") else ():
        for row in rows_of(sensor, rooms, repeat):
            rows.append(row)
            print(
                f"{row['case']:32} ours {row['ours']:7.2f}  Open3D {row['peer']:7.2f} {row['unit']}"
                f"  ratio {row['ratio']:5.2f}"
                f"  first call {row['ours_first_call_s']:.3f} s / {row['peer_first_call_s']:.3f} s"
            )
        for row in rows[-2:]:
            print(
                f"    {row['case'].split(',')[0]}: same primitive as Open3D on {row['same_primitive_share']:.4%};"
                f" there boxes differ by at most {row['box_range_difference_max_m']:.1e} m, everything by"
                f" {row['range_difference_p999_m']:.1e} m (99.9 %)"
            )
        print(
            f"    pinhole: same primitive as the general kernel on {rows[-2]['same_as_general_share']:.5%} of the rays"
        )
    if options.json:
        write_report(options.json, rows, "open3d", "warp-lang", "numpy", kernel_first_call_s=start)
    return 0


if __name__ == "__main__":
    sys.exit(main())
