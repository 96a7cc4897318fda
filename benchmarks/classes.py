"""What `detect --classes all` tells of every class of elements: what is called removed, rightly and wrongly.

    python -m benchmarks.classes FOLDER --out runs/classes [--views 4] [--seed 3] [--project FOLDER]

Places in every IFC file below FOLDER, and in the one building of all files of --project, by sensors that err as built.
In three of four views one to five elements are out, drawn class by class from those that the noise-free scan shows at
100 rays or more. In half of the views rays pass the glass of windows, which the model has as solid; in a third one
door that is seen stands open: its leaf is turned by 30 to 170 degrees, its frame stays. *Testable* is an element that
is out where 500 noise-free rays or more that should end on it end more than 0.1 m behind it. A file of JSON lines for
each file and sensor; what is there is not made again, so that more --views go on from fewer. Prints Markdown.
"""

from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.views.building_views import asked_for, kept_views, scanned, tell_views
from benchmarks.views.detection_scores import share_of
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import Judges
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.results import Key
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import DISPLACED, PRESENT, REMOVED, VERDICTS, keys_of
from warp_scanner import draws
from warp_scanner.buildings.changes import Change, of_element
from warp_scanner.buildings.positions import draw_positions
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.building import Triangles, rows_by_key
from warp_scanner.scenes.scenes import DOOR, WINDOW
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.triangles import cast_triangles, prepare

SENSORS = ("tls-real", "ouster-64-real", "velodyne-16-real", "oak-d-pro-small-real")
FULL, SMOKE = {"views": 4, "sensors": SENSORS}, {"views": 1, "sensors": ("oak-d-pro-small-real",)}
UNTOUCHED, CLEAR, AJAR = 0.25, 0.5, 1.0 / 3.0  # share of views where nothing is out, glass is clear, a door is open
MOST_OUT = 5
LEAST_SHOWN, LEAST_RAYS = 100, 500  # rays on an element that may be out; rays that tell of one that is testable
BEHIND = 0.1  # [m] behind an element, at which a ray tells that it is out
BAR = 0.07  # [m] of the frame of a door, and of a window whose materials say nothing
LEAF, TURNED = 0.04, (30.0, 170.0)  # [m] of a leaf, and by what it stands open [deg]
TOLD = (PRESENT, DISPLACED, REMOVED)
CLASS_COLUMNS = (
    "class", "out", "of those testable", "of those told removed",
    *(f"told {name}" for name in VERDICTS if name != REMOVED), "seen standing", "of those told removed",
)  # fmt: skip


