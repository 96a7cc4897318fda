"""What moved, out of a map of many scans: the map's points that rays of other scans pass through.

    python -m benchmarks.dynamic_maps [FOLDER ...] --out runs/dynamic_maps.json [--rooms 6] [--sensor ouster-64-real]

FOLDER is a sequence of DynamicMap_Benchmark (`pcd/*.pcd` in the world frame with the sensor's pose in VIEWPOINT, and
`gt_cloud.pcd`, whose intensity is 0 of static and 1 of dynamic points); without any, rooms are made in which somebody
walks and a box is carried away. Measured as its evaluation does (Zhang et al. 2023, "A Dynamic Points Removal Benchmark
in Point Cloud Maps", ITSC; scripts/py/eval/evaluate_all.py): SA and DA, the shares of the static and of the dynamic
points that are told as such, AA = sqrt(SA DA), and HA = 2 SA DA / (SA + DA), a point being static where the cleaned map
has one within 0.05 m.

Every scan looks at every point of the map that its rays come near to (`jaxmm/rays/cloud_evidence.py`): it passes
through it, ends on it, or does not tell. A point is dynamic where as many scans as SHARE of those that tell pass
through it, and at least LEAST. Prints Markdown.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from benchmarks.command_line import CommandLine, end_without
from benchmarks.views.moving_rooms import FIELDS, MAP, SCANS, write_rooms
from jaxmm.files import write_json
from jaxmm.formats.readers import read_scans
from jaxmm.inputs import InputError, one_line
from jaxmm.rays.cloud_evidence import CloudPair, prior_view
from jaxmm.rays.evidence import SUPPORT, THROUGH
from jaxmm.rays.scan_rays import NEAREST

FULL = {"rooms": 6, "scans": 12, "sensor": "ouster-64-real"}
SMOKE = {"rooms": 1, "scans": 4, "sensor": "velodyne-16-real"}
SEED = 3  # of the test rooms; LEAST and SHARE were chosen on seed 42
LEAST, SHARE = 2, 0.3
SAME = 0.05  # [m] up to which a point of the cleaned map is the point of the map
MOST_REACH = 50.0  # [m] of what a scan tells


class Scores(NamedTuple):
    """Percentages, as that benchmark has them."""

    sa: float
    da: float

    @property
    def aa(self) -> float:
        """Associated accuracy: the geometric mean."""
        return float(np.sqrt(self.sa * self.da))

    @property
    def ha(self) -> float:
        """Harmonic accuracy."""
        return 2.0 * self.sa * self.da / (self.sa + self.da) if self.sa + self.da else 0.0


def main(asked: argparse.Namespace) -> None:
    folders = asked.folders or write_rooms(asked.scratch, asked.rooms, asked.scans, asked.sensor, asked.seed)
    lines, told = ["| map | points | dynamic | scans | SA | DA | AA | HA |", "| --- |" + " --- |" * 7], []
    for folder in folders:
        one = _measured(folder)
        told.append(one)
        cells = " | ".join(f"{one[name]:.2f}" for name in ("SA", "DA", "AA", "HA"))
        lines.append(f"| {one['map']} | {one['points']} | {one['dynamic']} | {one['scans']} | {cells} |")
        print(lines[-1], file=sys.stderr, flush=True)
    write_json(asked.out, {"maps": told, "least": LEAST, "share": SHARE})
    print("\n".join(lines))


def _measured(folder: Path) -> dict[str, Any]:
    points, truth = read_map(folder / MAP)
    passed, ended, count = votes(points, scans_of(folder))
    found = scores(as_evaluated(points, is_dynamic(passed, ended)), truth)
    return {
        "map": folder.name, "points": len(points), "dynamic": int(truth.sum()), "scans": count, "SA": found.sa,
        "DA": found.da, "AA": found.aa, "HA": found.ha,
    }  # fmt: skip


def read_map(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Points (N, 3) float64 [m] of a map, and which (N,) bool are dynamic.

    Raises:
        InputError: it is missing or damaged, or not of points with an intensity of 0 and 1, both of which it has.
    """
    from pypcd4 import PointCloud

    if not path.is_file():
        raise InputError(f"{path}: expected the map with its ground truth, found none")
    try:
        table = PointCloud.from_path(path).numpy(FIELDS).astype(np.float64)
    except Exception as error:  # a damaged file raises almost anything
        raise InputError(f"{path}: expected a PCD file with {', '.join(FIELDS)}: {one_line(error)}") from error
    if not np.isfinite(table[:, :3]).all() or set(np.unique(table[:, 3])) != {0.0, 1.0}:
        raise InputError(f"{path}: expected finite points, and intensities 0 (static) and 1 (dynamic)")
    return table[:, :3], table[:, 3] == 1.0


def scans_of(folder: Path) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Points (n, 3) [m] of every scan in the world frame, and where its sensor (3,) stood.

    Raises:
        InputError: there are none, or one is damaged.
    """
    paths = sorted((folder / SCANS).glob("*.pcd"))
    if not paths:
        raise InputError(f"{folder / SCANS}: expected PCD files, found none")
    for path in paths:
        (scan,) = read_scans(path)
        yield scan.points, np.zeros(3) if scan.position is None else scan.position


def votes(points: np.ndarray, scans: Iterator[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray, int]:
    """How many scans pass through each point (N,) of a map, how many end on it, and how many scans there are."""
    passed, ended, count = np.zeros(len(points), int), np.zeros(len(points), int), 0
    for measured, sensor in scans:
        count += 1
        reach = np.linalg.norm(measured - sensor, axis=1)
        measured = measured[(reach > NEAREST) & (reach < MOST_REACH)]
        near = np.flatnonzero(np.linalg.norm(points - sensor, axis=1) < MOST_REACH)
        if not len(near) or not len(measured):
            continue
        seen = prior_view(CloudPair(points[near], measured, sensor), np.zeros(len(near)))
        through, support = seen.count[:, THROUGH], seen.count[:, SUPPORT]
        passed[near] += through > support
        ended[near] += support >= np.maximum(through, 1)
    return passed, ended, count


def is_dynamic(passed: np.ndarray, ended: np.ndarray, least: int = LEAST, share: float = SHARE) -> np.ndarray:
    """(N,) bool: of points that so many scans pass through, and so many end on."""
    return (passed >= least) & (passed >= share * (passed + ended))


def as_evaluated(points: np.ndarray, dynamic: np.ndarray) -> np.ndarray:
    """(N,) bool: what counts as dynamic, where the cleaned map is what is left: nothing of it within SAME."""
    if dynamic.all():
        return dynamic
    return cKDTree(points[~dynamic]).query(points, distance_upper_bound=2.0 * SAME)[0] > SAME


def scores(found: np.ndarray, truth: np.ndarray) -> Scores:
    """Of points (N,) bool that are told as dynamic, and that are; both kinds are among them."""
    return Scores(100.0 * float(np.mean(~found[~truth])), 100.0 * float(np.mean(found[truth])))


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("folders", type=Path, nargs="*", metavar="FOLDER", help="sequences; none: rooms are made")
    parser.add_out("FILE.json")
    parser.add_argument("--rooms", type=int, metavar="N", help="to make where there is no FOLDER")
    parser.add_argument("--scans", type=int, metavar="N", help="of each of these")
    parser.add_argument("--sensor", metavar="NAME", help="of these")
    parser.add_argument("--seed", type=int, default=SEED, metavar="N", help="of these")
    asked = parser.parse_args()
    asked.scratch = parser.scratch
    try:
        main(asked)
    except InputError as error:
        end_without(str(error))
