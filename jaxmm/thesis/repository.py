"""The public repository of the thesis: finds its scan pairs and weights, reads them, scores them row by row.

Layout, below the root (folder names vary, so they are found by pattern):
    datasets/dataset_<scenario>/clean_and_occluded/{npy_files*,labels*}/     synthetic rooms, or below clean/, occluded/
    datasets/dataset_<scenario>/<condition>/preprocessed_csv_files/          the same points with categoryID
    datasets/dataset_real_world/<scenario>/<condition>/...                   the Atlas building, same folders
    trained_models/<scenario>/*.pth                                          released networks
A scan is room_<n>_<condition>_<dt_scan|robot_scan>_....npy, its labels the same name + _labels.npy.
"""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.inputs import InputError
from jaxmm.learning.labels import labels_by_element
from jaxmm.learning.metrics import METRICS, point_metrics
from jaxmm.learning.preprocess import nearest_distance
from jaxmm.thesis.inputs import read_csv, read_labels, read_points

SCAN_NAME = re.compile(r"(?P<room>room_\w+?)_(?P<condition>clean|occluded)_(?P<side>dt|robot)_scan_(?P<tail>\w+)\.npy")
AUGMENTED = ("_rotated", "_translated")  # endings of the moved copies that the thesis also stored
SAME_POINT = 1e-4  # [m] within which a row of a CSV is the same point as that of the .npy

BoxFinder = Callable[[np.ndarray, np.ndarray], list[dict[str, Any]]]  # points (N, 3) [m], score (N,) -> boxes


class ThesisPair(NamedTuple):
    """The files of one scan pair, seen from the scan that is scored: robot when added, DT when removed."""

    scenario: str
    source: str  # "synthetic" | "atlas"
    room: str  # such as room_test_1
    condition: str  # "clean" | "occluded"
    scored: Path
    other: Path
    labels: Path
    elements: Path | None  # CSV of the scored scan with categoryID


class ThesisScan(NamedTuple):
    """The arrays of one pair; N points of the scored scan, M of the other."""

    points: np.ndarray  # (N, 3) float32 [m] world frame
    other: np.ndarray  # (M, 3) float32 [m]
    distance: np.ndarray  # (N,) float32 [m] to the nearest point of the other scan
    label: np.ndarray  # (N,) bool, as released
    element: np.ndarray | None  # (N,) int32 categoryID; None without a CSV


def find_pairs(root: Path | str, rooms: str = "test") -> list[ThesisPair]:
    """The scan pairs below a root, ordered by source, scenario, room, condition.

    Args:
        root: folder of the thesis's repository, the one that holds `datasets`.
        rooms: "test" for room_test_*, "train" for the others.

    Raises:
        InputError: no such layout, no pair of the asked kind, a scan without its partner or without labels.
        ValueError: rooms is neither word.
    """
    if rooms not in ("test", "train"):
        raise ValueError(f"rooms must be test or train, got {rooms!r}")
    datasets = Path(root) / "datasets"
    if not datasets.is_dir():
        raise InputError(f"{root}: expected the thesis's repository with a folder datasets, found none")
    pairs = [pair for place in _places(datasets) for pair in _pairs_of(*place, test=rooms == "test")]
    if not pairs:
        kind = "room_test_*" if rooms == "test" else "training room"
        raise InputError(
            f"{root}: expected {kind} scans in datasets/dataset_<scenario>/*/npy_files*/ of {', '.join(SCENARIOS)};"
            " found none"
        )
    return pairs


def find_weights(root: Path | str) -> dict[str, Path]:
    """The released network of each scenario that has one.

    Looked for in trained_models/<scenario>/, <scenario>/ and, by the scenario in the file's name, in trained_models/
    and the root itself: the first that holds a .pth decides. Among several, the network without coordinates, trained
    without augmentation on both conditions, is the one that the thesis evaluates.

    Raises:
        InputError: no .pth of any scenario, or several equally good ones.
    """
    root = Path(root)
    found = {scenario: path for scenario in SCENARIOS if (path := _weights_of(root, scenario)) is not None}
    if not found:
        raise InputError(f"{root}: expected networks as trained_models/<scenario>/*.pth, found none")
    return found


def read_pair(pair: ThesisPair) -> ThesisScan:
    """Read and check the files of one pair.

    Raises:
        InputError: see `inputs`; or the CSV does not hold the same points in the same order.
    """
    points, other = read_points(pair.scored), read_points(pair.other)
    label = read_labels(pair.labels, len(points))
    element = None
    if pair.elements is not None:
        table = read_csv(pair.elements)
        if len(table.points) != len(points):
            raise InputError(
                f"{pair.elements}: expected the {len(points)} points of {pair.scored.name}, got {len(table.points)}"
            )
        apart = np.abs(table.points - points).max(axis=1)
        if apart.max() > SAME_POINT:
            row = int(np.argmax(apart > SAME_POINT))
            raise InputError(
                f"{pair.elements}: point {row} lies {apart[row]:.3g} m from point {row} of {pair.scored.name}"
            )
        element = table.element
    return ThesisScan(points, other, nearest_distance(points, other), label, element)


Scorer = Callable[[ThesisScan], np.ndarray]  # -> score (N,), higher means rather changed


def nn_raw(scan: ThesisScan) -> np.ndarray:
    """The control: the distance to the other scan is the score, no network at all."""
    return scan.distance


