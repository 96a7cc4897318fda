"""How the cost of scanning grows: rays per second against primitives and rooms, and memory against rooms.

    python -m benchmarks.growth [--json FILE] [--figure FILE] [--most-pairs N]    three minutes; 12 for 100,000 pairs
    python -m benchmarks.growth --commands points elements stations workers       ten minutes: whole commands instead

Casting is on the 320 x 200 grid of a pinhole camera, as an image (the fast path) and as rays of any direction (the
general kernel, which is the peer here). Rooms in a launch repeat 64 drawn ones. Memory is the peak of a process of its
own that casts so many rooms, over that of one that casts a single room; what it holds is the input table and the
answer. A run is `jaxmm generate` of so many pairs (64 x 40 rays, to be done in time) by two workers: peaks of the
writer and of the largest worker.

With --commands, what `jaxmm detect` takes against points, elements and stations, and `jaxmm generate` against workers:
`benchmarks/views/command_growth.py` tells how, and with which exponent.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.command_line import CommandLine
from benchmarks.rays import rays_of, rooms_and_poses
from benchmarks.timing import Timing, measure_in_turns, write_report
from benchmarks.views import command_growth
from jaxmm.config import Config, Table
from jaxmm.data.generation import Request, generate
from jaxmm.reports.figures import BLUE, GREY, VERMILLION, save, styled
from warp_scanner.scenes.scenes import BOX, CYLINDER, TABLE, WALL, Primitives, join, take
from warp_scanner.sensors.pinhole import cast_image
from warp_scanner.sensors.poses import Pose
from warp_scanner.sensors.scan import cast_rays
from warp_scanner.sensors.sensors import OAK_D_PRO_SMALL

# Primitives in a room, rooms in a launch, those drawn for it, those in a launch whose memory is told, pairs in a run.
FULL = {
    "primitives": (10, 30, 100, 300, 1000), "rooms": (1, 4, 16, 64, 256, 1024, 4096), "drawn": 64,
    "held": (16, 64, 256, 1024, 4096), "runs": (100, 1_000, 10_000, 100_000), "most_pairs": 1_000, "repeat": 5,
    "points": (100_000, 1_000_000, 10_000_000, 50_000_000), "elements": (10, 100, 1_000, 10_000),
    "stations": (1, 2, 4, 8), "workers": (1, 2), "pairs": 2_048,
}  # fmt: skip
SMOKE = {
    "primitives": (10,), "rooms": (1, 4), "drawn": 2, "held": (16,), "runs": (4,), "repeat": 1, "points": (20_000,),
    "elements": (10,), "stations": (1,), "workers": (1,), "pairs": 2,
}  # fmt: skip
MOST_GENERAL_ROOMS = 256  # more takes the general kernel minutes, at the same speed


def crowded_rooms(rooms: int, count: int, seed: int = 0) -> tuple[Primitives, Pose]:
    """Shells of 10 x 10 x 3 m with `count` primitives: six for the shell, the rest turned boxes and cylinders."""
    rng = np.random.default_rng(seed)
    loose = (rooms, count - 6)
    kind = rng.choice([BOX, CYLINDER], loose).astype(np.uint8)
    half_size = rng.uniform(0.05, 0.3, (*loose, 3)).astype(np.float32)
    half_size[kind == CYLINDER, 1] = half_size[kind == CYLINDER, 0]
    center = rng.uniform(-4.7, 4.7, (*loose, 3)).astype(np.float32)
    center[..., 2] = half_size[..., 2] - 1.5
    angle = np.arctan2(center[..., 1], center[..., 0])
    near = np.hypot(center[..., 0], center[..., 1]) < 1.0  # nothing stands at the sensor
    center[near, 0], center[near, 1] = 2.0 * np.cos(angle[near]), 2.0 * np.sin(angle[near])
    element = np.broadcast_to(np.arange(6, count, dtype=np.int32), loose)
    pieces = Primitives(
        kind, center, half_size, rng.uniform(-np.pi, np.pi, loose).astype(np.float32), element,
        np.full(loose, TABLE, np.uint8),
    )  # fmt: skip
    places = np.array(
        [[0, 0, -1.55], [0, 0, 1.55], [-5.05, 0, 0], [5.05, 0, 0], [0, -5.05, 0], [0, 5.05, 0]], np.float32
    )
    sizes = np.array([[5, 5, 0.05]] * 2 + [[0.05, 5, 1.5]] * 2 + [[5, 0.05, 1.5]] * 2, np.float32)
    shell = Primitives(
        np.full((rooms, 6), BOX, np.uint8), np.tile(places, (rooms, 1, 1)), np.tile(sizes, (rooms, 1, 1)),
        np.zeros((rooms, 6), np.float32), np.tile(np.arange(6, dtype=np.int32), (rooms, 1)),
        np.full((rooms, 6), WALL, np.uint8),
    )  # fmt: skip
    yaw = rng.uniform(-180, 180, rooms).astype(np.float32)
    pose = Pose(np.zeros((rooms, 3), np.float32), yaw, np.zeros(rooms, np.float32))
    return join(shell, pieces), pose


def repeated(primitives: Primitives, pose: Pose, count: int) -> tuple[Primitives, Pose]:
    """So many rooms, the given ones over and over."""
    rows = np.arange(count) % len(primitives.kind)
    return take(primitives, rows), Pose(*(field[rows] for field in pose))


def speeds(scene: tuple[Primitives, Pose], repeat: int) -> tuple[float, float | None]:
    """Rays per second [1e6] of the fast path and, for launches that it can finish soon, of the general kernel."""
    primitives, pose = scene
    sensor = OAK_D_PRO_SMALL
    contestants = [lambda: cast_image(primitives, None, sensor, pose)]
    if len(primitives.kind) <= MOST_GENERAL_ROOMS:
        contestants.append(lambda: cast_rays(primitives, None, rays_of(sensor, pose)))

    def speed(timing: Timing) -> float:
        return round(len(primitives.kind) * sensor.width * sensor.height / timing.median / 1e6, 2)

    found = [speed(timing) for timing in measure_in_turns(contestants, repeat)]
    return found[0], found[1] if len(found) > 1 else None


def peak_memory(rooms: int) -> float:
    """Peak memory [MB] of a process that casts so many rooms."""
    command = [sys.executable, "-m", "benchmarks.growth", "--cast", str(rooms)]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout) / 1024


def own_peak() -> int:
    """Peak memory of this process [kB], which getrusage mixes up with that of the process that started it."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0])


