"""The floor plan of a detection: what stands in the prior, where the robot stood, and what is not as it should be.

Positions are offsets from the drawing's origin [m] until they are drawn; N points.
"""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch, PathPatch, Polygon, Wedge
from matplotlib.path import Path as Shape
from matplotlib.patheffects import withStroke

from jaxmm.reports.deviation_words import displaced
from jaxmm.reports.figures import (
    BLACK,
    COLOR_ADDED,
    COLOR_DISPLACED,
    COLOR_HIDDEN,
    COLOR_REMOVED,
    GREEN,
    GREY,
    ORANGE,
    PALE,
    save,
    styled,
)
from jaxmm.reports.markdown import percent, told_size
from jaxmm.reports.plan_cut import cut_surfaces
from jaxmm.reports.plan_levels import CUT, Level, base_of, footprint, level_of_mismatches, levels_of, region_of
from jaxmm.reports.plan_offsets import arrows_of, draw_offsets, offset_entries, with_room
from jaxmm.verdicts.results import Detection, Mismatch, Pose
from jaxmm.verdicts.verdicts import DISPLACED, OCCLUDED, PRESENT, REMOVED, UNSCANNED

SLICE = 0.3  # [m] to both sides of the cut: points within it are drawn
MOST_LEVELS, MOST_LISTED = 4, 14
LEFT, PLAN_WIDTH, LEGEND_WIDTH, ROOM_FOR_LABELS = 0.75, 7.5, 4.2, 1.0  # [inch]
MOST_SIGNS, LEGEND_LINE = 12, 0.2  # entries that explain the plan, and height of one [inch]
NAME_SPANS = (-15.0, 0.0, 15.0)  # [pt] a name is wide: from its middle, places that it takes
NAMES_AT = (  # [pt] from a sensor to the middle of its name, in turn
    *((x, y) for y in (-22.0, 22.0, 0.0) for x in (0.0, 38.0, -38.0) if x or y),
    *((x, y) for y in (-44.0, 44.0) for x in (0.0, 38.0, -38.0, 76.0, -76.0)),
)
CLEAR = 16.0  # [pt] between a name and a sensor or another name
APART = 26.0  # [pt] between the middles of numbers, and from such places


class Look(NamedTuple):
    """How the cut of an element is filled; the hatch tells the verdict without the colour."""

    face: str
    edge: str
    hatch: str


LOOKS = {
    PRESENT: Look("#BFE3D6", GREEN, ""),
    DISPLACED: Look("#FBEBC8", COLOR_DISPLACED, "\\\\\\\\"),
    REMOVED: Look("#FBE0D0", COLOR_REMOVED, "xxxxx"),
    OCCLUDED: Look("#F5E4EE", COLOR_HIDDEN, "//////"),
    UNSCANNED: Look("white", GREY, "....."),
}
NO_VERDICT = Look("#EDEFF1", PALE, "")
CHANGE_LOOKS = {"added": Look("#D6E8F3", COLOR_ADDED, "++"), "removed": LOOKS[REMOVED]}
CHANGE_LINES = {"added": "-", "removed": "--"}


@styled
def plan_figure(detection: Detection, path: Path | str) -> Figure:
    """Write the plan of every storey that was scanned (up to four), cut at CUT above its floor."""
    return save(draw_plan(detection), path)


@styled
def draw_plan(detection: Detection) -> Figure:
    """The same, only drawn."""
    levels = levels_of(detection)[:MOST_LEVELS]
    worst, bounds, arrows = displaced(detection.elements), [], []
    for level in levels:
        limits = region_of(detection, level)
        arrows.append(arrows_of(detection.drawing, worst, level, limits))
        bounds.append(with_room(limits, arrows[-1]))
    sizes = [_inches(high - low) for low, high in bounds]
    widest = LEFT + max(width for width, _ in sizes)
    found = [*_mismatch_entries(detection.mismatches), *offset_entries(worst)]
    lines = MOST_SIGNS + sum(entry.get_label().count("\n") + 1 for entry in found)
    tall = sum(height + ROOM_FOR_LABELS for _, height in sizes)
    total = widest + LEGEND_WIDTH, max(tall, ROOM_FOR_LABELS + LEGEND_LINE * lines)
    figure = Figure(total)
    nearest, entries, top = level_of_mismatches(detection, levels), {}, total[1]
    for index, (level, limits, (width, height)) in enumerate(zip(levels, bounds, sizes, strict=True)):
        top -= height + ROOM_FOR_LABELS
        axes = figure.add_axes((LEFT / total[0], (top + 0.55) / total[1], width / total[0], height / total[1]))
        shown = [(n, one) for n, one in enumerate(detection.mismatches, 1) if nearest[n - 1] == index]
        told = _draw_level(axes, detection, level, limits, shown)
        told += draw_offsets(axes, detection.drawing, arrows[index])
        entries |= {entry.get_label(): entry for entry in told}
    handles = [*entries.values(), *found]
    place = ((widest + 0.15) / total[0], 1.0 - 0.5 / total[1])
    legend = figure.legend(handles=handles, loc="upper left", bbox_to_anchor=place, frameon=False)
    for text in legend.get_texts():
        text.set_parse_math(False)  # names of files hold dollars
    return figure


