"""The first rows of an exported benchmark: ours, a rule, and distances to the model, scored as any method is.

    python -m benchmarks.rows [SCENES] --out runs/rows [--count 200] [--split test]

SCENES is a folder of `jaxmm benchmark export`; without it one of --count scenes is made below --out. Every method reads
what others are given, and writes predictions as others do, to --out/METHOD; what is there is not made again:

- *detect*: `jaxmm detect` with its default models;
- *rule*: pooled evidence, no learning (`jaxmm/rays/rule.py`); an element is gone by the share of its rays that go
  through, and nothing is said where too few tell; finds no objects;
- *C2M*: distance of every point to the model's surface, of the model's points to the scan; of an element the median;
- *M3C2* (Lague et al. 2013, by py4dgeo, make setup-peers): the same along the normal, cylinders of 0.2 m, of an element
  the median; no point in a cylinder counts as the farthest;
- *coverage*: elements only, by a limit that is set beforehand, as tools for construction sites call them installed or
  not: at least half of its points have the scan within 0.05 m, which is to say that their median distance is within
  it. One without a point in view is not told of.

The distances at which C2M and M3C2 call a point new or gone, and an element gone, are those of the best F1 on the
validation split. Prints
Markdown.
"""

import argparse
import functools
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from benchmarks import peers
from benchmarks.command_line import CommandLine
from benchmarks.rivals import FARTHEST, gap_of, m3c2
from jaxmm.exchange.export import Request, export, truth_path
from jaxmm.exchange.scene_files import SceneFiles, read_scene, read_truth, scene_names
from jaxmm.exchange.scenes import LABELS, SAME, UNOBSERVABLE
from jaxmm.exchange.score_table import cell
from jaxmm.exchange.scores import score
from jaxmm.exchange.tasks import SPLITS, TEST, VALIDATION, ExportSettings
from jaxmm.files import load_arrays, write_arrays, write_json
from jaxmm.learning.prediction import Judges, read_judges
from jaxmm.rays.evidence import SUPPORT, THROUGH, View, features_of
from jaxmm.rays.rule import rule_scores
from jaxmm.rays.scan_rays import PosedScan, rays_of_scan
from jaxmm.verdicts.building_evidence import VOXEL, sight
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import Prior, read_prior
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import OCCLUDED, UNSCANNED, VerdictSettings, is_enough
from jaxmm.weights import DEFAULT
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.cores import worker_pool
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.triangles import clearance

MOST_LEVELS = 1000  # thresholds that are tried
METHODS = ("detect", "rule", "C2M", "M3C2", "coverage")
DISTANCES = ("C2M", "M3C2")
FULL = {"count": 400, "split": TEST}
SMOKE = {"count": 5, "split": TEST}
DETECT = DetectSettings(propose_views=False, least_probability=0.05)
SHOWN = (  # part, metric, title
    ("points added", "roc_auc", "new points: ROC AUC"), ("points added", "fpr_at_95", "FPR at 95 %"),
    ("points removed", "roc_auc", "gone points: ROC AUC"), ("points removed", "fpr_at_95", "FPR at 95 %"),
    ("points by class", "iou_positive", "IoU positive"), ("points by class", "iou_negative", "IoU negative"),
    ("points by class", "miou", "mean IoU"), ("elements", "coverage", "elements: coverage"),
    ("elements", "precision", "precision"), ("elements", "recall", "recall"), ("elements", "aurc", "AURC"),
    ("elements", "ece", "ECE"), ("elements", "unobservable_called_removed", "unobservable, called removed"),
    ("objects", "precision", "objects: precision"), ("objects", "recall", "recall"), ("objects", "ap", "AP"),
)  # fmt: skip


def main(asked: argparse.Namespace) -> None:
    scenes = asked.scenes
    if scenes is None:
        scenes = asked.out / "scenes"
        export(ExportSettings(), scenes, Request(asked.count))
    truth = asked.truth or truth_path(scenes)
    methods = [name for name in METHODS if name != "M3C2" or peers.has("py4dgeo")]
    told = {}
    for method in methods:
        for split in dict.fromkeys((VALIDATION, asked.split) if method in DISTANCES else (asked.split,)):
            _predict(method, scenes, split, asked.out / method / split)
        place = asked.out / method / asked.split
        if method in DISTANCES:
            place = _as_probabilities(method, scenes, asked.split, asked.out / method)
        told[method] = score(scenes, place, asked.split, truth)
        print(f"{method}: predictions in {place}", flush=True)
    write_json(asked.out / "rows.json", told)
    print(table(told))


