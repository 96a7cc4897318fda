"""plan_N.png: a storey from above, each element in the colour of the week in which it was first seen to stand."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Shape

from jaxmm.reports.figures import COLOR_DISPLACED, COLOR_REMOVED, GREY, PALE, save, styled
from jaxmm.reports.markdown import printable
from jaxmm.weeks.colours import colour_of
from jaxmm.weeks.history import ABSENT, GONE, OFF, UNKNOWN, Followed, Progress
from jaxmm.weeks.outlines import Outlines, Rings, Storey
from jaxmm.weeks.shares import once_each

MOST_LISTED = 24  # weeks in the legend; of more, some
AROUND = 1.0  # [m] left free
PLAN_WIDTH, PLAN_HEIGHT, LEGEND, MARGIN = 8.0, 8.0, 3.4, 0.75  # [inch]
OFF_WIDTH = 2.2  # [pt] of the edge of what is displaced
LOOKS = {  # of what does not stand, or stands off its place: face, edge, hatch, line
    GONE: ("#FBE0D0", COLOR_REMOVED, "xxxxx", "-"),
    ABSENT: ("white", GREY, "", "--"),
    UNKNOWN: ("#F1F1F1", PALE, ".....", "-"),
}
LABELS = {GONE: "removed", ABSENT: "not built: its place was seen empty", UNKNOWN: "not seen yet"}


def plan_name(number: int) -> str:
    """The file of a storey, by its number from 0 on."""
    return f"plan_{number + 1}.png"


def write_plans(folder: Path, progress: Progress, outlines: Outlines) -> list[str]:
    """Write a plan for each storey of which places are known; returns the names of the files.

    Raises:
        OSError: one cannot be written.
    """
    names = []
    for number, storey in enumerate(outlines.storeys):
        names.append(plan_name(number))
        draw_plan(progress, outlines, storey, folder / names[-1])
    return names


@styled
def draw_plan(progress: Progress, outlines: Outlines, storey: Storey, path: Path) -> Figure:
    """Draw one storey, at the end of the last week."""
    low, high = outlines.bounds
    low, high = low - AROUND, high + AROUND
    scale = min(PLAN_WIDTH / (high - low)[0], PLAN_HEIGHT / (high - low)[1])
    width, height = (max(size * scale, 2.5) for size in high - low)
    total = MARGIN + width + LEGEND, max(height + 1.2, 4.5)
    figure = Figure(total)
    axes = figure.add_axes((
        MARGIN / total[0], (total[1] - 0.6 - height) / total[1], width / total[0], height / total[1],
    ))  # fmt: skip
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    for ring in storey.others:
        axes.plot(*ring.T, color=PALE, linewidth=0.8, zorder=1)
    by_key = {one.key: one for one in progress.elements}
    counted = {one.key for one in once_each(progress.elements)}  # as in shares and on the page
    count: dict[object, int] = {}
    for key, rings in storey.elements.items():
        one = by_key[key]
        if one.moments[-1].in_model:
            kinds = {_draw(axes, one, rings, len(progress.weeks)), *([OFF] if one.state == OFF else [])}
            count |= {kind: count.get(kind, 0) + 1 for kind in kinds if key in counted}
    for name, value in zip("xy", outlines.base, strict=True):
        axes.set(**{f"{name}label": f"{name} [m]" if not value else f"{name} - {value:.0f} [m]"})
    title = axes.set_title(f"{printable(storey.name)}, on {progress.labels[-1]}", loc="left")
    title.set_parse_math(False)  # names of storeys hold dollars
    place = ((MARGIN + width + 0.15) / total[0], 1.0 - 0.5 / total[1])
    entries = _entries(progress, count)
    figure.legend(
        handles=entries,
        loc="upper left",
        bbox_to_anchor=place,
        frameon=False,
        title="first seen to stand",
        alignment="left",
    )
    return save(figure, path)


def _draw(axes: Axes, one: Followed, rings: Rings, weeks: int) -> object:
    """Draw an element; returns what it counts for in the legend: its week, or its state where it does not stand."""
    kind = one.state if one.state in LOOKS else one.first_seen
    shapes = [Shape(ring, closed=False) for ring in rings]
    patch = PathPatch(Shape.make_compound_path(*shapes), zorder=2)
    axes.add_patch(_filled(patch, kind, weeks, one.state == OFF))
    return kind


def _filled(patch: Patch, kind: object, weeks: int, is_off: bool) -> Patch:
    if kind in LOOKS:
        face, edge, hatch, line = LOOKS[kind]
        patch.set(facecolor=face, edgecolor=edge, hatch=hatch, linestyle=line, linewidth=0.9)
    else:
        patch.set(facecolor=colour_of(kind, weeks), edgecolor="#303030", linewidth=0.6)
    if is_off:
        patch.set(edgecolor=COLOR_DISPLACED, linewidth=OFF_WIDTH)
    patch.set_hatch_linewidth(0.6)
    return patch


def _entries(progress: Progress, count: dict[object, int]) -> list[Patch]:
    weeks = len(progress.weeks)
    shown = np.unique(np.linspace(0, weeks - 1, min(weeks, MOST_LISTED)).round().astype(int))
    entries = [
        _filled(Patch(label=f"{progress.labels[week]}: {count.get(week, 0)}"), week, weeks, False)
        for week in shown.tolist()
    ]
    entries += [_filled(Patch(label=f"{LABELS[s]}: {count[s]}"), s, weeks, False) for s in LOOKS if count.get(s)]
    if count.get(OFF):
        label = f"displaced: {count[OFF]}, its colour as above"
        entries.append(Patch(facecolor="white", edgecolor=COLOR_DISPLACED, linewidth=OFF_WIDTH, label=label))
    return entries