def _inches(size: np.ndarray) -> tuple[float, float]:
    """Width and height on paper of a plan of some size [m], in one scale."""
    scale = min(PLAN_WIDTH / size[0], 8.5 / size[1])
    return max(size[0] * scale, 2.5), max(size[1] * scale, 2.5)


def _draw_level(axes: Axes, detection: Detection, level: Level, limits: tuple, shown: list) -> list:
    """Draw one storey; returns what its legend needs."""
    drawing = detection.drawing
    base = base_of(drawing)
    shift = (drawing.origin - base)[:2]
    entries = list(_draw_surfaces(axes, detection, level, limits, shift))
    entries += _draw_slice(axes, detection, level, shift)
    entries += _draw_next_views(axes, detection, level, base)
    low, high = limits
    axes.set(xlim=(low[0] + shift[0], high[0] + shift[0]), ylim=(low[1] + shift[1], high[1] + shift[1]), aspect="equal")
    axes.apply_aspect()
    entries += _draw_sensors(axes, detection, level, base)
    sensors = np.array([detection.scans[n].pose[:2] for n in level.scans]).reshape(-1, 2) - base[:2]
    taken = _name_sensors(axes, sensors, [n + 1 for n in level.scans])
    entries += _draw_unexplained(axes, detection, level, base)
    for index, one in shown:
        _draw_mismatch(axes, index, one, base, sensors, taken)
    for name, value in zip("xy", base, strict=False):
        axes.set(**{f"{name}label": f"{name} [m]" if not value else f"{name} - {value:.0f} [m]"})
    height = level.floor + CUT + drawing.origin[2]
    axes.set_title(f"Cut at z = {height:.2f} m, {CUT} m above the lowest that was measured", loc="left")
    return entries


def _draw_surfaces(axes: Axes, detection: Detection, level: Level, limits: tuple, shift: np.ndarray) -> Iterator[Patch]:
    drawing = detection.drawing
    if drawing.faces is None:
        return
    corners = drawing.vertices[:, :2][drawing.faces]
    near = ((corners.min(axis=1) < limits[1]) & (corners.max(axis=1) > limits[0])).all(axis=1)
    near = np.isin(drawing.face_element, drawing.face_element[near])  # an outline closes beyond the edge of the plan
    rows = drawing.rows()
    verdict = {rows[one.key]: one.verdict for one in detection.elements if one.key in rows}
    drawn = set()
    height = level.floor + CUT
    outlines = cut_surfaces(drawing.vertices, drawing.faces[near], drawing.face_element[near], height)
    for element, lines in itertools.groupby(outlines, key=lambda one: one.element):
        name = verdict.get(element)
        look = LOOKS.get(name, NO_VERDICT)
        lines = list(lines)
        shapes = [Shape(one.points + shift, closed=True) for one in lines if one.closed]
        if shapes:  # together, so that what is hollow stays empty
            axes.add_patch(_filled(PathPatch(Shape.make_compound_path(*shapes), zorder=2 if name else 1), look))
        for one in lines:
            if not one.closed:
                axes.plot(*(one.points + shift).T, color=look.edge, linewidth=1.0, zorder=2)
        drawn.add(name)
    for name in (*LOOKS, None):
        if name in drawn:
            yield _filled(Patch(label=name or "other parts of the model"), LOOKS.get(name, NO_VERDICT))


def _filled(patch: Patch, look: Look) -> Patch:
    patch.set(facecolor=look.face, edgecolor=look.edge, hatch=look.hatch, linewidth=0.9)
    patch.set_hatch_linewidth(0.6)
    return patch


