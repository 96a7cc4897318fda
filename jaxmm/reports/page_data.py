"""What report.html carries: the report itself, and the arrays that its 3D view draws, bounded in size.

N points of a cloud, V vertices, T triangles, E elements. Arrays are base64 of little-endian numbers. Positions are
float32 offsets [m] from the drawing's origin; all else is in the world frame of the prior, metres, z up.
"""

import base64
import json
from collections import Counter
from typing import Any, NamedTuple

import numpy as np

from jaxmm.reports.deviation_words import (
    INTERVAL_WORDS,
    NORTH_WORDS,
    SIGN_WORDS,
    UNMEASURED_WORDS,
    is_off_at_ends,
    off_in_words,
    place_in_words,
    tolerance_of,
)
from jaxmm.reports.markdown import printable
from jaxmm.reports.offset_arrows import offsets_of
from jaxmm.reports.report_json import to_json
from jaxmm.reports.verdict_words import (
    ASSUMED,
    ASSUMED_WORDS,
    EVIDENCE_WORDS,
    OBSERVABLE_WORDS,
    PROBABILITY_OF_MISMATCH,
    PROBABILITY_WORDS,
    ROBOT_EVIDENCE_WORDS,
    SURE_OF_TYPE,
    UNEXPLAINED_WORDS,
    VERDICT_WORDS,
    why_occluded,
)
from jaxmm.verdicts.mismatch_points import signed_distances
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict, Key
from jaxmm.verdicts.verdicts import OCCLUDED


class Limits(NamedTuple):
    """The most that a page holds; with all of it the file stays below 30 MB."""

    points: int = 300_000  # of each of the two clouds
    triangles: int = 400_000
    vertices: int = 500_000


class Surface(NamedTuple):
    """The prior's surface as the page draws it, the triangles in the order of their elements."""

    vertices: np.ndarray  # (V, 3) float32 [m] offsets
    faces: np.ndarray  # (T, 3) int32
    first: np.ndarray  # (E + 1,) int32: the triangles of element e are first[e] to first[e + 1]


LIMITS = Limits()
HEAD = 2.2  # [m] above the floor, where the view is cut
DISTANCE_STEP = 0.0001  # [m] of the distances of points
UNDER = 0.5  # [m] below the floor, where the storey below begins


def page_data(detection: Detection, limits: Limits = LIMITS) -> dict[str, Any]:
    """All that the page shows, as plain values for JSON; see `encoded` for the arrays.

    What is left out to keep the limits is said in `thinned`, a sentence each.
    """
    drawing, places = detection.drawing, sensor_places(detection)
    robot = _thinned(np.argsort(drawing.robot_scan, kind="stable"), limits.points)  # scan by scan
    prior = _thinned(np.arange(len(drawing.prior)), limits.points)
    surface = surface_of(drawing, places, _mismatched(detection), limits)
    arrays = {
        "robot": drawing.robot[robot].astype("<f4"),
        "robot_probability": _as_bytes(drawing.robot_probability[robot]),
        "robot_evidence": drawing.robot_evidence[robot].astype("u1"),
        "robot_scan": drawing.robot_scan[robot].astype("<i4"),
        "robot_distance": _as_steps(signed_distances(detection, robot)),
        "prior": drawing.prior[prior].astype("<f4"),
        "prior_probability": _as_bytes(drawing.prior_probability[prior]),
        "prior_evidence": drawing.prior_evidence[prior].astype("u1"),
        "vertices": surface.vertices.astype("<f4"),
        "faces": surface.faces.astype("<i4"),
        "first": surface.first.astype("<i4"),
    }
    return {
        "summary": detection.summary(),
        "report": to_json(detection),
        "words": {
            "verdicts": VERDICT_WORDS if detection.elements else {},  # a point cloud has nothing that they are of
            "probability": PROBABILITY_WORDS if detection.elements else PROBABILITY_OF_MISMATCH,
            "prior": EVIDENCE_WORDS, "robot": ROBOT_EVIDENCE_WORDS, "observable": OBSERVABLE_WORDS,
            "unexplained": UNEXPLAINED_WORDS,
            "unmeasured": UNMEASURED_WORDS, "north": NORTH_WORDS, "interval": INTERVAL_WORDS, "sign": SIGN_WORDS,
            "assumed": ASSUMED_WORDS, "tilde": ASSUMED, "sure_of_type": SURE_OF_TYPE,
        },
        "why": [why_occluded(one.rays) if one.verdict == OCCLUDED else None for one in detection.elements],
        "deviations": [_deviation(one, detection.drawing) for one in detection.elements],
        "tolerance": tolerance_of(detection), "distance_step": DISTANCE_STEP,
        "thinned": _told(drawing, (len(robot), len(prior), len(surface.faces))),
        "has_surface": drawing.vertices is not None,
        **_keys(detection),
        "origin": [float(value) for value in drawing.origin],
        "fields_of_view": [np.round(corners, 5).tolist() for corners in drawing.fields_of_view],
        "frame": _frame(detection, places),
        "arrays": {name: encoded(array) for name, array in arrays.items()},
    }  # fmt: skip


