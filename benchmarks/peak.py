"""One job in a process of its own: it tells its peak of memory [kB], time, computing in all threads [s], and points.

    python -m benchmarks.peak read scan.ply
    python -m benchmarks.peak detect room.ifc scan.ply --pose 1,2,1.3,0 --out found
    python -m benchmarks.peak --smoke        reads a cloud of a few points

It imports what the command line imports, and nothing else, so the peak is that of `jaxmm` itself. getrusage would begin
with what the process held that started this one.
"""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory


def main() -> int:
    if sys.argv[1:] == ["--smoke"]:
        return smoke()
    start = time.perf_counter()
    job, *arguments = sys.argv[1:]
    code, count = {"read": read, "detect": detect}[job](arguments)
    status = Path("/proc/self/status").read_text()
    peak = status.partition("VmHWM:")[2].split()[0]
    print(peak, time.perf_counter() - start, time.process_time(), count)
    return code


def smoke() -> int:
    """The same with a file of its own."""
    with TemporaryDirectory() as folder:
        scan = Path(folder) / "scan.xyz"
        scan.write_text("".join(f"{x} {y} 0.0\n" for x in range(10) for y in range(10)), encoding="ascii")
        sys.argv[1:] = ["read", str(scan)]
        return main()


def read(arguments: list[str]) -> tuple[int, int]:
    """Exit code and points of the scans in a file."""
    from jaxmm.formats.readers import read_scans

    return 0, sum(len(scan.points) for scan in read_scans(Path(arguments[0])))


def detect(arguments: list[str]) -> tuple[int, int]:
    """Exit code of the command, and the points that its report counts."""
    from jaxmm.commands import cli
    from jaxmm.files import load_json

    code = cli.main(["detect", *arguments])
    out = Path(arguments[arguments.index("--out") + 1])
    return code, 0 if code else sum(scan["points"] for scan in load_json(out / "report.json")["scans"])


if __name__ == "__main__":
    sys.exit(main())
