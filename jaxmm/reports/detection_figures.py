"""The figures of a detection: a floor plan, and what every direction said, as the sensor saw it.

N points of one panel. Azimuth to the left and elevation upwards, in degrees, as `jaxmm.reports.panorama` has them.
"""

import gc
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxmm.rays.evidence import BLOCKED, SUPPORT, THROUGH, UNSEEN
from jaxmm.reports.figures import BLACK, COLOR_ADDED, COLOR_HIDDEN, COLOR_REMOVED, GREY, save, styled
from jaxmm.reports.panorama import Seen, box_edges, in_view, seen_from
from jaxmm.reports.plan_figure import plan_figure
from jaxmm.verdicts.mismatch_points import mismatch_points
from jaxmm.verdicts.results import Detection

FIGURES = ("plan.png", "evidence.png", "probability.png")
MOST_SCANS = 4  # that get a panorama
MOST_POINTS = 60_000  # in a panel
SPACING = 0.1  # [m] between drawn points, about
FILL = 0.6  # of a point's own size that it is drawn with: the gaps show how surfaces slant
LARGEST = 12.0  # [pt] of a point
CROSS = 4.0  # [pt] of a cross at least: below it nobody sees that it is one
WIDE = 150.0  # [deg] from this width on, the two sides of a scan stand one above the other
PAGE, GAP, ABOVE, BELOW = 13.0, 0.75, 0.45, 1.15  # [inch] width of a figure, and free space left of and about a panel


class Mark(NamedTuple):
    """How points of one kind of evidence look; the marker tells them apart without the colour."""

    color: str
    marker: str
    prior: str  # what it means on either side
    robot: str


MARKS = {
    SUPPORT: Mark("#A6D8C7", "s", "support: the scan met it", "support: the model has it"),
    UNSEEN: Mark(GREY, "o", "unseen: no ray came back", "unseen: nothing in the model there"),
    BLOCKED: Mark(COLOR_HIDDEN, "s", "blocked: something stood before it", "blocked: before the model's surface"),
    THROUGH: Mark(COLOR_REMOVED, "x", "through: the scan looked through it", "through: behind the model's surface"),
}
BOX_COLORS = {"added": COLOR_ADDED, "removed": COLOR_REMOVED}


class Panel(NamedTuple):
    """One side of one scan."""

    scan: int
    change: str  # kind of mismatch that this side shows: "removed" on the prior's, "added" on the robot's
    seen: Seen  # N points
    evidence: np.ndarray  # (N,) uint8
    probability: np.ndarray  # (N,)
    mismatch: np.ndarray  # (N,) int32 index of the mismatch that the point shows; -1


def write_figures(folder: Path, detection: Detection, names: Sequence[str] = FIGURES) -> list[Path]:
    """Write FIGURES, or some of them, into an existing folder; returns their paths.

    The detection has one scan at least; of more than MOST_SCANS, the plan alone shows all.
    """
    drawn = dict(zip(FIGURES, (plan_figure, evidence_figure, probability_figure), strict=True))
    for name in names:
        drawn[name](detection, folder / name)
        gc.collect()  # a figure refers to itself: its points and its canvas would stay while the next is drawn
    return [folder / name for name in names]


@styled
def evidence_figure(detection: Detection, path: Path | str) -> Figure:
    """What the rays said of every point of the prior, and what the prior says of every point of the robot."""

    def draw(axes: Axes, panel: Panel, size: np.ndarray) -> None:
        handles = []
        for kind, mark in MARKS.items():
            own = panel.evidence == kind
            _scatter(axes, panel.seen, size, own, color=mark.color, marker=mark.marker)
            words = mark.prior if panel.change == "removed" else mark.robot
            look = {"color": mark.color, "marker": mark.marker, "markersize": 8, "markeredgewidth": 2, "linestyle": ""}
            handles.append(Line2D([], [], label=words, **look))
        axes.legend(
            handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2, frameon=False, borderaxespad=3.6
        )

    whose = "all scans'" if len(detection.scans) > 1 else "the scan's"  # points of the prior are of all together
    titles = {"removed": f"the model, by what {whose} rays did", "added": "the scan, by where the model's surface is"}
    return save(_panoramas(detection, titles, draw), path)


@styled
def probability_figure(detection: Detection, path: Path | str) -> Figure:
    """How probably each point of the prior is gone, and each point of the robot new, with the boxes found."""

    def draw(axes: Axes, panel: Panel, size: np.ndarray) -> None:
        every = np.ones(len(size), bool)
        _scatter(axes, panel.seen, size, every, c=panel.probability, cmap="viridis", vmin=0.0, vmax=1.0, marker="s")

    titles = {
        "removed": "the model, by the probability of being gone",
        "added": "the scan, by the probability of being new",
    }
    figure = _panoramas(detection, titles, draw)
    bar = figure.add_axes((0.35, 0.5 / figure.get_figheight(), 0.3, 0.14 / figure.get_figheight()))
    figure.colorbar(ScalarMappable(Normalize(0, 1), "viridis"), bar, orientation="horizontal", label="probability")
    bar.grid(False)
    return save(figure, path)