def _keys(detection: Detection) -> dict[str, Any]:
    """What the page calls elements: by GlobalId, and of those that several files have by file, too.

    `key` of each that is drawn, `element_key` of each that has a verdict, `mismatch_key` of the element of each
    mismatch; `twins` are what is drawn as another: [key, index of that]; `pieced` what is drawn as its pieces: [key,
    index of the first].
    """
    rows = detection.drawing.rows()
    drawn = {row: key for key, row in rows.items()}  # the own key of each comes last
    known = {
        *rows,
        *(one.key for one in detection.elements),
        *(key for keys, _ in detection.drawing.pieced for key in keys),
    }
    count = Counter(guid for _, guid in known)

    def named(key: Key) -> str:
        file, guid = key
        return guid if count[guid] < 2 else f"{guid} of {file}"

    own = [drawn[row] for row in range(len(detection.drawing.guid))]
    return {
        "key": [named(key) for key in own],
        "element_key": [named(one.key) for one in detection.elements],
        "mismatch_key": [None if one.element is None else named(one.key) for one in detection.mismatches],
        "twins": [[named(key), row] for key, row in rows.items() if key != own[row]],
        "pieced": [
            [named(key), shown[0]]
            for keys, _ in detection.drawing.pieced
            for key in keys
            if (shown := detection.drawing.rows_of(key))
        ],
    }


def _deviation(one: ElementVerdict, drawing: Drawing) -> dict[str, Any] | None:
    """What the page needs of an element's deviation beside what the report says [m]; None where it was not measured.

    Of what is turned or leans also its arrows: where each begins, from the drawing's origin, and the offset there.
    """
    told = one.deviation
    if told is None or not np.isfinite([*told.offset, told.distance, told.most, told.half]).all():
        return None
    return {
        "offset": [float(value) for value in told.offset], "distance": told.distance, "most": told.most,
        "half": told.half, "at_ends": is_off_at_ends(told), "arrows": _arrows(one, drawing),
        "words": off_in_words(told), "sentence": printable(place_in_words(one)),
    }  # fmt: skip


def _arrows(one: ElementVerdict, drawing: Drawing) -> list[list[list[float]]] | None:
    corners = drawing.corners(one.key) if is_off_at_ends(one.deviation) else None
    if corners is None:
        return None
    return [[place.tolist(), step.tolist()] for place, step in offsets_of(one.deviation, corners)]


def as_script(data: dict[str, Any]) -> str:
    """JSON in ASCII that may stand inside a script element: no text in it can end the element or open another."""
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def encoded(array: np.ndarray) -> dict[str, Any]:
    """An array as dtype, shape and base64 of its little-endian bytes, row by row."""
    little = np.ascontiguousarray(array, array.dtype.newbyteorder("<"))
    text = base64.b64encode(little.tobytes()).decode("ascii")
    return {"dtype": array.dtype.name, "shape": list(array.shape), "data": text}


def decoded(array: dict[str, Any]) -> np.ndarray:
    """The array that `encoded` was given."""
    kind = np.dtype(array["dtype"]).newbyteorder("<")
    return np.frombuffer(base64.b64decode(array["data"]), kind).reshape(array["shape"])


def sensor_places(detection: Detection) -> np.ndarray:
    """Where the scans were taken, (R, 3) float64 [m] offsets from the drawing's origin."""
    places = np.array([scan.pose[:3] for scan in detection.scans], np.float64).reshape(-1, 3)
    return places - detection.drawing.origin


