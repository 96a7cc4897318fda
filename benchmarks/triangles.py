"""Rays per second on triangles, beside Open3D's RaycastingScene (Embree) on the same triangles and rays.

    python -m benchmarks.triangles [--scene BUILDING ...] [--json FILE]     a minute; needs the `peers` extra

Without --scene the triangles are generated rooms of about 150 primitives; --scene takes IFC and mesh files. Both trees
are built before the clock starts (what that takes is printed), and ours answers with range, element and class. `camera`
is the grid of the OAK-D Pro, `sphere` a scanner that turns all the way round, `any` rays in random order, directions
and origins, which no sensor casts and which share nothing.
"""

import sys
import time
from pathlib import Path

import numpy as np

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.rays import rooms_and_poses
from benchmarks.timing import measure_in_turns, write_report
from warp_scanner import draws
from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.positions import draw_positions
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.scenes import scene_mesh
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, prepare

VIEWS = 8
FULL, SMOKE = {"repeat": 9}, {"repeat": 1}


def room_triangles() -> tuple[Triangles, np.ndarray]:
    """One generated room, and eight times its one free position."""
    primitives, pose = rooms_and_poses(1)
    vertices, faces, slot = scene_mesh(primitives, 0)
    slots, element = np.unique(slot, return_inverse=True)
    parts = vertices.astype(np.float32), faces.astype(np.int32), element.astype(np.int32)
    return Triangles(*parts, primitives.semantic[0, slots]), np.repeat(pose.position, VIEWS, axis=0)


def building_triangles(path: Path) -> tuple[Triangles, np.ndarray]:
    """A building, and eight free positions in it."""
    building = read_building(path)
    key = draws.keys(0, np.arange(8 * VIEWS))
    pose, found = draw_positions(building, prepare(building.triangles), Standing(), key)
    if not found.any():
        raise SystemExit(f"{path}: found no place for a sensor")
    return building.triangles, pose.position[np.resize(np.flatnonzero(found), VIEWS)]


def kinds_of_rays(position: np.ndarray) -> dict[str, Rays]:
    """The same positions with the rays of a camera, of a full sphere, and with anything."""
    rng = np.random.default_rng(0)
    camera = Rays(position, OAK_D_PRO_SMALL.directions(), rotation_of(45.0 * np.arange(VIEWS) + 7.0, np.zeros(VIEWS)))
    up, around = np.meshgrid(
        np.linspace(-1.5, 1.5, 160), np.linspace(-np.pi, np.pi, 400, endpoint=False), indexing="ij"
    )
    sphere = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)], axis=-1).reshape(-1, 3)
    anywhere = rng.normal(size=(VIEWS, 20_000, 3))
    anywhere /= np.linalg.norm(anywhere, axis=-1, keepdims=True)
    origin = position[:, None] + rng.uniform(-0.3, 0.3, anywhere.shape)
    return {"camera": camera, "sphere": Rays(position, sphere), "any": Rays(origin, anywhere)}


class Embree:
    """Open3D's ray caster on the same triangles and rays."""

    def __init__(self, triangles: Triangles, rays: Rays):
        import open3d

        tensor = open3d.core.Tensor
        self.scene = open3d.t.geometry.RaycastingScene()
        self.scene.add_triangles(tensor(triangles.vertices), tensor(triangles.faces.astype(np.uint32)))
        direction = np.asarray(rays.direction, np.float32)
        if rays.rotation is not None:
            direction = np.einsum("rij,pj->rpi", rays.rotation, direction)
        origin = np.asarray(rays.origin, np.float32)
        origin = origin if origin.ndim == 3 else origin[:, None]
        shape = np.broadcast_shapes(direction.shape, origin.shape)
        both = [np.broadcast_to(part, shape) for part in (origin, direction)]
        self.shape, self.rays = shape[:2], tensor(np.concatenate(both, axis=-1).reshape(-1, 6))

    def cast(self, threads: int) -> dict:
        """What Open3D answers."""
        return self.scene.cast_rays(self.rays, nthreads=threads)

    def distance(self) -> np.ndarray:
        """Distance (R, P), as ours."""
        return self.cast(0)["t_hit"].numpy().reshape(self.shape)


def rows_of(name: str, scene: TriangleScene, position: np.ndarray, repeat: int) -> list[dict]:
    """One row per kind of rays and thread count, with how far the answers agree."""
    rows = []
    for kind, rays in kinds_of_rays(position).items():
        peer = Embree(scene.triangles, rays)
        ours, theirs = cast_triangles(scene, rays).distance, peer.distance()
        with np.errstate(invalid="ignore"):
            differs = ~((np.abs(ours - theirs) <= 1e-4) | (np.isinf(ours) & np.isinf(theirs)))
        for threads in (1, 2):
            own, other = measure_in_turns(
                [lambda n=threads, r=rays: cast_triangles(scene, r, threads=n), lambda n=threads, p=peer: p.cast(n)],
                repeat,
            )
            rows.append(
                {
                    "case": f"{name}, {kind}, {threads} thread{'s' * (threads > 1)}",
                    "ours": round(ours.size / own.median / 1e6, 2),
                    "peer": round(ours.size / other.median / 1e6, 2),
                    "peer_name": "Open3D RaycastingScene (Embree)",
                    "unit": "Mrays/s",
                    "ratio": round(other.median / own.median, 2),
                    "triangles": len(scene.triangles.faces),
                    "rays": int(ours.size),
                    "differing_rays": int(differs.sum()),
                }
            )
    return rows


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("--scene", type=Path, nargs="+", default=[], help="IFC or mesh files")
    parser.add_json()
    options = parser.parse_args()
    compared = peers.has("open3d")
    scenes = {"generated room": room_triangles()} | {path.stem: building_triangles(path) for path in options.scene}
    rows: list[dict] = []
    for name, (triangles, position) in scenes.items():
        prepare(triangles)  # fetches or compiles the kernels
        start = time.perf_counter()
        scene = prepare(triangles)
        print(f"{name}: {len(triangles.faces)} triangles, tree in {1e3 * (time.perf_counter() - start):.1f} ms")
        for row in rows_of(name, scene, position, options.repeat) if compared else ():
            rows.append(row)
            print(
                f"  {row['case']:50} ours {row['ours']:6.2f}  Open3D {row['peer']:6.2f} {row['unit']}"
                f"  ratio {row['ratio']:4.2f}  {row['differing_rays']} of {row['rays']} rays differ"
            )
    if options.json:
        write_report(options.json, rows, "open3d", "warp-lang", "numpy")
    return 0


if __name__ == "__main__":
    sys.exit(main())
