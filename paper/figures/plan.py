"""Panels that look straight down: points that a method calls changed, the boxes around them, and the true ones.

World frame: metres, z up. N points of one scan.
"""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Polygon

from jaxmm.learning.box_match import footprint
from jaxmm.learning.boxes import Box
from jaxmm.reports.figures import BLACK, COLOR_ADDED, COLOR_REMOVED, GREEN, PALE

TRUE, TRUE_EDGE = "#F0E442", "#8A7F00"  # of what really changed; told from the outlines by lightness alone
REMOVED_LINE = (0, (4, 1.5))  # dashes, so that colour is not needed
OUTLINE = {"added": COLOR_ADDED, "removed": COLOR_REMOVED}


def draw_room(axes: Axes, points: np.ndarray, changed: np.ndarray, title: str) -> None:
    """The scan in grey, (N, 3), and what a method calls changed, (N,) bool, in green; edges in metres."""
    axes.scatter(*points[~changed, :2].T, s=1.0, c=PALE, linewidths=0, rasterized=True)
    axes.scatter(*points[changed, :2].T, s=2.5, c=GREEN, linewidths=0, rasterized=True, zorder=3)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.set_title(title, fontsize=10)
    axes.grid(False)


def draw_true(axes: Axes, boxes: Sequence[Box]) -> None:
    """What really changed."""
    for box in boxes:
        outline = footprint(box, np.zeros(2))
        axes.add_patch(Polygon(outline, facecolor=TRUE, edgecolor=TRUE_EDGE, linewidth=0.8, zorder=1))


def draw_found(axes: Axes, boxes: Sequence[Box], change: str) -> None:
    """Boxes that were found."""
    style = "-" if change == "added" else REMOVED_LINE
    for box in boxes:
        outline = footprint(box, np.zeros(2))
        axes.add_patch(
            Polygon(outline, fill=False, edgecolor=OUTLINE[change], linewidth=2.0, linestyle=style, zorder=4)
        )


def draw_sensor(axes: Axes, position: np.ndarray) -> None:
    """Where the robot stands, (3,)."""
    axes.plot(*position[:2], marker="*", color=BLACK, markersize=9, zorder=5)


def entries() -> list[Patch | Line2D]:
    """What the legend says."""
    return [
        Line2D([], [], marker="o", linestyle="", color=GREEN, markersize=5, label="points called changed"),
        Patch(facecolor=TRUE, edgecolor=TRUE_EDGE, label="what really changed"),
        Patch(fill=False, edgecolor=OUTLINE["added"], linewidth=2, label="box: added"),
        Patch(fill=False, edgecolor=OUTLINE["removed"], linewidth=2, linestyle=REMOVED_LINE, label="box: removed"),
        Line2D([], [], marker="*", linestyle="", color=BLACK, markersize=9, label="sensor"),
    ]
