"""Damages valid files in every way at hand and gives them to the readers: `python -m tests.fuzz --count 10000`.

A case is a reader and a number, and the same two give the same bytes. A reader passes a case when it accepts the file
or refuses it with one line (ValueError) that names it; within SECONDS, within MEMORY, without a word on standard output
or error. Cases run in processes that a crash, a hang or a lack of memory ends, and the next one goes on behind it.
"""

import argparse
import concurrent.futures
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.cases.damage import damaged
from tests.cases.valid_beside import FOLDERS, POSES
from tests.cases.valid_files import MODELS, PRIORS, SCANS, ValidFile
from tests.cases.valid_inside import INSIDE
from warp_scanner.cores import core_count

ROOT = Path(__file__).resolve().parents[1]
MEMORY_DISK = "/dev/shm"  # to write files over and over again takes a disk longer than to read them
SECONDS = 20  # of computing, after which a reader hangs
MEMORY = 1 << 30  # bytes of address space beyond what a process has when all is imported
SWELLING = 256 << 20  # bytes of memory in use, by which a file of kilobytes must not raise the process
Case = tuple[str, int]  # reader and number
VALID = SCANS | INSIDE | FOLDERS | POSES | PRIORS | MODELS
GUARDED = ("ifc2x3", "ifc4", "ifczip")  # in a process of their own, which takes half a second to start: here without


def reader_of(name: str, guarded: bool) -> Callable[[Path], None]:
    """Reads a file and checks that what is accepted is as promised."""
    if name in SCANS or name in INSIDE or name in FOLDERS:
        from jaxmm.formats.readers import read_scans

        def read(path: Path) -> None:
            for scan in read_scans(path):
                assert scan.points.dtype == np.float64 and scan.points.shape[1:] == (3,) and len(scan.points)
                assert np.isfinite(scan.points).all(), "points that are not finite"

    elif name in POSES:
        from jaxmm.formats.poses import GivenPose, read_poses

        def read(path: Path) -> None:
            for pose in read_poses([str(path)]):
                if isinstance(pose, GivenPose):
                    assert np.isfinite([*pose.position, pose.yaw, pose.pitch, pose.roll]).all(), "not finite"
                    assert np.allclose(pose.rotation @ pose.rotation.T, np.eye(3)), "no rotation"

    elif name in MODELS:
        from jaxmm.learning.model_files import load_models

        def read(path: Path) -> None:
            load_models(path)

    else:
        from warp_scanner.buildings.files import read_building
        from warp_scanner.buildings.ifc_files import parse_ifc
        from warp_scanner.buildings.ifc_zips import plain_file
        from warp_scanner.scenes.building import AS_IT_IS

        def read(path: Path) -> None:
            if name not in GUARDED or guarded:
                building = read_building(path)
            else:
                with plain_file(path) as plain:
                    building = parse_ifc(plain, AS_IT_IS)
            assert np.isfinite(building.triangles.vertices).all() and len(building.triangles.faces)

    return read


def _flaw(read: Callable[[Path], None], path: Path, said: int) -> str:
    """What is wrong with how a reader took a file; empty when nothing is."""
    before = _peak()
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.setitimer(signal.ITIMER_REAL, 10 * SECONDS)  # for one that sleeps; a busy machine is slow
    flaw = ""
    try:
        read(path)
    except ValueError as error:
        text = str(error)
        if str(path) not in text or "\n" in text or len(text) > 900:
            flaw = f"expected one line that names the file, got {type(error).__name__}: {text[:300]!r}"
    except BaseException as error:
        flaw = f"{type(error).__name__}: {str(error)[:300]!r}"
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.setitimer(signal.ITIMER_REAL, 0)
    if _peak() - before > SWELLING:
        flaw += f" took {(_peak() - before) / 1e6:.0f} MB"
    sys.stdout.flush()
    sys.stderr.flush()
    if words := os.pread(said, 300, 0):
        flaw += f" said {words!r}"
        os.ftruncate(said, 0)
        os.lseek(said, 0, os.SEEK_SET)
    return flaw.strip()


