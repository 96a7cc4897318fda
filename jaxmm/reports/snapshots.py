"""Pictures of single mismatches as the robot's sensor sees them, and the cameras that take them.

World frame of the prior: metres, z up. N points of a drawing.
"""

import io
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from jaxmm.reports.figures import BLACK, COLOR_ADDED, COLOR_DISPLACED, COLOR_REMOVED, SKY, UNDATED, styled
from jaxmm.reports.markdown import chance
from jaxmm.vectors import by_blocks
from jaxmm.verdicts.results import Detection, Drawing, Mismatch, Pose

FIELD_OF_VIEW = 60.0  # [deg] upright; viewers of BCF are only sure to know 45 to 60
ASPECT_RATIO = 4 / 3  # width over height
# Of boxes, and of points that surely changed.
COLORS = {"added": COLOR_ADDED, "removed": COLOR_REMOVED, "displaced": COLOR_DISPLACED, "unexplained": SKY}
EDGES = np.array([(a, b) for a in range(8) for b in range(8) if a < b and (a ^ b) in (1, 2, 4)])  # (12, 2) corners
_FACES = np.array([(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)])
_INCHES = (6.4, 4.8)
_DPI = 100
_HALF = math.tan(math.radians(FIELD_OF_VIEW / 2))  # half the picture's height at depth 1
_FILLED = 0.8  # of the picture at most, by the box: a caption and a legend need their place
_NEAR = 0.3  # [m] in front of the sensor; a point any closer would fill the picture
_DOT = {"robot": 0.075, "prior": 0.05}  # [m] across; points lie about 0.1 m apart
_DOT_RANGE = (1.5, 9.0)  # [1/72 inch] across, however far or near
_BEHIND = 0.2  # [m] that unchanged points of the prior are put behind the robot's: they tell the same, less exactly
_MOST_POINTS = 20_000  # drawn of each cloud
_SLACK = 0.05  # [m] around a box within which a ray still tells of it


class Camera(NamedTuple):
    """Where a picture is taken from."""

    position: np.ndarray  # (3,) float64 [m] world
    direction: np.ndarray  # (3,) float64 unit, of the line of sight
    up: np.ndarray  # (3,) float64 unit, square to it


def camera_at(pose: Pose, target: np.ndarray) -> Camera:
    """A camera at a sensor's place that looks at a target (3,) [m] world; ahead where it stands in the very target."""
    yaw, pitch = math.radians(pose[3]), math.radians(pose[4])
    level = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    position = np.array(pose[:3], np.float64)
    direction = np.asarray(target, np.float64) - position
    if np.linalg.norm(direction) < 1e-6:
        direction = level * math.cos(pitch) + [0.0, 0.0, math.sin(pitch)]
    direction = direction / np.linalg.norm(direction)
    upright = np.array([0.0, 0.0, 1.0])
    if abs(direction[2]) > 0.999:  # straight up or down: the top of the picture is where the sensor faces
        upright = -np.sign(direction[2]) * level
    up = upright - direction * (upright @ direction)
    return Camera(position, direction, up / np.linalg.norm(up))


def best_scan(detection: Detection, mismatch: Mismatch) -> int:
    """Number of the scan most rays of which end on a mismatch's box or pass through it; of equals the first.

    Raises:
        ValueError: the detection holds no scan.
    """
    if not detection.scans:
        raise ValueError("detection must hold at least one scan to look from, got none")
    drawing = detection.drawing
    turn = _axes(mismatch)
    center = (mismatch.center - drawing.origin) @ turn
    half = mismatch.dimensions / 2 + _SLACK
    told = []
    for number, scan in enumerate(detection.scans):
        start = (np.array(scan.pose[:3]) - drawing.origin) @ turn - center
        ray = drawing.robot[drawing.robot_scan == number] @ turn - center - start
        ray = np.where(np.abs(ray) < 1e-12, 1e-12, ray)  # one along a side never meets it
        sides = np.stack([(-half - start) / ray, (half - start) / ray])
        into, out = sides.min(axis=0).max(axis=1), sides.max(axis=0).min(axis=1)
        told.append(int(((into <= out) & (out >= 0.0) & (into <= 1.0)).sum()))
    return int(np.argmax(told))


def corners_of(mismatch: Mismatch) -> np.ndarray:
    """The corners (8, 3) float64 [m] world of a mismatch's box; the bits of a number say on which sides it lies."""
    signs = np.array([(corner >> 2 & 1, corner >> 1 & 1, corner & 1) for corner in range(8)]) - 0.5
    return mismatch.center + (signs * mismatch.dimensions) @ _axes(mismatch).T