def _draw_slice(axes: Axes, detection: Detection, level: Level, shift: np.ndarray) -> list[Line2D]:
    drawing = detection.drawing
    sides = [(drawing.robot[np.isin(drawing.robot_scan, level.scans)], BLACK, 3.0, "measured by the robot")]
    if drawing.faces is None:
        sides.insert(0, (drawing.prior, ORANGE, 4.5, "prior's points"))
    entries = []
    for points, color, size, label in sides:
        points = points[np.abs(points[:, 2] - level.floor - CUT) < SLICE]
        look = {"color": color, "marker": ".", "linestyle": "", "markeredgewidth": 0}
        axes.plot(*(points[:, :2] + shift).T, markersize=size, rasterized=True, zorder=6, **look)
        entries.append(Line2D([], [], markersize=8, label=f"{label}, near the cut", **look))
    return entries


def _draw_sensors(axes: Axes, detection: Detection, level: Level, base: np.ndarray) -> list:
    entries = []
    for n in level.scans:
        x, y, _, yaw, _ = detection.scans[n].pose
        x, y = x - base[0], y - base[1]
        corners = detection.drawing.fields_of_view[n] if n < len(detection.drawing.fields_of_view) else []
        if len(corners):
            side = (np.degrees(np.arctan2(corners[:, 1], corners[:, 0])) - yaw + 180.0) % 360.0 - 180.0
            ends = yaw + side.min(), yaw + side.max()
            look = {"facecolor": BLACK, "alpha": 0.07, "linewidth": 0}
            axes.add_patch(Wedge((x, y), _reach(detection, n), *ends, zorder=0, **look))
            entries.append(Patch(label="field of view", **look | {"alpha": 0.12}))
        _mark_pose(axes, (x, y), yaw, BLACK)
        entries.append(
            Line2D([], [], color=BLACK, marker="o", markersize=8, linestyle="", label="sensor and its heading")
        )
    return entries


def _name_sensors(axes: Axes, sensors: np.ndarray, numbers: list[int]) -> list[np.ndarray]:
    """Each scan's name by its sensor (S, 2), clear of other sensors and names where it can be; 3 S places (2,) [pt]."""
    marks = [_on_paper(axes, place) for place in sensors]
    ways = [np.array([[x + part, y] for part in NAME_SPANS]) for x, y in NAMES_AT]
    low, high = axes.bbox.get_points() * 72.0 / axes.figure.dpi
    taken: list[np.ndarray] = []
    for place, mark, number in zip(sensors, marks, numbers, strict=True):
        within = [way for way in ways if (mark + way >= low).all() and (mark + way <= high).all()] or ways[:1]
        way = _first_clear(within, mark, [*marks, *taken], CLEAR)
        look = {"textcoords": "offset points", "ha": "center", "va": "center", "zorder": 8}
        if way is not ways[0]:
            look["arrowprops"] = {"arrowstyle": "-", "color": GREY, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 4}
        name = axes.annotate(f"scan {number}", place, way.mean(axis=0), **look)
        name.set_path_effects([withStroke(linewidth=4, foreground="white")])  # it may stand on a wall
        taken += list(mark + way)
    return taken


def _reach(detection: Detection, scan: int) -> float:
    """How far a scan saw, level [m], but for a few points."""
    drawing = detection.drawing
    own = drawing.robot[drawing.robot_scan == scan, :2] + (drawing.origin[:2] - detection.scans[scan].pose[:2])
    return float(np.percentile(np.hypot(*own.T), 99.5)) if len(own) else 1.0


def _draw_next_views(axes: Axes, detection: Detection, level: Level, base: np.ndarray) -> list:
    views: set[Pose] = {one.next_view for one in detection.elements if one.next_view is not None}
    height = level.floor + detection.drawing.origin[2]
    near = sorted(pose for pose in views if 0.0 <= pose[2] - height < 2 * CUT)
    for x, y, _, yaw, _ in near:
        _mark_pose(axes, (x - base[0], y - base[1]), yaw, LOOKS[OCCLUDED].edge, "white")
    look = {"color": LOOKS[OCCLUDED].edge, "markerfacecolor": "white", "marker": "o", "markersize": 8, "linestyle": ""}
    return [Line2D([], [], label="viewpoint proposed next", **look)] if near else []


def _draw_unexplained(axes: Axes, detection: Detection, level: Level, base: np.ndarray) -> list[Patch]:
    """What else is not in the model, where it stands below or at the cut of the storey."""
    floor, entries = level.floor + detection.drawing.origin[2], []
    look = {"facecolor": "none", "edgecolor": COLOR_ADDED, "linestyle": ":", "linewidth": 1.4}
    for one in detection.unexplained:
        low, high = (one.center[2] + way * one.dimensions[2] / 2.0 - floor for way in (-1.0, 1.0))
        if high > 0.0 and low < 2.0 * CUT:
            axes.add_patch(Polygon(footprint(one, base), zorder=4, **look))
            entries = [Patch(label="else not in the model", **look)]
    return entries