def cast_and_tell(rooms: int) -> None:
    """Cast so many rooms and print the peak memory of this process [kB]."""
    cast_image(*_arguments(*repeated(*crowded_rooms(64, 150), rooms)))
    print(own_peak())


def run_memory(pairs: int) -> tuple[float, float]:
    """Peak memory [MB] of the writer and of the largest worker of a run that generates so many pairs."""
    command = [sys.executable, "-m", "benchmarks.growth", "--generate", str(pairs)]
    found = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout.split()
    return int(found[-2]) / 1024, int(found[-1]) / 1024


def generate_and_tell(pairs: int) -> None:
    """Generate so many pairs and print the peak memory [kB] of this process and of the largest worker."""
    config = Config(scan=Table.of({"preset": "varied", "width": 64, "height": 40}))
    with tempfile.TemporaryDirectory() as folder:
        generate(config, Path(folder) / "shards", Request(pairs, workers=2))
    print(own_peak(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)


def _arguments(primitives: Primitives, pose: Pose) -> tuple:
    return primitives, None, OAK_D_PRO_SMALL, pose


@styled
def draw(found: dict[str, list[dict]]) -> Figure:
    """Four panels: speed against primitives, speed against rooms, memory of a launch, memory of a run."""
    figure = Figure((10.0, 7.6), layout="constrained")
    panels = figure.subplots(2, 2).ravel()
    for axes, name in zip(panels[:2], ("primitives", "rooms"), strict=True):
        rows = found[name]
        for field, title, color, marker in (("ours", "image", BLUE, "o"), ("peer", "any rays", VERMILLION, "s")):
            there = [row for row in rows if row[field] is not None]
            x, y = [row[name] for row in there], [row[field] for row in there]
            axes.plot(x, y, marker=marker, color=color, label=title)
        label = {"primitives": "primitives in a room", "rooms": "rooms in a launch"}[name]
        axes.set(xscale="log", yscale="log", xlabel=label, ylabel="million rays per second")
    panels[0].legend()
    rows = found["memory"]
    panels[2].plot(
        [row["rooms"] for row in rows], [row["ours"] for row in rows], marker="o", color=BLUE, label="measured"
    )
    answer = [row["peer"] for row in rows]
    panels[2].plot([row["rooms"] for row in rows], answer, linestyle="--", color=GREY, label="scans and table alone")
    panels[2].set(xscale="log", yscale="log", xlabel="rooms in a launch", ylabel="memory above one room [MB]")
    panels[2].legend()
    rows = found["runs"]
    for field, title, color, marker in (
        ("ours", "largest worker", BLUE, "o"),
        ("writer", "writer", VERMILLION, "s"),
    ):
        panels[3].plot(
            [row["pairs"] for row in rows], [row[field] for row in rows], marker=marker, color=color, label=title
        )
    panels[3].set(xscale="log", xlabel="pairs in a run of generate", ylabel="peak memory [MB]")
    panels[3].set_ylim(bottom=0)
    panels[3].legend()
    figure.suptitle("How the cost of scanning grows, on two cores; casts of 320 x 200 rays a room")
    return figure


def measure(sizes: argparse.Namespace) -> dict[str, list[dict]]:
    """Rows of the four panels."""
    rows: dict[str, list[dict]] = {"primitives": [], "rooms": [], "memory": [], "runs": []}

    def add(kind: str, case: str, values: tuple, unit: str, **more: int) -> None:
        ours, peer = values
        peer_name = {"memory": "what must be held", "runs": "the smallest run"}.get(kind, "general kernel")
        ratio = None if not peer else round((peer / ours) if unit == "MB" else (ours / peer), 2)
        rows[kind].append(
            {"case": case, "ours": ours, "peer": peer, "peer_name": peer_name, "unit": unit, "ratio": ratio, **more}
        )
        print(f"{case:32} ours {ours:9.2f}  {peer_name} {'-' if peer is None else f'{peer:9.2f}'} {unit}")

    for count in sizes.primitives:
        found = speeds(crowded_rooms(32, count), sizes.repeat)
        add("primitives", f"{count} primitives, 32 rooms", found, "Mrays/s", primitives=count)
    drawn = rooms_and_poses(sizes.drawn)
    for count in sizes.rooms:
        found = speeds(repeated(*drawn, count), sizes.repeat)
        add("rooms", f"{count} rooms of about 150", found, "Mrays/s", rooms=count)
    least = peak_memory(1)
    pixels = OAK_D_PRO_SMALL.width * OAK_D_PRO_SMALL.height
    for count in sizes.held:
        held = count * (pixels * 9 + 150 * 34) / 2**20
        more = max(peak_memory(count) - least, 0.1)  # the first room's own allocations hide those of a few more
        add("memory", f"memory of {count} rooms", (round(more, 1), round(held, 1)), "MB", rooms=count)
    smallest = None
    for count in (count for count in sizes.runs if count <= sizes.most_pairs):
        writer, worker = (round(size, 1) for size in run_memory(count))
        smallest = smallest or worker
        add("runs", f"largest worker, {count} pairs", (worker, smallest), "MB", pairs=count, writer=writer)
    return rows


def measure_commands(options: argparse.Namespace) -> list[command_growth.Curve]:
    """The curves of the commands that are asked for, printed as they come."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        sizes = {name: getattr(options, name) for name in options.commands}
        for curve in command_growth.curves(options.commands, sizes, options.pairs, Path(folder)):
            found.append(curve)
            for row in curve.rows():
                print(
                    f"{row['case']:32} {row['ours']:9.2f} {row['unit']}, {row['seconds']:8.2f} s, {row['peak_mb']} MB"
                )
            every, last = curve.exponents
            print(f"{curve.name}: exponent {every:.2f}, between the two largest {last:.2f}", flush=True)
    return found


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    names = tuple(command_growth.CURVES)
    parser.add_argument("--commands", nargs="+", choices=names, help="of whole commands instead, these curves")
    for name in names:
        parser.add_argument(f"--{name}", type=int, nargs="+", metavar="N", help=f"sizes of the curve {name}")
    parser.add_argument("--figure", type=Path, help="also draw them (.png, .pdf or .svg)")
    parser.add_argument("--repeat", type=int, help="casts after the first, of which the median is taken")
    parser.add_argument("--most-pairs", type=int, help="in the longest run; 100000 takes ten minutes")
    parser.add_argument("--cast", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--generate", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.cast:
        cast_and_tell(options.cast)
        return 0
    if options.generate:
        generate_and_tell(options.generate)
        return 0
    if options.commands:
        drawn = measure_commands(options)
        if options.json:
            write_report(options.json, [row for one in drawn for row in one.rows()], "warp-lang", "numpy")
        if options.figure:
            save(command_growth.draw(drawn), options.figure)
        return 0
    found = measure(options)
    if options.json:
        write_report(options.json, [row for rows in found.values() for row in rows], "warp-lang", "numpy")
    if options.figure:
        save(draw(found), options.figure)
    return 0


if __name__ == "__main__":
    sys.exit(main())