def _predict(method: str, scenes: Path, split: str, out: Path) -> None:
    """One file a scene, on all cores."""
    names = [name for name in scene_names(scenes, split) if not (out / f"{name}.npz").is_file()]
    with worker_pool() as pool:
        list(pool.map(functools.partial(_one, method, scenes, split, out), names))


def _one(method: str, scenes: Path, split: str, out: Path, name: str) -> None:
    write_arrays(out / f"{name}.npz", predict(method, read_scene(scenes, split, name)))


def predict(method: str, scene: SceneFiles) -> dict[str, np.ndarray]:
    """What a method says of a scene, by column of a prediction."""
    prior = read_once(scene.model)
    if method == "detect":
        return _detected(scene, prior)
    if method == "coverage":
        return {"elements": _by_coverage(scene)}
    return _by_rule(scene, prior) if method == "rule" else _by_distance(scene, prior, method)


@functools.lru_cache(maxsize=1)
def read_once(path: Path) -> Prior:
    """The model in a file, kept for the next scene."""
    return read_prior(path)


@functools.lru_cache(maxsize=1)
def _judges() -> Judges:
    return read_judges(DEFAULT)


def _scan_of(scene: SceneFiles, prior: Prior) -> PosedScan:
    pose = scene.about["pose"]
    place, turn = np.array(pose["position"]) - prior.origin, np.array(pose["rotation"])
    sensor = sensor_named(scene.about["sensor"]["name"])
    return PosedScan((scene.scan - prior.origin).astype(np.float32), place, turn, sensor)


def _detected(scene: SceneFiles, prior: Prior) -> dict[str, np.ndarray]:
    scan = NamedScan(_scan_of(scene, prior), "scan.ply", len(scene.scan), "given")
    found = detect_scans(prior, [scan], _judges(), DETECT)
    drawn, told = found.drawing, {one.guid: one for one in found.elements}
    said = [told[one["guid"]] for one in scene.about["elements"]]
    objects = [
        [LABELS.index(f"{one.object_type}_{one.mismatch_type}"), *one.center, *one.dimensions, one.rotation,
         one.probability] for one in found.mismatches
    ]  # fmt: skip
    return {
        "scan": _nearest(scene.scan - drawn.origin, drawn.robot, drawn.robot_probability),
        "reference": _nearest(scene.reference - drawn.origin, drawn.prior, drawn.prior_probability),
        "elements": np.array(
            [np.nan if one.verdict in (OCCLUDED, UNSCANNED) else one.probability for one in said], np.float64
        ),
        "objects": np.array(objects, np.float64).reshape(-1, 9),
    }


def _nearest(points: np.ndarray, thin: np.ndarray, value: np.ndarray) -> np.ndarray:
    """(N,) float32: at every point (N, 3), the value (n,) of the nearest of the thinned ones (n, 3)."""
    return np.asarray(value, np.float32)[cKDTree(thin).query(points)[1]] if len(thin) else np.zeros(len(points))


def _by_rule(scene: SceneFiles, prior: Prior) -> dict[str, np.ndarray]:
    seen = sight(prior, rays_of_scan(_scan_of(scene, prior)))
    scores = [rule_scores(features_of(view, seen.frame), removed=gone)
              for view, gone in ((seen.robot, False), (seen.prior, True))]  # fmt: skip
    return {
        "scan": _nearest(scene.scan - prior.origin, seen.robot.points, scores[0]),
        "reference": _nearest(scene.reference - prior.origin, seen.prior.points, scores[1]),
        "elements": _pooled(scene, prior, seen.prior),
    }


def _pooled(scene: SceneFiles, prior: Prior, view: View) -> np.ndarray:
    guids = {guid: row for row, guid in enumerate(prior.building.elements.guid)}
    rays = np.column_stack([np.bincount(view.element, view.count[:, side], len(guids)) for side in range(4)])
    tells, through = rays[:, [THROUGH, SUPPORT]].sum(axis=1), rays[:, THROUGH]
    share = np.where(is_enough(tells, rays.sum(axis=1), VerdictSettings()), through / np.maximum(tells, 1), np.nan)
    return share[[guids[one["guid"]] for one in scene.about["elements"]]]


