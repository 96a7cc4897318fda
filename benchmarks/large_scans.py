"""How much memory and time `jaxmm detect` takes for a large scan, in every format.

    python -m benchmarks.large_scans [--points 50000000] [--formats ply laz ...] [--frame sensor] [--json FILE]
    python -m benchmarks.large_scans --formats ply laz e57 --against REVISION [--repeat 3]     beside another build

An hour for all formats. With --against another build, a checkout or a revision of this one, does the same in turns.

A generated room is scanned from one place in random directions with 3 mm of noise, and written block by block in one
format at a time. A process of its own compares it with the room's IFC file, as a user would, and the peak of its
resident memory is taken. With `--frame` the file holds points in the frame of the sensor or of its optics, which the
given pose takes to the room, or with `viewpoint` those that the pose in a PCD file does. A file takes up to 2 GB of the
disk, and none outlives its turn. The exit code is 1 where anything took more than the limit.
"""

import shutil
import statistics
import sys
import tempfile
from argparse import Namespace
from pathlib import Path

import numpy as np

from benchmarks.command_line import CommandLine
from benchmarks.commands import ROOT, Build, Usage, checkout
from benchmarks.timing import write_report
from benchmarks.views.scan_writers import FORMATS, Blocks
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.rooms.pairs import PairConfig
from warp_scanner.rooms.scenarios import Scenes, make_scenes
from warp_scanner.scenes.scenes import GAP
from warp_scanner.sensors.scan import Rays, cast_rays

FULL = {"points": 50_000_000, "formats": list(FORMATS)}
SMOKE = {"points": 20_000, "formats": ["e57", "laz"]}
SMALL = 20_000  # points
LIMIT = 2.5  # [GiB] of memory
NOISE = 0.003  # [m] of the ranges
SEED = 2  # of room and noise
FRAMES = {  # how points of the sensor (n, 3), who stands at a place (3,), come into a file
    "world": lambda own, place: own + place,
    "sensor": lambda own, place: own,
    "optical": lambda own, place: np.column_stack([-own[:, 1], -own[:, 2], own[:, 0]]),
    "viewpoint": lambda own, place: own,
}


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    parser.add_argument("--points", type=int, help="points of the scan")
    parser.add_argument("--formats", nargs="+", choices=FORMATS, help="which, in this order")
    parser.add_argument("--frame", choices=FRAMES, default="world", help="of the points in the file (default world)")
    parser.add_argument("--folder", type=Path, help="where the files are put while they are needed")
    parser.add_argument("--against", metavar="DIR|REVISION", help="another build, which takes turns")
    parser.add_argument("--repeat", type=int, default=1, metavar="N", help="rounds, of which the median counts")
    options = parser.parse_args()
    if options.repeat < 1:
        parser.error(f"--repeat: expected at least 1, got {options.repeat}")
    with tempfile.TemporaryDirectory() as work:
        builds = [Build(ROOT, Path(work) / "this")]
        if options.against:
            builds.append(Build(checkout(options.against, Path(work)), Path(work) / "other"))
        rows = rows_of(options, builds)
    if options.json:
        write_report(options.json, rows, "numpy", "pye57", "laspy", "lazrs", "pypcd4")
    return int(any(row["ours"] > LIMIT for row in rows))


def rows_of(options: Namespace, builds: list[Build]) -> list[dict]:
    """A row for each format, after a small scan that fills the caches; no file outlives its turn."""
    scenes = make_scenes(PairConfig(scenario="pillar_added", condition="occluded").scene, SEED, np.array([0]))
    rows = []
    for name, points in ((options.formats[0], SMALL), *((name, options.points) for name in options.formats)):
        with tempfile.TemporaryDirectory(dir=options.folder) as folder:
            path = Path(folder) / f"scan.{FORMATS[name].suffix}"
            write(path, name, points, scenes, options.frame)
            case = name if options.frame == "world" else f"{name}, {options.frame}"
            case = case if rows else "small, to fill the caches"
            rows.append(row_of(case, path, detection(scenes, path, options.frame), options.repeat, builds))
    return rows[1:]