def _peak() -> int:
    """Most bytes of memory that this process has used so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def work(cases: list[Case], guarded: bool) -> None:
    """Run cases in this process; a line `place` before each, `place flaw` after a failed one."""
    out = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what is said on the way is no report
    fast = MEMORY_DISK if Path(MEMORY_DISK).is_dir() else None
    with tempfile.TemporaryDirectory(dir=fast) as folder, tempfile.TemporaryFile(dir=fast) as said:
        valid, readers = {}, {}
        for name in dict.fromkeys(name for name, _ in cases):
            valid[name], readers[name] = VALID[name](), reader_of(name, guarded)
            # What is valid must be read, and all is imported before the limit.
            readers[name](_written(Path(folder) / name, valid[name], valid[name].data))
        for stream in (1, 2):
            os.dup2(said.fileno(), stream)
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for place, (name, number) in enumerate(cases):
            out.write(f"{place}\n")
            path = _written(Path(folder) / name, valid[name], damaged(name, valid[name], number))
            if flaw := _flaw(readers[name], path, said.fileno()):
                out.write(f"{place} {flaw}\n")


def _written(folder: Path, valid: ValidFile, data: bytes) -> Path:
    """What to give to the reader: a file of that data, or a folder in which it is one."""
    for place, beside in valid.beside.items():
        if not (folder / place).exists():  # no reader changes what it reads
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            (folder / place).write_bytes(beside)
    path = folder / (valid.place or f"file{valid.ending}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return folder if valid.place else path


def run(names: list[str], first: int, last: int) -> list[tuple[Case, str]]:
    """The failed ones among the cases first..last-1 of each reader, with what went wrong."""
    cases, failures = [(name, number) for name in names for number in range(first, last)], []
    while cases:
        found, begun, end = _process(cases, guarded=False)
        failures += found
        if not end:
            break
        case = cases[begun]
        if case[0] in GUARDED:  # the library may fall over in a process of its own, which the reader gives it
            found, _, end = _process([case], guarded=True)
            failures += found
        if end:
            failures.append((case, end))
        cases = cases[begun + 1 :]
    return failures


def _process(cases: list[Case], guarded: bool) -> tuple[list[tuple[Case, str]], int, str]:
    """What `work` reports in a process of its own: failures, place of the last case begun, and how it was ended."""
    failures, begun = [], None
    with tempfile.NamedTemporaryFile("w", suffix=".json") as told:
        json.dump(cases, told)
        told.flush()
        command = [sys.executable, "-m", "tests.fuzz", "--work", told.name, *(["--guarded"] if guarded else [])]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT) as process:
            for line in process.stdout:
                word, _, flaw = line.rstrip("\n").partition(" ")
                begun = int(word)
                if flaw:
                    failures.append((cases[begun], flaw))
            error = process.stderr.read()
    if begun is None:
        raise RuntimeError(f"{cases[0][0]}: no case was begun: {error}")
    if process.returncode in (-signal.SIGALRM, -signal.SIGPROF):
        return failures, begun, f"not done after {SECONDS} s"
    return failures, begun, f"ended by {process.returncode} {error[-300:]}" if process.returncode else ""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000, help="cases of each reader (default 10000)")
    parser.add_argument("--first", type=int, default=0, help="number of the first case (default 0)")
    parser.add_argument("--reader", action="append", choices=VALID, help="only this one; may be repeated")
    parser.add_argument("--keep", type=Path, help="folder to write the damaged files to, instead of reading them")
    parser.add_argument("--work", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--guarded", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.work:
        work([tuple(case) for case in json.loads(options.work.read_text())], options.guarded)
        return 0
    names, last = options.reader or list(VALID), options.first + options.count
    if options.keep:
        for name in names:
            valid = VALID[name]()
            for number in range(options.first, last):
                (options.keep / f"{name}-{number}{valid.ending}").write_bytes(damaged(name, valid, number))
        return 0
    failed = 0
    with concurrent.futures.ThreadPoolExecutor(core_count()) as pool:
        for name, failures in zip(names, pool.map(lambda name: run([name], options.first, last), names), strict=True):
            failed += len(failures)
            print(f"{name}: {options.count} cases, {len(failures)} failed", flush=True)
            for (_, number), flaw in failures[:20]:
                print(f"  python -m tests.fuzz --reader {name} --first {number} --count 1\n    {flaw}", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