def _by_distance(scene: SceneFiles, prior: Prior, method: str) -> dict[str, np.ndarray]:
    """Distances [m]; of an element without a point in view none."""
    scan, reference = scene.scan - prior.origin, scene.reference - prior.origin
    if method == "C2M":
        new = clearance(prior.scene, scan.astype(np.float32), FARTHEST)
        gone = np.minimum(cKDTree(scan).query(reference)[0], FARTHEST)
    else:
        new, gone = _m3c2_at_all(scan, reference), _m3c2_at_all(reference, scan)
    rows = [scene.element == row for row in range(len(scene.about["elements"]))]
    return {
        "scan": new, "reference": gone,
        "elements": np.array([np.median(gone[own]) if own.any() else np.nan for own in rows]),
    }  # fmt: skip


def _by_coverage(scene: SceneFiles) -> np.ndarray:
    apart = np.minimum(cKDTree(scene.scan).query(scene.reference)[0], FARTHEST)
    rows = [apart[scene.element == row] for row in range(len(scene.about["elements"]))]
    return np.array([gap_of(own) if len(own) else np.nan for own in rows])


def _m3c2_at_all(points: np.ndarray, other: np.ndarray) -> np.ndarray:
    """M3C2 distances (N,) [m], measured at one core point a voxel, as its authors advise; others take the nearest."""
    cores = points[thin_clouds([points.astype(np.float32)], VOXEL)[0]]
    return _nearest(points, cores, m3c2(cores, other))


def _as_probabilities(method: str, scenes: Path, split: str, out: Path) -> Path:
    """Distances d as d / (d + threshold), so that the threshold is one half, one for each column."""
    names = scene_names(scenes, VALIDATION)
    truth = read_truth(scenes, VALIDATION, names, Path())
    threshold = {}
    for column in ("scan", "reference", "elements"):
        label = np.concatenate([getattr(truth[name], column) for name in names])
        apart = np.concatenate([load_arrays(out / VALIDATION / f"{name}.npz")[column] for name in names])
        known = np.flatnonzero((label != UNOBSERVABLE) & ~np.isnan(apart))
        threshold[column] = best_threshold(apart[known], label[known] != SAME)
    place = out / f"{split}-probabilities"
    for name in scene_names(scenes, split):
        said = load_arrays(out / split / f"{name}.npz")
        write_arrays(place / f"{name}.npz", {key: value / (value + threshold[key]) for key, value in said.items()})
    return place


def best_threshold(score: np.ndarray, gone: np.ndarray) -> float:
    """The threshold above 0 of the best F1; as good as the best where there are many scores."""
    levels = np.unique(score[score > 0.0])
    if not len(levels):
        return FARTHEST
    levels = levels[:: max(1, len(levels) // MOST_LEVELS)]
    of_gone, of_all = np.sort(score[gone]), np.sort(score)
    right, called = (len(one) - np.searchsorted(one, levels) for one in (of_gone, of_all))
    return float(levels[int(np.argmax(2.0 * right / np.maximum(called + gone.sum(), 1)))])


def table(told: dict[str, dict[str, Any]]) -> str:
    """A line for each method and difficulty, as Markdown."""
    lines = [f"| method | difficulty | scenes | {' | '.join(title for *_, title in SHOWN)} |"]
    lines.append("| --- | --- | --- |" + " --- |" * len(SHOWN))
    for method, scored in told.items():
        for difficulty in dict.fromkeys(row["difficulty"] for row in scored["rows"]):
            own = {(row["part"], row["metric"]): row for row in scored["rows"] if row["difficulty"] == difficulty}
            cells = [cell(own[part, metric]) if (part, metric) in own else "-" for part, metric, _ in SHOWN]
            scenes = next(iter(own.values()))["scenes"]
            lines.append(f"| {method} | {difficulty} | {scenes} | {' | '.join(cells)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("scenes", type=Path, nargs="?", metavar="SCENES")
    parser.add_out()
    parser.add_argument("--count", type=int, metavar="N", help="scenes to make where there are none")
    parser.add_argument("--split", choices=SPLITS)
    parser.add_argument("--truth", type=Path, metavar="FILE.npz", help="of the test split; default: beside SCENES")
    main(parser.parse_args())