def write(path: Path, name: str, points: int, scenes: Scenes, frame: str) -> None:
    """A scan of the room in a format, in a frame."""
    place = scenes.pose.position[0].astype(np.float64)

    def make(part: int, count: int) -> np.ndarray:
        return FRAMES[frame](scanned(scenes, part, count) - place, place)

    FORMATS[name].write(path, Blocks(points, make, tuple(place) if frame == "viewpoint" else (0.0,) * 3))


def detection(scenes: Scenes, scan: Path, frame: str) -> list:
    """Arguments of the job: the room as an IFC file beside the scan, the scanner's pose, the frame of its points."""
    prior, pose = scan.with_name("room.ifc"), scenes.pose
    write_room(prior, scenes.primitives._replace(kind=np.where(scenes.in_prior, scenes.primitives.kind, GAP)), 0)
    place = ",".join(f"{value:.6f}" for value in (*pose.position[0], 0.0))
    how = [] if frame == "viewpoint" else [f"--pose={place}", *(["--frame", frame] if frame != "world" else [])]
    return ["-m", "jaxmm", "detect", prior, scan, *how, "--out", scan.with_name("found")]


def row_of(case: str, path: Path, words: list, rounds: int, builds: list[Build]) -> dict:
    """What a process of its own takes for its work with a file, by one build or two in turns.

    Raises:
        SystemExit: it failed, in its own words.
    """
    taken = [[_once(build, words, path) for build in builds] for _ in range(rounds)]
    ours, *others = (Usage(*map(statistics.median, zip(*runs, strict=True))) for runs in zip(*taken, strict=True))
    peak, size = ours.peak * 1e6 / 2**30, path.stat().st_size / 1e9
    print(f"{case}: {size:.2f} GB on disk, {peak:.2f} GiB, {ours.seconds:.0f} s, {ours.computing:.0f} s of computing")
    row = {
        "case": case, "ours": round(peak, 2), "peer": LIMIT, "peer_name": "limit", "unit": "GiB",
        "ratio": round(LIMIT / peak, 2), "seconds": round(ours.seconds, 1), "computing": round(ours.computing, 1),
        "file_gb": round(size, 2),
    }  # fmt: skip
    for other in others:
        times = ours.seconds / other.seconds, ours.computing / other.computing, ours.peak / other.peak
        print(
            f"    {times[0]:.2f} times the other build's {other.seconds:.0f} s, {times[1]:.2f} of its computing, "
            f"{times[2]:.2f} of its memory"
        )
        row |= {"other_seconds": round(other.seconds, 1), "times": round(times[0], 3), "times_peak": round(times[2], 3)}
    sys.stdout.flush()
    return row


def _once(build: Build, words: list, path: Path) -> Usage:
    shutil.rmtree(path.with_name("found"), ignore_errors=True)
    return build.run([str(word) for word in words])


def scanned(scenes: Scenes, part: int, count: int) -> np.ndarray:
    """Points (count, 3) float64 [m] of one part of the scan; the same part has the same points."""
    rng, found = np.random.default_rng([SEED, part]), np.zeros((0, 3))
    origin = scenes.pose.position[:1].astype(np.float64)
    while len(found) < count:  # a ray through a window hits nothing
        direction = rng.normal(size=(count, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        rays = Rays(origin.astype(np.float32), direction.astype(np.float32))
        distance = cast_rays(scenes.primitives, scenes.in_real, rays).distance[0] + rng.normal(0.0, NOISE, count)
        hit = np.isfinite(distance)
        found = np.concatenate([found, origin + distance[hit, None] * direction[hit]])
    return found[:count]


if __name__ == "__main__":
    sys.exit(main())
