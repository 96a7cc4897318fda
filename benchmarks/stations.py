"""How long many stations of one building take, and how much memory, against their number.

    python -m benchmarks.stations IFC [--against ../other] [--stations 1 4 16 64] [--json FILE]    half an hour
    python -m benchmarks.stations IFC --workers 1 --kinds ply

A terrestrial scanner stands at places inside an IFC file, of whose walls and columns every twentieth is gone. Its scans
are written as one PLY file each, or as one E57 file of all, and `jaxmm detect` runs on so many of them, in turns with
another checkout of jaxmm where one is given. Time is by the clock, and computing that of all its processes. Memory is
the greatest sum of what its processes hold at one time (their proportional share of pages, as Linux tells it).
"""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.command_line import CommandLine
from benchmarks.timing import write_report
from benchmarks.views.building_views import building_places, made_building, scanned
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.poses import rotation_of
from warp_scanner.sensors.sensors import sensor_named

FULL = {"stations": (1, 4, 16, 64), "kinds": ("ply", "e57"), "sensor": "tls-real"}
SMOKE = {"stations": (1, 4), "kinds": ("ply",), "sensor": "velodyne-16-real"}
SEED, EVERY = 7, 20
ROOT = Path(__file__).resolve().parents[1]
OFTEN = 0.1  # [s] between looks at memory


class Usage(NamedTuple):
    """What one command took."""

    seconds: float
    computing: float  # [s] of all its processes
    peak: float  # [GB] of all its processes together


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    parser.add_input("ifc")
    parser.add_argument("--stations", type=int, nargs="+", metavar="N", help="how many, in turn")
    parser.add_argument("--kinds", nargs="+", choices=FULL["kinds"], help="one file a scan, or one of all")
    parser.add_argument("--sensor", metavar="NAME", help="of the scans")
    parser.add_argument("--workers", type=int, metavar="N", help="processes of this build; default: one a core")
    parser.add_argument("--against", type=Path, metavar="FOLDER", help="another checkout of jaxmm")
    options = parser.parse_args()
    ifc, rows = options.ifc or next(made_building(parser.scratch / "ifc").glob("*.ifc")), []
    with TemporaryDirectory() as folder:
        scans, poses = written(ifc, max(options.stations), options.sensor, Path(folder))
        for kind in options.kinds:
            for count in options.stations:
                files = scans[:count] if kind == "ply" else [one_e57(Path(folder), scans[:count], poses)]
                words = [word for pose in poses[:count] for word in ("--pose", pose)] if kind == "ply" else []
                own = [] if options.workers is None else ["--workers", str(options.workers)]
                ours = run(ROOT, [ifc, *files, *words, *own], Path(folder) / "found")
                peer = options.against and run(options.against, [ifc, *files, *words], Path(folder) / "found")
                rows += told(f"{count} stations, {kind}", ours, peer)
    if options.json:
        write_report(options.json, rows, "warp-lang", "jax", "numpy")
    return 0


def told(case: str, ours: Usage, peer: Usage | None) -> list[dict[str, Any]]:
    """A row each of time, computing and memory, which are printed, too; ratio above 1 where this build takes less."""
    rows = []
    for name, unit in (("seconds", "s"), ("computing", "s"), ("peak", "GB")):
        mine, other = getattr(ours, name), None if peer is None else getattr(peer, name)
        beside = "" if other is None else f", the other build {other:.2f}: {mine / other:.2f} times as much"
        print(f"{case}, {name}: {mine:.2f} {unit}{beside}", flush=True)
        rows.append({
            "case": f"{case}, {name}", "ours": round(mine, 3), "peer": other and round(other, 3),
            "peer_name": "another build", "unit": unit, "ratio": other and round(other / mine, 3),
        })  # fmt: skip
    return rows


def written(ifc: Path, count: int, sensor: str, folder: Path) -> tuple[list[Path], list[str]]:
    """So many scans of a building as PLY files, and the words of their poses."""
    with TemporaryDirectory() as alone:
        (Path(alone) / ifc.name).symlink_to(ifc.resolve())
        found, poses = [], []
        for prior, pose, number in building_places(Path(alone), count, SEED):
            standing = np.isin(prior.building.elements.semantic, (WALL, PILLAR))
            present = ~(standing & (np.cumsum(standing) % EVERY == 0))
            scan, _ = scanned(prior.scene, present, (sensor_named(sensor), pose), (SEED, number))
            path = folder / f"{len(found):03d}.ply"
            head = "ply\nformat binary_little_endian 1.0\n" + f"element vertex {len(scan.points)}\n"
            head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
            path.write_bytes(head.encode() + (scan.points + prior.origin).astype("<f4").tobytes())
            place = (*(pose.position[0] + prior.origin), pose.yaw[0], pose.pitch[0])
            found.append(path)
            poses.append(",".join(f"{float(value):.6f}" for value in place))
    return found, poses


def one_e57(folder: Path, scans: list[Path], poses: list[str]) -> Path:
    """The same scans in one file, each in its sensor's frame with its pose."""
    import pye57

    path = folder / "all.e57"
    path.unlink(missing_ok=True)
    with pye57.E57(str(path), mode="w") as file:
        for scan, words in zip(scans, poses, strict=False):
            x, y, z, yaw, pitch = map(float, words.split(","))
            turn = rotation_of([yaw], [pitch])[0].astype(np.float64)
            points = np.frombuffer(scan.read_bytes().split(b"end_header\n", 1)[1], "<f4").reshape(-1, 3)
            own = (points.astype(np.float64) - (x, y, z)) @ turn
            columns = {f"cartesian{axis}": own[:, number].copy() for number, axis in enumerate("XYZ")}
            quaternion = Rotation.from_matrix(turn).as_quat()[[3, 0, 1, 2]]
            file.write_scan_raw(columns, rotation=quaternion, translation=np.array([x, y, z]))
    return path


def run(tree: Path, words: list[Any], out: Path) -> Usage:
    """Run `jaxmm detect` of a checkout; one that fails ends this benchmark."""
    subprocess.run(["rm", "-rf", str(out)], check=True)
    command = [sys.executable, "-m", "jaxmm", "detect", *map(str, words), "--out", str(out)]
    start, before, peak = time.perf_counter(), os.times(), [0.0]
    process = subprocess.Popen(
        command, cwd=tree, env=os.environ | {"PYTHONPATH": str(tree)}, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    watch = threading.Thread(target=_watch, args=(process, peak), daemon=True)
    watch.start()
    said = process.communicate()[1].decode()
    seconds, after = time.perf_counter() - start, os.times()
    watch.join()
    if process.returncode not in (0, 1):
        raise SystemExit(f"{tree}: {said.strip().splitlines()[-1]}")
    computing = after.children_user + after.children_system - before.children_user - before.children_system
    return Usage(seconds, computing, peak[0])


def _watch(process: subprocess.Popen, peak: list[float]) -> None:
    """Keeps the greatest sum of memory [GB] of a process and of all that came of it."""
    while process.poll() is None:
        peak[0] = max(peak[0], sum(map(_held, _family(process.pid))) / 1e6)
        time.sleep(OFTEN)


def _family(process: int) -> list[int]:
    """A process and all that came of it."""
    try:
        threads = list(Path(f"/proc/{process}/task").iterdir())
        children = [int(child) for one in threads for child in (one / "children").read_text().split()]
    except OSError:
        return [process]
    return [process, *(one for child in children for one in _family(child))]


def _held(process: int) -> int:
    """Memory of a process [kB]: its own pages, and its share of those that others have, too."""
    try:
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0)


if __name__ == "__main__":
    sys.exit(main())
