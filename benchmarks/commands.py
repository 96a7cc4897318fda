"""How long commands take beside another build of jaxmm, in turns: wall clock, computing in all processes, and memory.

    python -m benchmarks.commands --against v1.2.0 [--cases camera scanner ...] [--repeat 5] [--json FILE]
    python -m benchmarks.commands --against ../other --most 1.15        exit code 1 where a case takes more than that

The other build is a checkout, or a revision of this one, which is then checked out for the time being. Each build runs
by this Python with caches of its own, filled by a first round that is not counted, but for the cases that say so. A
generated room with a new pillar is the model; where JAXMM_DATA holds building files, one of them is, too. A case's
ratio is the time of this build over that of the other: below 1 is faster. On a machine that others use, computing
(user and system time) tells more than the clock, so --most fails only where both are above it.
"""

import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from argparse import Namespace
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.command_line import CommandLine, end_without
from benchmarks.timing import machine, write_report
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.rooms.pairs import PairConfig
from warp_scanner.rooms.scenarios import make_scenes
from warp_scanner.scenes.scenes import GAP

BUILDING = ("Schependomlaan_V_L_Constructief.ifc", "5.968,9.467,4,-170.9")  # of JAXMM_DATA/ifc, and a place in it
CASES = ("import", "help", "camera", "camera again", "scanner", "warm", "building", "building again", "first of all")
CHEAPEST = CASES[:6]
FULL = {"cases": CASES, "repeat": 5, "camera": "oak-d-pro-small", "large": "oak-d-pro", "scanner": "ouster-64"}
SMOKE = {"cases": ("import", "camera again"), "repeat": 1}
SEED, ROOM = 2, 0
ROOT = Path(__file__).resolve().parents[1]
NOTHING_KEPT = {"JAXMM_KEEP_MODELS": "0"}
WARM = """
import sys, time
from jaxmm import detect, parse_pose
for line in sys.stdin:
    wall, busy = time.perf_counter(), time.process_time()
    detect(*sys.argv[1:3], parse_pose(sys.argv[3]))
    print(time.perf_counter() - wall, time.process_time() - busy, flush=True)
"""


class Usage(NamedTuple):
    """What a process took."""

    seconds: float  # by the clock
    computing: float  # [s] user and system time, of it and of the processes that it waited for
    peak: float  # [MB] of resident memory, of it alone


class Build:
    """One checkout, run by this Python, with caches of its own."""

    def __init__(self, tree: Path, work: Path):
        self.tree, self.work = tree, work
        work.mkdir()

    def environment(self, caches: str) -> dict[str, str]:
        """With all caches in one folder of the work."""
        place = self.work / caches
        own = {"JAXMM_CACHE": place, "WARP_CACHE_PATH": place / "warp", "JAX_COMPILATION_CACHE_DIR": place / "jax"}
        # Users' Python keeps what it compiled: without, half a second of every command would be that.
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
        return kept | {"PYTHONPATH": str(self.tree)} | {name: str(path) for name, path in own.items()}

    def run(self, words: list[str], caches: str = "caches", **more: str) -> Usage:
        """Run Python with some words; a run that fails ends this benchmark."""
        return measured([sys.executable, *words], self.environment(caches) | more, self.work)


def measured(command: list[str], environment: dict[str, str], folder: Path | None = None) -> Usage:
    """Run a command to its end.

    Its peak is read while it runs, for what the system tells at the end begins with the memory of who started it.

    Raises:
        SystemExit: it failed, in its own words.
    """
    with tempfile.TemporaryFile() as said:
        start, peak = time.perf_counter(), 0.0
        process = subprocess.Popen(command, env=environment, cwd=folder, stdout=said, stderr=subprocess.STDOUT)
        status = Path(f"/proc/{process.pid}/status")
        while True:
            ended, code, usage = os.wait4(process.pid, os.WNOHANG)
            if ended:
                break
            peak = max(peak, _peak(status))
            time.sleep(0.002)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(code)
        if process.returncode:
            said.seek(0)
            raise SystemExit(f"{' '.join(command)}: {said.read().decode(errors='replace').strip()[-500:]}")
    return Usage(seconds, usage.ru_utime + usage.ru_stime, peak)


