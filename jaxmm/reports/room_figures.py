"""Figures of how the points of one room were scored: where, how surely, and how rightly.

N points of one scan, world frame, metres, z up. All figures are drawn and written as `jaxmm.reports.figures` says.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d import Axes3D, proj3d
from sklearn import metrics

from jaxmm.reports.figures import BLACK, BLUE, GREEN, GREY, PALE, VERMILLION, save, styled

THRESHOLD = 0.6  # from which a point counts as changed, in the thesis and by default in the boxes
RECALL = 0.95  # of the operating point marked in the curves
ELEVATION = 38.0  # [degrees] of the raised view into a room
LID = 0.15  # [m] below the ceiling that is left out of that view
LABEL_SPACE = (1.3, 0.75)  # [inch] kept free beside and above plus below a room for its axis labels
CELL = 0.15  # [m] of the grid that decides which points hide others: a little over the spacing of a downsampled scan


class ScoredCloud(NamedTuple):
    """One scan with what a method says of each point and what is true."""

    points: np.ndarray  # (N, 3) [m] world frame
    probability: np.ndarray  # (N,) that the point is changed; or any score, higher for changed (see `score_name`)
    label: np.ndarray  # (N,) 1 where the point is changed, else 0
    score_name: str = "probability"  # any other name (with its unit) lets the score leave [0, 1]


@styled
def probability_heatmap(cloud: ScoredCloud, path: Path | str, title: str = "", threshold: float = THRESHOLD) -> Figure:
    """The cloud seen from above one side, coloured by probability."""
    _check(cloud)
    figure = Figure((8.0, 6.0))
    draw_heatmap(figure, (0.0, 0.0, 0.87, 0.9), cloud, threshold)
    figure.suptitle(title)
    return save(figure, path)


@styled
def outcome_map(cloud: ScoredCloud, path: Path | str, title: str = "", threshold: float = THRESHOLD) -> Figure:
    """The same view, each point a true or false positive or negative at a threshold (inclusive), with the counts."""
    _check(cloud)
    figure = Figure((8.0, 6.0))
    draw_outcomes(figure, (0.0, 0.01, 1.0, 0.89), cloud, threshold)
    figure.suptitle(title)
    return save(figure, path)


@styled
def probability_histogram(
    cloud: ScoredCloud, path: Path | str, title: str = "", threshold: float = THRESHOLD
) -> Figure:
    """How many points got which probability, by what is true, on a logarithmic scale."""
    return _single(draw_histogram, cloud, path, title, threshold=threshold)


@styled
def precision_recall_curve(cloud: ScoredCloud, path: Path | str, title: str = "") -> Figure:
    """Precision over recall, its average, and the highest threshold that recalls 95 %."""
    return _single(draw_precision_recall, cloud, path, title)


@styled
def roc_curve(cloud: ScoredCloud, path: Path | str, title: str = "") -> Figure:
    """True over false positive rate, the area under it, and the highest threshold that recalls 95 %."""
    return _single(draw_roc, cloud, path, title)


@styled
def room_report(cloud: ScoredCloud, path: Path | str, title: str = "", threshold: float = THRESHOLD) -> Figure:
    """All five views of one room on one page. The title should name method, scenario and condition."""
    _check(cloud)
    figure = Figure((13.0, 9.0))
    draw_heatmap(figure, (0.0, 0.4, 0.43, 0.52), cloud, threshold)
    draw_outcomes(figure, (0.535, 0.4, 0.43, 0.52), cloud, threshold)
    for left, draw in ((0.06, draw_histogram), (0.39, draw_precision_recall), (0.72, draw_roc)):
        axes = figure.add_axes((left, 0.07, 0.265, 0.265))
        draw(axes, cloud, **({"threshold": threshold} if draw is draw_histogram else {}))
    figure.suptitle(title)
    return save(figure, path)


def _single(draw: Callable, cloud: ScoredCloud, path: Path | str, title: str, **settings: float) -> Figure:
    _check(cloud)
    figure = Figure((5.6, 4.6), layout="constrained")
    draw(figure.add_subplot(), cloud, **settings)
    figure.suptitle(title)
    return save(figure, path)


def _check(cloud: ScoredCloud) -> None:
    count = len(cloud.points)
    if count == 0 or np.shape(cloud.points) != (count, 3):
        raise ValueError(f"points must be (N >= 1, 3), got {np.shape(cloud.points)}")
    for name in ("probability", "label"):
        if np.shape(getattr(cloud, name)) != (count,):
            raise ValueError(f"{name} must be ({count},), one for each point, got {np.shape(getattr(cloud, name))}")
    if not (np.isfinite(cloud.points).all() and np.isfinite(cloud.probability).all()):
        raise ValueError("points and probability must be finite, got NaN or infinity")
    if not np.isin(cloud.label, (0, 1)).all():
        raise ValueError("label must be 0 or 1, got other values")


def _limits(cloud: ScoredCloud) -> tuple[float, float]:
    low, high = (0.0, 1.0) if cloud.score_name == "probability" else (0.0, float(np.max(cloud.probability)))
    return low, max(high, 1e-9)


def draw_heatmap(figure: Figure, place: tuple[float, ...], cloud: ScoredCloud, threshold: float) -> None:
    """The scores in colour; `place` is left, bottom, width and height as shares of the figure, colour bar apart."""
    axes, shown = _axes_of(figure, place, cloud, threshold)
    low, high = _limits(cloud)
    image = axes.scatter(
        *cloud.points[shown].T,
        c=cloud.probability[shown],
        s=marker_area(shown),
        cmap="viridis",
        vmin=low,
        vmax=high,
        linewidths=0,
        depthshade=False,
        clip_on=False,  # the room may reach beyond the square that its axes keep
        rasterized=True,
    )
    left, bottom, width, height = place
    bar = figure.add_axes((left + width, bottom + 0.18 * height, 0.016, 0.62 * height))
    figure.colorbar(image, cax=bar, label=cloud.score_name)
    bar.grid(False)
    axes.set_title(f"{cloud.score_name}, ceiling left out")


def draw_outcomes(figure: Figure, place: tuple[float, ...], cloud: ScoredCloud, threshold: float) -> None:
    """True and false positives and negatives at a threshold, counted in a legend below."""
    left, bottom, width, height = place
    legend_height = 0.35 / figure.get_figheight()
    axes, shown = _axes_of(figure, (left, bottom + legend_height, width, height - legend_height), cloud, threshold)
    predicted, true = cloud.probability >= threshold, np.asarray(cloud.label).astype(bool)
    area = marker_area(shown)
    outcomes = (
        ("true negative", ~predicted & ~true, PALE, "o", 0.8),
        ("true positive", predicted & true, GREEN, "o", 1.5),
        ("false positive", predicted & ~true, VERMILLION, "^", 2.5),
        ("false negative", ~predicted & true, BLACK, "x", 2.5),
    )
    for name, members, color, marker, scale in outcomes:
        axes.scatter(
            *cloud.points[members & shown].T,
            s=area * scale,
            c=color,
            marker=marker,
            linewidths=1.0 if marker == "x" else 0,
            depthshade=False,
            clip_on=False,
            rasterized=True,
            label=f"{name}: {members.sum():,}",
        )
    legend = figure.legend(
        handles=axes.get_legend_handles_labels()[0],
        loc="lower center",
        bbox_to_anchor=(left + width / 2, bottom),
        ncols=4,
        fontsize=9,
        columnspacing=0.8,
        handletextpad=0.1,
        frameon=False,
    )
    for handle in legend.legend_handles:
        handle.set_sizes([40.0])
    axes.set_title(f"changed where {cloud.score_name} ≥ {threshold:g}")


def draw_histogram(axes: Axes, cloud: ScoredCloud, threshold: float) -> None:
    """Points by score, changed and unchanged ones, on a logarithmic scale."""
    edges = np.linspace(*_limits(cloud), 41)
    for value, name, color in ((0, "unchanged", GREY), (1, "changed", VERMILLION)):
        scores = np.clip(cloud.probability[cloud.label == value], edges[0], edges[-1])
        counts, name = np.histogram(scores, edges)[0], f"{name}: {len(scores):,}"
        axes.stairs(counts, edges, baseline=0.5, fill=True, color=color, alpha=0.55, label=name)
        axes.stairs(counts, edges, baseline=0.5, color=color, linewidth=1.4)
    axes.axvline(threshold, color=BLACK, linestyle="--", linewidth=1.2, label=f"threshold {threshold:g}")
    axes.set(yscale="log", xlabel=cloud.score_name, ylabel="points", title="scores by true class")
    axes.set_ylim(0.7, 40.0 * axes.get_ylim()[1])  # room for the legend above the bars
    axes.legend(loc="upper center")


def draw_precision_recall(axes: Axes, cloud: ScoredCloud) -> None:
    """The curve with its average precision, and the operating point of 95 % recall."""
    axes.set(xlabel="recall", ylabel="precision", title="precision and recall", xlim=(-0.02, 1.02), ylim=(-0.02, 1.04))
    if _one_class(axes, cloud):
        return
    precision, recall, threshold = metrics.precision_recall_curve(cloud.label, cloud.probability)
    average = metrics.average_precision_score(cloud.label, cloud.probability)
    axes.plot(recall, precision, color=BLUE, drawstyle="steps-post", label=f"average precision {average:.4f}")
    share = np.mean(cloud.label)
    axes.axhline(share, color=GREY, linestyle=":", linewidth=1.2, label=f"chance {share:.3f}")
    at = np.flatnonzero(recall[:-1] >= RECALL)[-1]  # thresholds ascend
    text = f"{RECALL:.0%} recall: precision {precision[at]:.4f}\n(threshold {threshold[at]:.3g})"
    axes.plot(recall[at], precision[at], "o", color=VERMILLION, markersize=8, label=text)
    axes.legend(loc="best")


def draw_roc(axes: Axes, cloud: ScoredCloud) -> None:
    """The curve with the area under it, and the operating point of 95 % recall."""
    axes.set(xlabel="false positive rate", ylabel="true positive rate", title="receiver operating characteristic")
    axes.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.04))
    if _one_class(axes, cloud):
        return
    false_rate, true_rate, _ = metrics.roc_curve(cloud.label, cloud.probability, drop_intermediate=False)
    area = metrics.auc(false_rate, true_rate)
    axes.plot(false_rate, true_rate, color=BLUE, label=f"area {area:.4f}")
    axes.plot([0, 1], [0, 1], color=GREY, linestyle=":", linewidth=1.2, label="chance")
    at = np.flatnonzero(true_rate >= RECALL)[0]  # thresholds descend
    axes.plot(
        false_rate[at],
        true_rate[at],
        "o",
        color=VERMILLION,
        markersize=8,
        label=f"{RECALL:.0%} recall: false positives {false_rate[at]:.2%}",
    )
    axes.legend(loc="best")


def _one_class(axes: Axes, cloud: ScoredCloud) -> bool:
    """Say so where there is no curve: with no changed points, or with nothing else."""
    if 0 < np.sum(cloud.label) < len(cloud.label):
        return False
    missing = "no point is changed" if np.sum(cloud.label) == 0 else "every point is changed"
    axes.text(0.5, 0.5, f"{missing}: no curve", ha="center", va="center", transform=axes.transAxes)
    return True


def _axes_of(
    figure: Figure, place: tuple[float, ...], cloud: ScoredCloud, threshold: float
) -> tuple[Axes3D, np.ndarray]:
    return room_axes(figure, place, cloud.points, (cloud.probability >= threshold) | (cloud.label == 1))


def room_axes(
    figure: Figure,
    place: tuple[float, ...],
    points: np.ndarray,
    notable: np.ndarray | None = None,
    azimuth: float | None = None,
) -> tuple[Axes3D, np.ndarray]:
    """Axes that look down into a room, and which of its points to draw in them.

    Args:
        figure: to add the axes to.
        place: left, bottom, width and height as shares of the figure.
        points: (N, 3) [m]; they set the limits.
        notable: (N,) bool, points that must be seen, even at the ceiling; None: none.
        azimuth: [degrees] from where to look; None: where most points are seen.

    Returns:
        The axes, and (N,) bool: all but a plain ceiling, which would be a lid on the room.
    """
    points = np.asarray(points, dtype=np.float64)
    notable = np.zeros(len(points), bool) if notable is None else notable
    shown = notable | (points[:, 2] < np.percentile(points[:, 2], 99) - LID)
    axes = figure.add_axes(place, projection="3d", proj_type="ortho", computed_zorder=False)
    azimuth = best_azimuth(points[shown], notable[shown]) if azimuth is None else azimuth
    axes.view_init(elev=ELEVATION, azim=azimuth)
    size = np.maximum(np.ptp(points, axis=0), 1e-3)
    for name, low, span in zip("xyz", points.min(axis=0), size, strict=True):
        getattr(axes, f"set_{name}lim")(low, low + span)
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(5 if name != "z" else 3))
        getattr(axes, f"{name}axis").set_pane_color("#FAFAFA")
    axes.set_xlabel("x [m]", labelpad=2)
    axes.set_ylabel("y [m]", labelpad=2)
    axes.set_zlabel("z [m]", labelpad=-2)
    axes.tick_params(labelsize=9, pad=0)
    _fill(axes, size, place)
    return axes, shown


def _fill(axes: Axes3D, size: np.ndarray, place: tuple[float, ...]) -> None:
    """Zoom so that the room's outline (edges `size` [m]) takes what its place can spare beside the axis labels."""
    axes.set_box_aspect(tuple(size))  # a tuple: an array would be scaled in place
    axes.apply_aspect()
    corners = np.array(np.meshgrid(axes.get_xlim(), axes.get_ylim(), axes.get_zlim())).reshape(3, -1)
    x, y, _ = proj3d.proj_transform(*corners, axes.get_proj())
    drawn = np.ptp(axes.transData.transform(np.column_stack([x, y])), axis=0)
    available = np.array(place[2:]) * axes.figure.bbox.size - np.array(LABEL_SPACE) * axes.figure.dpi
    axes.set_box_aspect(tuple(size), zoom=float(np.min(available / drawn)))