def project(camera: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places (N, 2) of points (N, 3) in a camera's picture, -1 to 1 to the right and up, and their depths (N,) [m].

    Places of points that are not in front of the camera mean nothing.
    """
    right = np.cross(camera.direction, camera.up)

    def projected(some: np.ndarray) -> np.ndarray:
        offset = np.asarray(some, np.float64) - camera.position
        depth = offset @ camera.direction
        across = np.stack([offset @ right, offset @ camera.up], axis=-1)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.column_stack([across / (_HALF * depth[:, None] * [ASPECT_RATIO, 1.0]), depth])

    found = by_blocks(projected, np.asarray(points))
    return found[:, :2], found[:, 2]


def stepped_back(camera: Camera, corners: np.ndarray) -> tuple[Camera, float]:
    """The camera moved back along its line of sight until it has all corners (K, 3) in its picture; and how far [m]."""
    offset = corners - camera.position
    right = np.cross(camera.direction, camera.up)
    reach = np.maximum(np.abs(offset @ right) / ASPECT_RATIO, np.abs(offset @ camera.up)) / (_HALF * _FILLED)
    step = max(0.0, float((np.maximum(reach, _NEAR) - offset @ camera.direction).max()))
    return camera._replace(position=camera.position - step * camera.direction), step


def snapshot(drawing: Drawing, mismatch: Mismatch, camera: Camera, caption: str | None = None) -> bytes:
    """A PNG of 640 x 480 pixels of one mismatch or displaced element: its box, and what robot and prior have there.

    Robot points go from grey to the colour of added objects with their probability, points of the prior to that of
    removed ones. What is nearer hides what is farther, but never the box. A box that is too wide is seen from as far
    behind the camera as it needs, and nothing that lies behind the camera is drawn.
    """
    seen_from, step = stepped_back(camera, corners_of(mismatch))
    said = f"{mismatch.object_type} {mismatch.mismatch_type}, probability {chance(mismatch.probability)}"
    return _picture(drawing, [mismatch], seen_from, step + _NEAR, caption or said)


def picture_of_all(
    drawing: Drawing, boxes: Sequence[Mismatch], camera: Camera, caption: str, top: float = math.inf
) -> bytes:
    """A PNG like `snapshot`, of all boxes by a camera that stands where it shows them; no point above `top` [m]."""
    robot, prior = (points[:, 2] + drawing.origin[2] <= top for points in (drawing.robot, drawing.prior))
    below = drawing._replace(
        robot=drawing.robot[robot], robot_probability=drawing.robot_probability[robot],
        prior=drawing.prior[prior], prior_probability=drawing.prior_probability[prior],
    )  # fmt: skip
    return _picture(below, boxes, camera, _NEAR, caption)


@styled
def _picture(drawing: Drawing, boxes: Sequence[Mismatch], camera: Camera, near: float, caption: str) -> bytes:
    figure = Figure(_INCHES, dpi=_DPI)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(-1, 1), ylim=(-1, 1))
    axes.set_axis_off()
    _draw_points(axes, drawing, camera, near)
    for box in boxes:
        color = COLORS[box.mismatch_type]
        place, _ = project(camera, corners_of(box))
        for face in _FACES:
            axes.fill(*place[face].T, color=color, alpha=0.07, linewidth=0)
        for width, ink in ((4.2, "white"), (2.2, color)):  # all rims first: they must not cover other edges
            for edge in EDGES:
                axes.plot(*place[edge].T, color=ink, linewidth=width)
    _write_words(axes, caption)
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=_DPI, metadata=UNDATED[".png"])
    return file.getvalue()


def _axes(mismatch: Mismatch) -> np.ndarray:
    """(3, 3), the box's own axes as columns, world frame."""
    cosine, sine = math.cos(math.radians(mismatch.rotation)), math.sin(math.radians(mismatch.rotation))
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _draw_points(axes: Axes, drawing: Drawing, camera: Camera, near: float) -> None:
    """All points deeper than `near` [m], the farthest first; in few colours, which make a small file."""
    local = camera._replace(position=camera.position - drawing.origin)  # offsets keep their precision
    places, depths, colors, widths = [], [], [], []
    for points, probability, word, change in (
        (drawing.robot, drawing.robot_probability, "robot", "added"),
        (drawing.prior, drawing.prior_probability, "prior", "removed"),
    ):
        place, depth = project(local, points)
        shown = np.flatnonzero((depth > near) & (np.abs(place) < 1.1).all(axis=1))
        shown = shown[:: max(1, math.ceil(len(shown) / _MOST_POINTS))]
        places.append(place[shown])
        share = np.round(np.nan_to_num(probability[shown].astype(np.float64)).clip(0.0, 1.0) * 8) / 8
        depths.append(depth[shown] + (_BEHIND * (1.0 - share) if word == "prior" else 0.0))
        colors.append(_colors(depth[shown], share, word, change))
        widths.append(_DOT[word] / depth[shown])
    place, depth, color, width = (np.concatenate(parts) for parts in (places, depths, colors, widths))
    order = np.argsort(-depth, kind="stable")
    points_high = _INCHES[1] * 72 / (2 * _HALF)  # of the picture, per unit of width over depth
    size = np.clip(width[order] * points_high, *_DOT_RANGE) ** 2
    axes.scatter(*place[order].T, s=size, c=color[order], linewidths=0, antialiased=False)


def _colors(depth: np.ndarray, share: np.ndarray, word: str, change: str) -> np.ndarray:
    """(n, 3): greys that fade with depth [m], mixed with the colour of the change by its share."""
    fade = np.round(np.clip((depth - 1.0) / 10.0, 0.0, 1.0) * 8)[:, None] / 8
    dark, light = ((0.36, 0.84), (0.74, 0.92))[word == "prior"]
    grey = (dark + (light - dark) * fade) * np.ones(3)
    return grey + share[:, None] * (np.array(to_rgb(COLORS[change])) - grey)


def _write_words(axes: Axes, caption: str) -> None:
    back = {"facecolor": "white", "alpha": 0.88, "linewidth": 0, "pad": 4}
    axes.text(-0.97, 0.95, caption, va="top", fontsize=13, color=BLACK, weight="bold", bbox=back)
    for row, (word, color) in enumerate(
        (
            ("measured by the robot", (0.45,) * 3),
            ("in the model", (0.8,) * 3),
            ("measured, probably added", COLORS["added"]),
            ("in the model, probably removed", COLORS["removed"]),
        )
    ):
        left = (-0.97, -0.02)[row // 2]
        axes.text(left, -0.86 - 0.09 * (row % 2), f"   {word}", va="center", fontsize=9.5, color=BLACK, bbox=back)
        axes.plot(left + 0.012, -0.855 - 0.09 * (row % 2), "o", color=color, markersize=7, zorder=5)