def _mark_pose(axes: Axes, place: tuple[float, float], yaw: float, color: str, face: str | None = None) -> None:
    ahead = (26 * np.cos(np.radians(yaw)), 26 * np.sin(np.radians(yaw)))
    arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", place, ahead, textcoords="offset points", arrowprops=arrow | {"arrowstyle": "<|-"}, zorder=6)
    axes.plot(*place, "o", color=color, markerfacecolor=face or color, markersize=8, zorder=7)


def _draw_mismatch(
    axes: Axes, index: int, one: Mismatch, base: np.ndarray, sensors: np.ndarray, taken: list[np.ndarray]
) -> None:
    """One box; its number is on the side away from the nearest of the sensors (S, 2), or elsewhere if that is taken.

    `taken` are places of names and numbers [pt] on paper; that of this one is put to them.
    """
    corners = footprint(one, base)
    if not np.isfinite(corners).all():
        return
    color = CHANGE_LOOKS[one.mismatch_type].edge
    if one.shape == "round":
        patch = Ellipse(corners.mean(axis=0), *one.dimensions[:2], angle=one.rotation, zorder=5)
    else:
        patch = Polygon(corners, zorder=5)
    axes.add_patch(_outlined(patch, one))
    note = {"boxstyle": "circle,pad=0.25", "facecolor": "white", "edgecolor": color, "linewidth": 1.6}
    lead = {"arrowstyle": "-", "color": color, "linewidth": 1.2}
    middle = corners.mean(axis=0)
    away = middle - min(sensors, key=lambda place: np.linalg.norm(place - middle), default=middle)
    words = {"ha": "center", "va": "center", "fontweight": "bold", "bbox": note, "arrowprops": lead, "zorder": 9}
    offset = _free_offset(_on_paper(axes, middle), np.where(away < 0.0, -1.0, 1.0), taken)
    axes.annotate(str(index), middle, offset, textcoords="offset points", **words)


def _on_paper(axes: Axes, place: np.ndarray) -> np.ndarray:
    """(2,) [pt] of a place on the plan."""
    return axes.transData.transform(place) * 72.0 / axes.figure.dpi


def _free_offset(place: np.ndarray, wanted: np.ndarray, taken: list[np.ndarray]) -> np.ndarray:
    """From a place (2,) [pt] to where a number has room, the way that is wanted if it may be; it is then taken."""
    turns = np.radians([0, 45, -45, 90, -90, 135, -135, 180])
    first = np.arctan2(wanted[1], wanted[0])
    ways = [
        reach * np.array([np.cos(first + turn), np.sin(first + turn)]) for reach in (34.0, 56.0, 78.0) for turn in turns
    ]
    offset = _first_clear(ways, place, taken, APART)
    taken.append(place + offset)
    return offset


def _first_clear(ways: list[np.ndarray], place: np.ndarray, taken: list[np.ndarray], apart: float) -> np.ndarray:
    """The first of some ways from a place (2,) [pt] that ends so far [pt] from all that is taken; else the farthest.

    A way (2,) is to one place, or (K, 2) to several, as of what is wide; each of `taken` is (2,).
    """
    if not taken:
        return ways[0]
    room = [np.linalg.norm(np.atleast_2d(place + way)[:, None] - np.array(taken), axis=2).min() for way in ways]
    return ways[next((number for number, one in enumerate(room) if one >= apart), int(np.argmax(room)))]


def _outlined(patch: Patch, one: Mismatch) -> Patch:
    _filled(patch, CHANGE_LOOKS[one.mismatch_type]).set(linewidth=2.0, linestyle=CHANGE_LINES[one.mismatch_type])
    return patch


def _mismatch_entries(mismatches: tuple[Mismatch, ...]) -> list[Patch]:
    entries = []
    for index, one in enumerate(mismatches[:MOST_LISTED], 1):
        size = " x ".join(told_size(edge, seen) for edge, seen in zip(one.dimensions[:2], one.measured, strict=False))
        label = f"{index}: {one.object_type} {one.mismatch_type}, {size} m, {percent(one.probability)}"
        entries.append(_outlined(Patch(label=label), one))
    if len(mismatches) > MOST_LISTED:
        label = f"and {len(mismatches) - MOST_LISTED} more: see mismatches.csv"
        entries.append(Patch(facecolor="none", label=label))
    return entries