def best_azimuth(points: np.ndarray, notable: np.ndarray) -> float:
    """Side [degrees] from which most points are seen, a notable one (N,) counting like twenty others.

    A scan shows the faces turned to its sensor, so this tends to be the sensor's side. What hides what is decided on a
    grid of the picture plane, by depth.
    """
    candidates = np.arange(7.5, 360.0, 15.0)  # never straight along an axis: that would hide a dimension
    weight = np.where(notable, 20.0, 1.0)
    tilt = np.radians(ELEVATION)
    seen = []
    for azimuth in np.radians(candidates):
        toward = points[:, 0] * np.cos(azimuth) + points[:, 1] * np.sin(azimuth)
        across = points[:, 1] * np.cos(azimuth) - points[:, 0] * np.sin(azimuth)
        depth = toward * np.cos(tilt) + points[:, 2] * np.sin(tilt)  # toward the eye
        cell = np.floor(np.column_stack([across, points[:, 2] * np.cos(tilt) - toward * np.sin(tilt)]) / CELL)
        _, index = np.unique(cell, axis=0, return_inverse=True)
        nearest = np.full(index.max() + 1, -np.inf)
        np.maximum.at(nearest, index.ravel(), depth)
        seen.append(weight[depth > nearest[index.ravel()] - 2 * CELL].sum())
    return float(candidates[np.argmax(np.round(seen, 6))])


def marker_area(shown: np.ndarray) -> float:
    """Area [points^2] of a marker: dense clouds get finer ones."""
    return float(np.clip(30_000 / max(shown.sum(), 1), 1.5, 8.0))