def score_pair(pair: ThesisPair, scorer: Scorer, find_boxes: BoxFinder | None = None) -> dict[str, Any]:
    """One row of `jaxmm thesis`: metrics on the released labels, and on labels by element where there is a CSV.

    Args:
        pair: which files.
        scorer: scan -> score (N,), higher means rather changed.
        find_boxes: (points, score) -> boxes, as they go into the row; None: the row has no boxes.

    Returns:
        scenario, source, room, condition, points, positives, the metrics (None without positives, and then also
        max_probability, the highest score), by_element (dict or None), boxes.

    Raises:
        InputError: see `read_pair`.
    """
    scan = read_pair(pair)
    score = np.asarray(scorer(scan))
    positives = int(scan.label.sum())
    row = {
        "scenario": pair.scenario,
        "source": pair.source,
        "room": pair.room,
        "condition": pair.condition,
        "points": len(scan.points),
        "positives": positives,
        **point_metrics(score, scan.label)._asdict(),
        "by_element": _by_element(scan, score),
        "boxes": [] if find_boxes is None else find_boxes(scan.points, score),
    }
    if row["roc_auc"] is None:
        row["max_probability"] = float(score.max())
    return row


def _by_element(scan: ThesisScan, score: np.ndarray) -> dict[str, float | None] | None:
    if scan.element is None or not scan.label.any():
        return None
    label, void = labels_by_element(scan.label, scan.element, scan.distance)
    metrics = point_metrics(score, label, void)._asdict()
    return {name: metrics[name] for name in METRICS[:4]}


def _places(datasets: Path) -> Iterator[tuple[str, str, Path]]:
    """Every (source, scenario, folder) that may hold scans, in the order of the rows."""
    for scenario in SCENARIOS:
        yield "synthetic", scenario, datasets / f"dataset_{scenario}"
    for scenario in SCENARIOS:
        yield "atlas", scenario, datasets / "dataset_real_world" / scenario


def _pairs_of(source: str, scenario: str, folder: Path, *, test: bool) -> list[ThesisPair]:
    side, partner = ("robot", "dt") if scenario.endswith("_added") else ("dt", "robot")
    chosen: dict[tuple[str, str, str], Path] = {}
    # The first folder that holds a scan decides: both conditions together before one, no copies before copies.
    places = ("clean_and_occluded", *CONDITIONS)
    for npy_folder in (path for place in places for path in _ranked(folder / place, "npy_files*")):
        for path in sorted(npy_folder.glob("*.npy")):
            match = SCAN_NAME.fullmatch(path.name)
            if match is None or match["side"] != side or match["tail"].endswith(AUGMENTED):
                continue
            if match["room"].startswith("room_test_") == test:
                chosen.setdefault((match["room"], match["condition"], match["tail"]), path)
    pairs = []
    for (room, condition, tail), scored in sorted(chosen.items()):
        other = scored.with_name(f"{room}_{condition}_{partner}_scan_{tail}.npy")
        if not other.is_file():
            raise InputError(f"{scored}: expected its partner {other.name} beside it, found none")
        elements = _elements_file(folder / condition, scored, scenario)
        pairs.append(ThesisPair(scenario, source, room, condition, scored, other, _labels_file(scored), elements))
    return pairs


def _labels_file(scored: Path) -> Path:
    name = f"{scored.stem}_labels.npy"
    folders = [folder for folder in _ranked(scored.parents[1], "labels*") if (folder / name).is_file()]
    if not folders:
        raise InputError(f"{scored}: expected its labels {name} in a folder labels* beside its own, found none")
    # npy_files_filtered goes with labels_npy_filtered, and so on: the same words after the first.
    suffix = scored.parent.name.removeprefix("npy_files")
    return min(folders, key=lambda folder: not _suffix_of_labels(folder) == suffix) / name


def _suffix_of_labels(folder: Path) -> str:
    return folder.name.removeprefix("labels").removeprefix("_npy")


def _elements_file(folder: Path, scored: Path, scenario: str) -> Path | None:
    # One released pair names the scenario in its .npy files and not in its CSVs.
    for stem in (scored.stem, scored.stem.replace(f"_scan_{scenario}_", "_scan_")):
        for path in sorted(folder.glob(f"preprocessed_csv_files*/{stem}.csv")):
            return path
    return None


def _ranked(folder: Path, pattern: str) -> list[Path]:
    """Matching folders: without moved copies first, filtered labels before unfiltered ones."""
    folders = [path for path in folder.glob(pattern) if path.is_dir()]
    return sorted(folders, key=lambda path: ("no_augmented" not in path.name, "filtered" not in path.name, path.name))


def _weights_of(root: Path, scenario: str) -> Path | None:
    searches = (
        (root / "trained_models" / scenario, "*.pth"),
        (root / scenario, "*.pth"),
        (root / "trained_models", f"*{scenario}*.pth"),
        (root, f"*{scenario}*.pth"),
    )
    for folder, pattern in searches:
        paths = sorted(folder.glob(pattern))
        if not paths:
            continue
        words = ("no_xyz", "no_augmented", "clean_and_occluded")
        missing = [sum(word not in path.name for word in words) for path in paths]
        best = [path for path, count in zip(paths, missing, strict=True) if count == min(missing)]
        if len(best) > 1:
            raise InputError(
                f"{folder}: expected one network for {scenario}, found {', '.join(p.name for p in best)}"[:400]
            )
        return best[0]
    return None
