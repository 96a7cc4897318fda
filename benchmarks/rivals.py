"""Which elements of a prior are gone: `detect` beside what people use today, on the same rooms.

    python -m benchmarks.rivals --out runs/rivals.json [--rooms 100]

Rivals, each told from where the scan was taken, and given the points of every element that are in view there:

- *cloud to mesh*: the median distance of an element's points to the scan (what CloudCompare's C2C and C2M compute);
- *coverage*: the share of an element's points with a point of the scan within 0.1 m (Bosche 2010), less than which it
  counts as gone;
- *M3C2* (Lague et al. 2013, by py4dgeo): the median distance along the normal, cylinders of 0.2 m; no point in a
  cylinder counts as the farthest.

The threshold of these is chosen for the best F1 on validation rooms, which is more than their user can do. Tools for
construction sites call an element installed by limits that are set beforehand, and `detect` keeps its own, too:

- *installed by coverage*: at least half of its points have the scan within 0.05 m, which is to say that their median
  distance is within it.

Scored are elements that reality shows to be there or gone, in rooms with one removed wall or pillar, and
beside them how many of those that nobody can see it calls removed. Needs py4dgeo (make setup-peers).
"""

import logging
from argparse import Namespace
from typing import Any

import numpy as np
from sklearn.metrics import roc_auc_score

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.detections import elements_of
from jaxmm.files import write_json
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.learning.preprocess import nearest_distance
from jaxmm.rays.pools import normals_of
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.runs.room_scans import RoomCase, room_cases
from jaxmm.verdicts.building_evidence import sight
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import OCCLUDED, PRESENT, REMOVED, UNSCANNED
from jaxmm.weights import DEFAULT

VALIDATION_SEED, TEST_SEED = 2, 3
COVERED = 0.1  # [m]
CYLINDER, DEPTH = 0.2, 1.0  # [m] radius and half length of M3C2's cylinders
FARTHEST = 2.0  # [m] distance of what has no counterpart
RIVALS = ("cloud to mesh", "coverage", "M3C2")
INSTALLED, TOLERANCE = "installed by coverage", 0.05  # [m]
# Rooms of each removed object, and of validation at least.
FULL = {"rooms": 100, "least": 20, "conditions": ("clean", "occluded")}
SMOKE = {"rooms": 1, "least": 1, "conditions": ("occluded",)}
SCENES = ("wall_removed", "pillar_removed")


def main(asked: Namespace) -> None:
    judges = read_judges(DEFAULT)
    rivals = [name for name in RIVALS if name != "M3C2" or peers.has("py4dgeo")]
    lines = ["| condition | method | elements | precision | recall | ROC AUC | unseen called removed |"]
    lines.append("| --- | --- | --- | --- | --- | --- | --- |")
    kept: dict[str, Any] = {}
    for condition in asked.conditions:
        chosen = _scored(condition, VALIDATION_SEED, max(asked.least, asked.rooms // 2), (judges, rivals))
        tested = _scored(condition, TEST_SEED, asked.rooms, (judges, rivals))
        kept[condition] = tested
        for name in (*rivals, INSTALLED, "detect"):
            threshold = _best_threshold(chosen, name) if name in rivals else 0.5
            lines.append(_line(condition, name, tested, threshold))
    write_json(asked.out, kept)
    print("\n".join(lines))


def _scored(condition: str, seed: int, rooms: int, by: tuple[Judges, list[str]]) -> list[dict[str, Any]]:
    """Truth and the score of each wall and column by every rival that is named, and by `detect`."""
    judges, rivals = by
    settings, told = DetectSettings(refine=False, propose_views=False), []
    for scene in SCENES:
        for start in range(0, rooms, 20):
            for case in room_cases(scene, condition, seed, range(start, min(start + 20, rooms))):
                scan = NamedScan(case.scan, "scan", len(case.scan.points), "given")
                found = detect_scans(case.prior, [scan], judges, settings)
                scores = _rivals(case, rivals)
                for (truth, verdict, probability), guid in elements_of(found, case):
                    row = case.prior.building.elements.guid.index(guid)
                    mine = probability if verdict in (PRESENT, REMOVED) else 0.0
                    told.append({"truth": truth, "detect": mine} | {name: float(scores[name][row]) for name in scores})
    return told


def _rivals(case: RoomCase, names: list[str]) -> dict[str, np.ndarray]:
    """Scores (E,), the higher the likelier gone; 0 of an element without points in view."""
    seen = sight(case.prior, rays_of_scan(case.scan)).prior
    points, scan = seen.points.astype(np.float64), np.asarray(case.scan.points, np.float64)
    apart = np.minimum(nearest_distance(points, scan), FARTHEST)
    along = m3c2(points, scan) if "M3C2" in names else None
    count = len(case.ids)
    scores = {name: np.zeros(count) for name in (*names, INSTALLED)}
    for row in np.unique(seen.element):
        own = seen.element == row
        scores["cloud to mesh"][row] = np.median(apart[own])
        scores["coverage"][row] = np.mean(apart[own] > COVERED)
        scores[INSTALLED][row] = gap_of(apart[own])
        if along is not None:
            scores["M3C2"][row] = np.median(along[own])
    return scores


def gap_of(apart: np.ndarray) -> float:
    """Share of an element's points that the scan does not cover, by their distances [m] to it."""
    return float(np.mean(apart > TOLERANCE))


def m3c2(points: np.ndarray, scan: np.ndarray) -> np.ndarray:
    """Absolute M3C2 distances (N,) [m] of the points to the scan."""
    import py4dgeo  # first by peers.has, where it began a log that is gone

    logging.getLogger("py4dgeo").handlers.clear()
    py4dgeo.set_num_threads(1)
    before, after = py4dgeo.Epoch(points), py4dgeo.Epoch(scan)
    search = py4dgeo.M3C2(
        epochs=(before, after), corepoints=points, corepoint_normals=normals_of(points)[0], cyl_radius=CYLINDER,
        max_distance=DEPTH,
    )  # fmt: skip
    distance, _ = search.run()
    return np.where(np.isfinite(distance), np.abs(distance), FARTHEST)


def _best_threshold(told: list[dict[str, Any]], name: str) -> float:
    known = [one for one in told if one["truth"] in (PRESENT, REMOVED)]
    gone = np.array([one["truth"] == REMOVED for one in known])
    score = np.array([one[name] for one in known])
    candidates = np.unique(score)
    candidates = candidates[:: max(1, len(candidates) // 400)]
    return float(max(candidates, key=lambda level: _f1(score >= level, gone)))


def _f1(called: np.ndarray, gone: np.ndarray) -> float:
    return 2.0 * np.sum(called & gone) / max(1, called.sum() + gone.sum())


def _line(condition: str, name: str, told: list[dict[str, Any]], threshold: float) -> str:
    known = [one for one in told if one["truth"] in (PRESENT, REMOVED)]
    hidden = [one for one in told if one["truth"] in (OCCLUDED, UNSCANNED)]
    gone = np.array([one["truth"] == REMOVED for one in known])
    score = np.array([one[name] for one in known])
    called = score >= threshold
    precision, recall = np.sum(called & gone) / max(1, called.sum()), np.sum(called & gone) / max(1, gone.sum())
    wrong = sum(one[name] >= threshold for one in hidden)
    quality = f"{precision:.3f} | {recall:.3f} | {roc_auc_score(gone, score):.4f}"
    return f"| {condition} | {name} | {len(known)} | {quality} | {wrong} of {len(hidden)} |"


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_out("FILE.json")
    parser.add_argument("--rooms", type=int, metavar="N", help="of each removed object")
    asked = parser.parse_args()
    main(asked)