def panels_of(detection: Detection) -> list[Panel]:
    """Both sides of each of the first MOST_SCANS scans, the prior's before the robot's."""
    drawing, shows, panels = detection.drawing, mismatch_points(detection), []
    for scan, record in enumerate(detection.scans[:MOST_SCANS]):
        model = seen_from(record.pose, drawing.prior, drawing.origin)
        order = _from_far(model, in_view(drawing, scan, record.pose, model))
        fields = (drawing.prior_evidence, drawing.prior_probability, shows.prior)
        panels.append(_panel(scan, "removed", model, order, fields))
        own = drawing.robot_scan == scan
        robot = seen_from(record.pose, drawing.robot[own], drawing.origin)
        order = _from_far(robot, np.ones(len(robot.distance), bool))
        fields = (drawing.robot_evidence[own], drawing.robot_probability[own], shows.robot[own])
        panels.append(_panel(scan, "added", robot, order, fields))
    return panels


def _from_far(seen: Seen, shown: np.ndarray) -> np.ndarray:
    """Indices of what is shown, so that what is near comes to lie above; thinned to MOST_POINTS."""
    order = np.flatnonzero(shown)
    order = order[np.argsort(-seen.distance[order], kind="stable")]
    return order[:: max(1, -(-len(order) // MOST_POINTS))]


def _panel(scan: int, change: str, seen: Seen, order: np.ndarray, fields: tuple[np.ndarray, ...]) -> Panel:
    return Panel(scan, change, Seen(*(field[order] for field in seen)), *(field[order] for field in fields))


def _panoramas(detection: Detection, titles: dict[str, str], draw: Callable[[Axes, Panel, np.ndarray], None]) -> Figure:
    """One row of two panels for each scan; for scans all round, two rows of one."""
    panels = panels_of(detection)
    limits = [_limits([one.seen for one in panels if one.scan == scan]) for scan in range(len(panels) // 2)]
    wide = any(high[0] - low[0] > WIDE for low, high in limits)
    width = PAGE - 1.2 * GAP if wide else (PAGE - 2.4 * GAP) / 2
    heights = [width * (high[1] - low[1]) / (high[0] - low[0]) for low, high in limits for _ in range(1 + wide)]
    total = sum(heights) + len(heights) * (ABOVE + BELOW) + 0.1
    figure = Figure((PAGE, total))
    top = total
    for index, panel in enumerate(panels):
        column = 0 if wide else index % 2
        height = heights[index if wide else index // 2]
        if column == 0:
            top -= height + ABOVE + BELOW
        left = GAP + column * (width + 1.2 * GAP)
        axes = figure.add_axes((left / PAGE, (top + BELOW) / total, width / PAGE, height / total))
        low, high = limits[panel.scan]
        draw(axes, panel, np.degrees(SPACING / np.maximum(panel.seen.distance, SPACING)) * 72 * width / (high - low)[0])
        _draw_boxes(axes, detection, panel, limits[panel.scan])
        # The azimuth grows to the left, as in the picture that the sensor takes.
        axes.set(xlim=(high[0], low[0]), ylim=(low[1], high[1]), title=f"Scan {panel.scan + 1}: {titles[panel.change]}")
        axes.set(xlabel="azimuth [°], left of the heading", ylabel="elevation [°]")
    return figure


def _limits(sides: list[Seen]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (2,) [deg] of what a scan's panels show, but for a few points."""
    angles = np.concatenate([np.column_stack([one.azimuth, one.elevation]) for one in sides])
    if not len(angles):
        return np.array([-40.0, -30.0]), np.array([40.0, 30.0])
    low, high = np.percentile(angles, [0.2, 99.8], axis=0)
    return low - 2.0, high + 2.0


def _draw_boxes(axes: Axes, detection: Detection, panel: Panel, limits: tuple[np.ndarray, np.ndarray]) -> None:
    """The boxes that points of the panel show: what other scans saw may lie behind walls here."""
    low, high = limits
    for index in np.unique(panel.mismatch[panel.mismatch >= 0]):
        one = detection.mismatches[index]
        lines = box_edges(detection.scans[panel.scan].pose, one)
        for line in lines:
            axes.plot(*line.T, color="white", linewidth=3.2, zorder=4)
            axes.plot(*line.T, color=BLACK, linewidth=1.4, zorder=5)
        corners = np.concatenate(lines)
        inside = corners[((corners >= low) & (corners <= high)).all(axis=1)]
        if not len(inside):
            continue
        if np.ptp(inside[:, 0]) > 180.0:  # on both sides of the seam: its number stands on the larger one
            inside = inside[(inside[:, 0] > 0.0) == (np.median(inside[:, 0]) > 0.0)]
        note = {"boxstyle": "circle,pad=0.2", "facecolor": "white", "edgecolor": BOX_COLORS[one.mismatch_type]}
        words = {"ha": "center", "va": "center", "fontweight": "bold", "bbox": note, "zorder": 6}
        axes.text(*inside.mean(axis=0), str(index + 1), **words)


def _scatter(axes: Axes, seen: Seen, size: np.ndarray, own: np.ndarray, **look) -> None:
    """Each point as large as what it stands for [pt]; of crosses that would lie upon each other some stand for all."""
    chosen, width = np.flatnonzero(own), {"linewidths": 0}
    extent = np.clip(FILL * size[chosen], 1.0, LARGEST)
    if look["marker"] == "x" and len(chosen):
        width = {"linewidths": 0.8}
        kept = np.random.default_rng(0).random(len(chosen)) < np.square(extent / CROSS)
        chosen, extent = chosen[kept], np.maximum(extent[kept], CROSS)
    place = seen.azimuth[chosen], seen.elevation[chosen]
    axes.scatter(*place, s=extent**2, zorder=2, rasterized=True, **look, **width)
