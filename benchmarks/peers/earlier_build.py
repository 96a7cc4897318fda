"""Another build of ours, asked where it lays scans: a program of its own that runs by the code of its checkout.

In it nothing of `benchmarks` is imported: that of the other checkout would be found.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from jaxmm.inputs import InputError
from jaxmm.rays.scan_rays import PosedScan
from jaxmm.verdicts.named_scans import NamedScan, placed_scan, settled_scan
from jaxmm.verdicts.priors import read_prior
from jaxmm.verdicts.settings import DetectSettings
from warp_scanner.sensors.sensors import sensor_named


class EarlierBuild:
    """The build in a checkout; it reads each model anew, but for one that it has just had."""

    def __init__(self, tree: Path):
        self._folder = TemporaryDirectory(prefix="earlier_")
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=tree,
            env=os.environ | {"PYTHONPATH": str(tree.resolve())},
        )  # fmt: skip

    def placed(self, model: Path, origin: np.ndarray, scan: PosedScan, sensor: str) -> dict[str, Any]:
        """Where it lays a scan: `position` and `rotation`, `doubts` and `open`; empty where it refuses.

        Args:
            model: the prior's file.
            origin: (3,) [m] that positions count from.
            scan: as believed.
            sensor: its name.
        """
        path = Path(self._folder.name) / "scan.npz"
        np.savez(path, points=scan.points, position=scan.position + origin, rotation=scan.rotation, origin=origin)
        asked = {"model": str(model.resolve()), "scan": str(path), "sensor": sensor}
        self._process.stdin.write(json.dumps(asked | {"made": model.stat().st_mtime_ns}) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError("the other build ended without an answer")
        return json.loads(answer)

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait()
        self._folder.cleanup()


def _answer(prior: Any, asked: dict[str, Any]) -> dict[str, Any]:
    with np.load(asked["scan"]) as file:
        given = dict(file)
    points = (given["points"] + (given["origin"] - prior.origin)).astype(np.float32)
    scan = PosedScan(points, given["position"] - prior.origin, given["rotation"], sensor_named(asked["sensor"]))
    try:
        one = settled_scan(NamedScan(scan, "scan", len(points), "given"))
        placed = placed_scan(prior, one, DetectSettings())
    except InputError:
        return {}
    position = placed.scan.position + prior.origin - given["origin"]
    told = {"position": position.tolist(), "rotation": np.asarray(placed.scan.rotation, float).tolist()}
    return told | {"doubts": list(placed.notes), "open": list(placed.open)}


def _serve() -> None:
    answers, sys.stdout = sys.stdout, sys.stderr  # whatever else is said there is no answer
    prior, had = None, None
    for line in sys.stdin:
        asked = json.loads(line)
        if had != (asked["model"], asked["made"]):
            prior, had = read_prior(Path(asked["model"])), (asked["model"], asked["made"])
        print(json.dumps(_answer(prior, asked)), file=answers, flush=True)


if __name__ == "__main__":
    _serve()