def surface_of(drawing: Drawing, places: np.ndarray, first_of_all: np.ndarray, limits: Limits = LIMITS) -> Surface:
    """The prior's surface within the limits: whole elements, the nearest to a sensor before the others.

    Args:
        drawing: what is drawn; a cloud as prior gives an empty surface.
        places: (R, 3) [m] offsets of the sensors; without any, the middle of the surface takes their place.
        first_of_all: (m,) int elements that come before all others.
        limits: of triangles and vertices. The element that would exceed them keeps its nearest triangles.
    """
    count = len(drawing.guid)
    if drawing.vertices is None or not len(drawing.faces):
        return Surface(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros(count + 1, np.int32))
    faces, element = drawing.faces, drawing.face_element
    kept = np.arange(len(faces))
    if len(faces) > limits.triangles or len(drawing.vertices) > limits.vertices:
        kept = _nearest(drawing, places, first_of_all, limits)
    kept = kept[np.argsort(element[kept], kind="stable")]
    used, corner = np.unique(faces[kept], return_inverse=True)
    first = np.searchsorted(element[kept], np.arange(count + 1))
    return Surface(drawing.vertices[used], corner.reshape(-1, 3).astype(np.int32), first.astype(np.int32))


def _nearest(drawing: Drawing, places: np.ndarray, first_of_all: np.ndarray, limits: Limits) -> np.ndarray:
    """Triangles to keep, by number."""
    faces, element = drawing.faces, drawing.face_element
    middle = drawing.vertices[faces].mean(axis=1)
    places = places if len(places) else middle.mean(axis=0, keepdims=True)
    away = np.full(len(faces), np.inf)
    for place in places:
        away = np.minimum(away, np.linalg.norm(middle - place, axis=1))
    nearest = np.full(len(drawing.guid), np.inf)
    np.minimum.at(nearest, element, away)
    nearest[first_of_all] = -1.0
    order = np.lexsort((away, element, nearest[element]))[: limits.triangles]
    # Where, in this order, each vertex is first needed: the triangles before the one too many are kept.
    needed = np.sort(np.unique(faces[order], return_index=True)[1]) // 3
    return order if len(needed) <= limits.vertices else order[: needed[limits.vertices]]


def _thinned(order: np.ndarray, most: int) -> np.ndarray:
    """At most `most` of the indices, evenly spread."""
    return order if len(order) <= most else order[np.arange(most) * len(order) // most]


def _as_bytes(probability: np.ndarray) -> np.ndarray:
    """Probabilities in steps of 1/255: a colour shows no more."""
    return np.round(255.0 * np.clip(np.nan_to_num(probability), 0.0, 1.0)).astype("u1")


def _as_steps(distance: np.ndarray | None) -> np.ndarray:
    """Distances [m] in steps of DISTANCE_STEP, as far as these go; none where nobody knows any."""
    if distance is None:
        return np.zeros(0, "<i2")
    most = np.iinfo(np.int16).max
    return np.clip(np.nan_to_num(distance, nan=np.inf) / DISTANCE_STEP, -most, most).round().astype("<i2")


def _mismatched(detection: Detection) -> np.ndarray:
    rows = {row for one in detection.mismatches for row in detection.drawing.rows_of(one.key)}
    return np.array(sorted(rows), int)


def _told(drawing: Drawing, shown: tuple[int, int, int]) -> list[str]:
    total = len(drawing.robot), len(drawing.prior), 0 if drawing.faces is None else len(drawing.faces)
    names = "points of the robot", "points of the prior", "triangles of the prior's surface, the nearest to the scanner"
    return [
        f"The view shows {part:,} of {whole:,} {name}; the report counts all."
        for part, whole, name in zip(shown, total, names, strict=True)
        if part < whole
    ]


def _frame(detection: Detection, places: np.ndarray) -> dict[str, Any]:
    """What the camera looks at first and where the view is cut [m], all as offsets; stray points do not count."""
    drawing = detection.drawing
    clouds = [cloud for cloud in (drawing.robot, drawing.prior) if len(cloud)]
    if not clouds:
        clouds = [drawing.vertices if drawing.vertices is not None and len(drawing.vertices) else np.zeros((1, 3))]
    points = np.concatenate(clouds)
    low, high = np.percentile(points, [1.0, 99.0], axis=0)
    floor, ceiling = float(low[2]), float(high[2])
    eyes = float(places[:, 2].max()) if len(places) else floor
    cut = min(max(floor + HEAD, eyes + 0.3), ceiling - 0.1) if ceiling - floor > 1.0 else ceiling + 0.1
    corners = []
    for one in detection.mismatches:
        half = 0.5 * np.array([np.hypot(*one.dimensions[:2])] * 2 + [one.dimensions[2]])
        corners += [one.center - drawing.origin - half, one.center - drawing.origin + half]
    extent = np.array([low, high, *places, *corners])
    return {
        "low": extent.min(axis=0).tolist(), "high": extent.max(axis=0).tolist(),
        "floor": floor, "ceiling": ceiling, "under": floor - UNDER, "cut": cut,
    }  # fmt: skip