def _view(prior: Prior, judges: Judges, sensor_name: str, which: tuple[int, int]) -> dict[str, Any] | None:
    """What is told of one view; None where there is no place to stand."""
    keys = draws.keys(which[0], np.array([which[1]]))
    pose, found = draw_positions(prior.building, prior.scene, Standing(height=(1.0, 1.8)), keys)
    if not found[0]:
        return None
    rng, sensor = np.random.default_rng((*which, len(sensor_name))), sensor_named(sensor_name)
    rays, semantic = rays_of(sensor, pose), prior.building.triangles.semantic
    meets = cast_triangles(prior.scene, rays)
    seen = np.bincount(meets.element[0][meets.element[0] >= 0], minlength=len(semantic)) >= LEAST_SHOWN
    out = _drawn(prior, seen, rng) if rng.random() >= UNTOUCHED else np.zeros(0, int)
    is_clear = rng.random() < CLEAR
    triangles = _without_panes(prior, prior.building.triangles) if is_clear else prior.building.triangles
    doors = np.setdiff1d(np.flatnonzero(seen & (semantic == DOOR)), out)
    ajar = rng.choice(doors, 1) if len(doors) and rng.random() < AJAR else np.zeros(0, int)
    for row in ajar:
        triangles = _opened(prior, triangles, int(row), rng)
    scene = prepare(triangles)
    present = ~np.isin(np.arange(len(semantic)), out)
    truth = cast_triangles(scene, rays, present).distance[0]
    tells = meets.element[0][np.isfinite(truth) & (truth > meets.distance[0] + BEHIND)]
    told = np.bincount(tells[tells >= 0], minlength=len(semantic))
    scan, _ = scanned(scene, present, (sensor, pose), which)
    elements = prior.building.elements
    keys = list(zip(elements.file, elements.guid, strict=True))
    record: dict[str, Any] = {
        "out": [[elements.ifc_class[row], elements.guid[row], int(told[row])] for row in out],
        "clear": bool(is_clear), "ajar": [elements.guid[row] for row in ajar],
        "pose": [*map(float, pose.position[0]), float(pose.yaw[0])], "number": which[1],
    }  # fmt: skip
    try:
        found = detect_scans(
            prior,
            [NamedScan(scan, "scan", len(scan.points), "given")],
            judges,
            DetectSettings(classes=("all",), propose_views=False),
        )
    except InputError as error:
        return record | {"refused": str(error)}
    verdict = {one.key: one for one in found.elements}
    gone = _gone(prior, {keys[row] for row in out})
    # What another file has, too, is told as what it is the same as.
    twins = {key for one in found.elements for key in one.same_as}.difference(keys)
    standing = [one for key, one in verdict.items() if key not in gone | twins]
    return record | {
        "verdicts": [verdict[keys[row]].verdict for row in out],
        "rays": [list(verdict[keys[row]].rays) for row in out],
        "wrong": [
            [one.ifc_class, one.guid, list(one.rays), round(one.probability, 4), one.name] for one in standing
            if one.verdict == REMOVED
        ],
        "told": dict(Counter(one.ifc_class for one in standing if one.verdict in TOLD)),
        "doubts": list(found.doubts), "seconds": found.timing["total"], "unexplained": len(found.unexplained),
    }  # fmt: skip


def _gone(prior: Prior, out: set[Key]) -> set[Key]:
    """What is out, and what is put together from nothing else."""
    wholes = [
        ((whole.file, whole.guid), [(whole.file, guid) for guid in whole.parts]) for whole in prior.building.wholes
    ]
    wholes += [(key, list(whole.pieces)) for whole in prior.building.pieced for key in keys_of(whole)]
    body = set(rows_by_key(prior.building.elements))
    return out | {key for key, parts in wholes if (out >= set(parts) and (key in out or key not in body))}