def _peak(status: Path) -> float:
    """[MB]; 0 where the system does not tell."""
    try:
        return int(status.read_text().partition("VmHWM:")[2].split()[0]) / 1000.0
    except (OSError, IndexError):
        return 0.0


class WarmProcess:
    """A process that has loaded everything and detects once for every line that it gets."""

    def __init__(self, build: Build, words: list[str]):
        self._process = subprocess.Popen(
            [sys.executable, "-c", WARM, *words],
            env=build.environment("caches"), cwd=build.work, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def once(self) -> Usage:
        """One detection."""
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        seconds, computing = map(float, self._process.stdout.readline().split())
        return Usage(seconds, computing, _peak(Path(f"/proc/{self._process.pid}/status")))

    def close(self) -> None:
        """End it."""
        self._process.communicate()


class Scene(NamedTuple):
    """A model and what is scanned of it; `pose` as the command line takes it."""

    model: Path
    pose: str
    scans: dict[str, Path]  # by sensor

    def words(self, sensor: str, out: str) -> list[str]:
        """Of a detection, for Python."""
        where = [f"--pose={self.pose}", "--sensor", sensor, "--out", out]
        return ["-m", "jaxmm", "detect", str(self.model), str(self.scans[sensor]), *where]


def room_scene(folder: Path, sensors: set[str]) -> Scene:
    """A furnished room without, and scanned with, a pillar."""
    scenes = make_scenes(PairConfig(scenario="pillar_added", condition="occluded").scene, SEED, np.array([ROOM]))
    for name, there in (("model", scenes.in_prior), ("now", scenes.in_real)):
        write_room(
            folder / f"{name}.ifc", scenes.primitives._replace(kind=np.where(there, scenes.primitives.kind, GAP)), 0
        )
    pose = ",".join(f"{value:.6f}" for value in (*scenes.pose.position[0], scenes.pose.yaw[0]))
    return Scene(folder / "model.ifc", pose, scans_of(folder / "now.ifc", pose, sensors, folder))


def scans_of(scene: Path, pose: str, sensors: set[str], folder: Path) -> dict[str, Path]:
    """Scans by `jaxmm scan`, a PLY file a sensor."""
    scans = {sensor: folder / f"{scene.stem}_{sensor}.ply" for sensor in sorted(sensors)}
    for sensor, path in scans.items():
        words = ["-m", "jaxmm", "scan", str(scene), f"--pose={pose}", "--sensor", sensor, "--out", str(path)]
        measured([sys.executable, *words], os.environ | {"PYTHONPATH": str(ROOT)})
    return scans


def job_of(case: str, build: Build, asked: Namespace, stack: ExitStack) -> Callable[[], Usage]:
    """What a case does with a build, once."""
    if case == "import":
        return lambda: build.run(["-c", "import jaxmm"])
    if case == "help":
        return lambda: build.run(["-m", "jaxmm", "--help"])
    room, building = asked.room, asked.building
    if case == "warm":
        process = WarmProcess(build, [str(room.model), str(room.scans[asked.large]), room.pose])
        stack.callback(process.close)
        return process.once
    of_building = case.startswith("building") or (case == "first of all" and building is not None)
    sensor = "tls-real" if of_building else asked.scanner if case == "scanner" else asked.camera
    words = (building if of_building else room).words(sensor, "found")

    def detected() -> Usage:
        shutil.rmtree(build.work / "found", ignore_errors=True)
        if case == "first of all":
            shutil.rmtree(build.work / "empty", ignore_errors=True)
            return build.run(words, "empty")
        return build.run(words, **({} if case.endswith("again") or case == "scanner" else NOTHING_KEPT))

    return detected


def row_of(case: str, builds: tuple[Build, Build], asked: Namespace) -> dict[str, Any]:
    """A case with both builds, in turns, after a round that is not counted."""
    with ExitStack() as stack:
        jobs = [job_of(case, build, asked, stack) for build in builds]
        for job in jobs if case != "first of all" else ():
            job()
        rounds = [[job() for job in jobs] for _ in range(asked.repeat)]
    ours, other = (
        Usage(*(statistics.median(values) for values in zip(*runs, strict=True))) for runs in zip(*rounds, strict=True)
    )
    times = ours.seconds / other.seconds, ours.computing / other.computing
    return {
        "case": case, "ours": round(ours.seconds, 3), "peer": round(other.seconds, 3), "peer_name": "other build",
        "unit": "s", "ratio": round(other.seconds / ours.seconds, 3),
        "times": round(times[0], 3), "times_computing": round(times[1], 3),
        "ours_computing": round(ours.computing, 3), "peer_computing": round(other.computing, 3),
        "ours_peak_mb": round(ours.peak), "peer_peak_mb": round(other.peak),
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """All cases, as Markdown."""
    lines = [
        "| case | other [s] | this [s] | times | computing: other [s] | this [s] | times "
        "| peak: other [MB] | this [MB] |",
        "| --- |" + " --- |" * 8,
    ]
    for row in rows:
        cells = [row[name] for name in ("peer", "ours", "times", "peer_computing", "ours_computing", "times_computing")]
        cells = [f"{cell:.2f}" for cell in cells] + [str(row["peer_peak_mb"]), str(row["ours_peak_mb"])]
        lines.append(f"| {row['case']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def checkout(revision: str, folder: Path) -> Path:
    """A folder as it is, or a revision of this repository, checked out below `folder`."""
    if (Path(revision) / "jaxmm" / "__main__.py").is_file():
        return Path(revision).resolve()
    tree = folder / "tree"
    tree.mkdir()
    packed = subprocess.run(
        ["git", "-C", str(ROOT), "archive", revision, "--output", f"{tree}.tar"], capture_output=True
    )
    if packed.returncode:
        end_without(f"--against {revision}: expected a checkout of jaxmm or a revision of this one, found neither")
    shutil.unpack_archive(f"{tree}.tar", tree, filter="data")
    return tree


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    parser.add_argument(
        "--against", default=str(ROOT), metavar="DIR|REVISION", help="the other build, default this one"
    )
    parser.add_argument("--cases", nargs="+", choices=CASES, metavar="CASE", help=f"some of: {', '.join(CASES)}")
    parser.add_argument("--cheapest", action="store_true", help=f"only {', '.join(CHEAPEST)}")
    parser.add_argument("--repeat", type=int, metavar="N", help="rounds, at least 1")
    parser.add_argument("--most", type=float, metavar="TIMES", help="that a case may take of the other build's time")
    asked = parser.parse_args()
    if asked.repeat < 1:
        parser.error(f"--repeat: expected at least 1, got {asked.repeat}")
    asked.cases = CHEAPEST if asked.cheapest else asked.cases
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        builds = tuple(
            Build(tree, folder / name) for name, tree in (("this", ROOT), ("other", checkout(asked.against, folder)))
        )
        sensors = {"warm": asked.large, "scanner": asked.scanner}
        asked.room = room_scene(folder, {asked.camera} | {sensors[case] for case in asked.cases if case in sensors})
        asked.building = (
            building_scene(folder) if {"building", "building again", "first of all"} & {*asked.cases} else None
        )
        rows = []
        for case in asked.cases:
            if case.startswith("building") and asked.building is None:
                print(f"{case} is left out: JAXMM_DATA holds no ifc/{BUILDING[0]}", file=sys.stderr)
                continue
            rows.append(row_of(case, builds, asked))
            print(table(rows[-1:]).splitlines()[-1], file=sys.stderr, flush=True)
    print(f"{machine()['processor']}, {machine()['cores']} cores\n\n{table(rows)}")
    if asked.json:
        write_report(asked.json, rows, "numpy", "scipy", "warp-lang", "ifcopenshell", "matplotlib")
    slow = [row["case"] for row in rows if asked.most and min(row["times"], row["times_computing"]) > asked.most]
    if slow:
        print(f"slower than {asked.most:g} times the other build: {', '.join(slow)}", file=sys.stderr)
    return int(bool(slow))


def building_scene(folder: Path) -> Scene | None:
    """A building of several storeys, scanned by a terrestrial scanner that errs; None without its file."""
    name, pose = BUILDING
    model = Path(os.environ.get("JAXMM_DATA") or "../shared/data").resolve() / "ifc" / name
    return Scene(model, pose, scans_of(model, pose, {"tls-real"}, folder)) if model.is_file() else None


if __name__ == "__main__":
    sys.exit(main())