def _drawn(prior: Prior, seen: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Rows of one to five elements that are seen (E,), of a class drawn anew for each."""
    classes = np.asarray(prior.building.elements.ifc_class, str)
    left, found = seen.copy(), []
    for _ in range(rng.integers(1, MOST_OUT + 1)):
        if not left.any() or left.sum() == left.size:
            break
        kind = rng.choice(np.unique(classes[left]))
        found.append(int(rng.choice(np.flatnonzero(left & (classes == kind)))))
        left[found[-1]] = False
    return np.array(found, int)


def _opened(prior: Prior, triangles: Triangles, row: int, rng: np.random.Generator) -> Triangles:
    """A door as its frame, and a leaf that is turned about an upright side of it."""
    import trimesh  # slow to import

    one = of_element(prior.building, row)
    long = int(one.size[1] > one.size[0])
    size = np.array([float(one.size[long]) - 2.0 * BAR, LEAF, float(one.size[2]) - BAR])
    side, angle = rng.choice((-1.0, 1.0)), np.radians(rng.uniform(*TURNED)) * rng.choice((-1.0, 1.0))
    leaf = trimesh.creation.box(size)
    hinge = [side * size[0] / 2.0, 0.0, 0.0]
    leaf.apply_transform(trimesh.transformations.rotation_matrix(angle, [0.0, 0.0, 1.0], hinge))
    turn = np.radians(one.yaw) + long * np.pi / 2.0
    leaf.apply_transform(trimesh.transformations.rotation_matrix(turn, [0.0, 0.0, 1.0]))
    vertices, faces = _frame(one)
    faces = np.concatenate([faces, np.asarray(leaf.faces) + len(vertices)])
    vertices = np.concatenate([vertices, np.asarray(leaf.vertices) + one.center])
    kept = triangles.element != row
    return triangles._replace(
        vertices=np.concatenate([triangles.vertices, vertices]).astype(np.float32),
        faces=np.concatenate([triangles.faces[kept], faces + len(triangles.vertices)]).astype(np.int32),
        element=np.concatenate([triangles.element[kept], np.full(len(faces), row)]).astype(np.int32),
    )


def _without_panes(prior: Prior, triangles: Triangles) -> Triangles:
    """The triangles without glass; of a window whose materials say nothing a frame is left."""
    semantic, clear = triangles.semantic, prior.building.clear
    has_frame = np.bincount(triangles.element[clear], minlength=len(semantic)) > 0
    has_frame &= np.bincount(triangles.element[~clear], minlength=len(semantic)) > 0
    solid = (semantic == WINDOW) & ~has_frame
    kept = ~clear & ~solid[triangles.element]
    found = [triangles.vertices], [triangles.faces[kept]], [triangles.element[kept]]
    for row in np.flatnonzero(solid):
        vertices, faces = _frame(of_element(prior.building, int(row)))
        found[1].append(faces + sum(map(len, found[0])))
        found[0].append(vertices)
        found[2].append(np.full(len(faces), row))
    vertices, faces, element = map(np.concatenate, found)
    return Triangles(vertices.astype(np.float32), faces.astype(np.int32), element.astype(np.int32), semantic)


def _frame(window: Change) -> tuple[np.ndarray, np.ndarray]:
    """Corners (v, 3) [m] and faces of four bars around what a window fills."""
    import trimesh  # slow to import

    size = np.asarray(window.size, np.float64)
    long = int(size[1] > size[0])
    bars = []
    for axis in (long, 2):
        for way in (-0.5, 0.5):
            edges, middle = size.copy(), np.zeros(3)
            edges[axis] = min(BAR, size[axis] / 2)
            middle[axis] = way * (size[axis] - edges[axis])
            bars.append(trimesh.creation.box(edges, trimesh.transformations.translation_matrix(middle)))
    whole = trimesh.util.concatenate(bars)
    whole.apply_transform(trimesh.transformations.rotation_matrix(np.radians(window.yaw), [0.0, 0.0, 1.0]))
    return np.asarray(whole.vertices) + window.center, np.asarray(whole.faces)


def table(out: Path, seed: int) -> str:
    """All files and sensors, a row for each class, as Markdown."""
    views = [one for sensor in SENSORS for one in kept_views(out, sensor, seed)]
    believed = [one for one in views if "refused" not in one]
    gone, testable_told, wrong, standing = Counter(), Counter(), Counter(), Counter()
    for one in believed:
        standing.update(one["told"])
        wrong.update(kind for kind, *_ in one["wrong"])
        for (kind, _, rays), verdict in zip(one["out"], one["verdicts"], strict=True):
            gone[kind] += 1
            if rays >= LEAST_RAYS:
                testable_told[kind, verdict] += 1
    lines = [f"| {' | '.join(CLASS_COLUMNS)} |", f"|{' --- |' * len(CLASS_COLUMNS)}"]
    kinds = sorted(standing | gone)
    for name, some in (*((kind, [kind]) for kind in kinds), ("all", kinds)):
        told = {verdict: sum(testable_told[kind, verdict] for kind in some) for verdict in VERDICTS}
        testable, count = sum(told.values()), [sum(of[kind] for kind in some) for of in (gone, standing, wrong)]
        others = [told[verdict] for verdict in VERDICTS if verdict != REMOVED]
        cells = [name, count[0], share_of(testable, count[0]), share_of(told[REMOVED], testable), *others, count[1]]
        lines.append(f"| {' | '.join(map(str, [*cells, share_of(count[2], count[1])]))} |")
    still = [one for one in believed if not one["out"]]
    lines += [
        "",
        f"{len(views)} views, {len(views) - len(believed)} refused, {sum(bool(one['doubts']) for one in believed)} "
        f"doubted; nothing removed in {share_of(sum(not one['wrong'] for one in still), len(still))} of the untouched; "
        f"median {np.median([one['seconds'] for one in believed]):.1f} s",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    asked = asked_for(__doc__, FULL, SMOKE, projects=True)
    tell_views(_view, asked, [asked.project] if asked.project else [])
    print(table(asked.out, asked.seed))
