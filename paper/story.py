"""The story in one picture: the pipeline, and what one scan can say of a prior.   python paper/story.py OUT.png

The plan is computed, not painted: its rays are cast at the prior and at reality, and coloured by what they find.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch, Polygon, Rectangle

from jaxmm.reports.figures import BLACK, COLOR_ADDED, COLOR_HIDDEN, COLOR_REMOVED, GREEN, GREY, PALE, save, styled

WIDTH, HEIGHT = 12.8, 7.5  # [inch]; every position of the page below is in inches too
COLUMN, BOX_WIDTH, BOX_HEIGHT = 1.57, 1.36, 0.86
TOP_ROW, SECOND_ROW = 6.0, 4.62
SCANNER_FILL, LEARNER_FILL, INPUT_FILL = "#E3EFF8", "#E2F3EC", "#F1F1F1"


class Block(NamedTuple):
    """A rectangle of the plan, axis-aligned [m]."""

    x: float
    y: float
    width: float
    depth: float


ROOM = Block(0.0, 0.0, 10.4, 5.2)
SENSOR, HEADING, FIELD_OF_VIEW = np.array([0.9, 2.3]), 4.0, 80.0  # [m], [degrees]
REMOVED = Block(5.2, 3.9, 0.55, 0.55)
ADDED = Block(5.6, 1.0, 0.55, 0.55)
TABLE = Block(3.3, 2.35, 0.75, 0.75)
HIDDEN = Block(7.7, 2.75, 0.5, 0.5)
PRESENT = Block(7.7, 1.55, 0.5, 0.5)
PARTITION = Block(7.3, 4.0, 0.15, 1.2)
PRIOR = (REMOVED, HIDDEN, PRESENT, PARTITION)
REAL = (ADDED, TABLE, HIDDEN, PRESENT, PARTITION)
EVIDENCE = {"through": COLOR_REMOVED, "support": GREEN, "blocked": COLOR_HIDDEN}


def main(path: Path) -> None:
    save(draw(), path)


@styled
def draw() -> Figure:
    """The whole page."""
    figure = Figure((WIDTH, HEIGHT))
    page = figure.add_axes((0, 0, 1, 1))
    page.set(xlim=(0, WIDTH), ylim=(0, HEIGHT))
    page.axis("off")
    draw_pipeline(page)
    plan = figure.add_axes((0.015, 0.02, 0.6, 0.53))
    draw_plan(plan)
    draw_key(page, left=8.1, top=3.72)
    return figure


def draw_pipeline(page: Axes) -> None:
    """Two rows: how the models are made, and how a real scan is read."""
    top = [
        ("rooms", "drawn from\na seed", SCANNER_FILL),
        ("scenarios", "one pillar or wall\nadded or removed", SCANNER_FILL),
        ("scan", "of the prior and\nof reality", SCANNER_FILL),
        ("preprocess", "filter, voxels,\ndistances", LEARNER_FILL),
        ("labels", "true, and the\nthesis's own", LEARNER_FILL),
        ("evidence", "through, support,\nblocked, unseen", LEARNER_FILL),
        ("network", "four models,\none jitted step", LEARNER_FILL),
        ("metrics", "many rooms,\n95 % intervals", LEARNER_FILL),
    ]
    for column, (name, text, fill) in enumerate(top):
        _box(page, column, TOP_ROW, name, text, fill)
        if column:
            _arrow(page, (_right(column - 1), _middle(TOP_ROW)), (_left(column), _middle(TOP_ROW)))
    bottom = [
        (2, "IFC, mesh", "any building\nmodel", INPUT_FILL),
        (3, "real scan", "and a scan of\nits prior", INPUT_FILL),
        (5, "boxes", "around what\nchanged", LEARNER_FILL),
        (6, "verdicts", "for every element\nof the prior", LEARNER_FILL),
        (7, "report", "text, JSON, BCF,\nIFC, figures", LEARNER_FILL),
    ]
    for column, name, text, fill in bottom:
        _box(page, column, SECOND_ROW, name, text, fill)
        if column > 5:
            _arrow(page, (_right(column - 1), _middle(SECOND_ROW)), (_left(column), _middle(SECOND_ROW)))
    for column in (2, 3):  # a building takes the place of drawn rooms, a real scan that of a virtual one
        _arrow(page, (_center(column), SECOND_ROW + BOX_HEIGHT), (_center(column), TOP_ROW))
    question = "One robot scan, one building model:\nwhat was added, what was removed,\nand what could not be seen?"
    page.text(_left(0), _middle(SECOND_ROW), question, va="center", fontsize=11.5, style="italic", linespacing=1.35)
    # From the network back to the column of the boxes, in the gap between the rows.
    gap = (TOP_ROW + SECOND_ROW + BOX_HEIGHT) / 2
    page.plot([_center(6), _center(6), _center(5)], [TOP_ROW, gap, gap], color=GREY, linewidth=1.6)
    _arrow(page, (_center(5), gap), (_center(5), SECOND_ROW + BOX_HEIGHT))
    page.text(_center(5) + 0.1, gap + 0.05, "probability per point", fontsize=9, color=GREY)
    for first, last, name in ((0, 2, "warp_scanner"), (3, 7, "jaxmm")):
        page.plot([_left(first), _right(last)], [7.0, 7.0], color=GREY, linewidth=1)
        page.text((_left(first) + _right(last)) / 2, 7.08, name, ha="center", family="monospace", fontsize=11)


def draw_plan(axes: Axes) -> None:
    """A room seen from above: the rays of one scan, and what they say of the prior's surfaces."""
    axes.set(xlim=(-0.15, ROOM.width + 0.15), ylim=(-0.15, ROOM.depth + 0.15), aspect="equal")
    axes.axis("off")
    angle = np.radians(HEADING + np.linspace(-0.5, 0.5, 97) * FIELD_OF_VIEW)
    direction = np.column_stack([np.cos(angle), np.sin(angle)])
    prior_range, real_range = cast(direction, PRIOR), cast(direction, REAL)
    kind = np.where(real_range > prior_range + 0.05, "through", "support")
    kind = np.where(real_range < prior_range - 0.05, "blocked", kind)

    for blocker in (TABLE, ADDED):
        axes.add_patch(Polygon(shadow(direction, blocker, prior_range), color="#EFEFEF", linewidth=0))
    for name, color in EVIDENCE.items():
        for ray in np.flatnonzero(kind == name)[::2]:
            end = SENSOR + direction[ray] * real_range[ray]
            axes.plot(*np.column_stack([SENSOR, end]), color=color, linewidth=0.8, alpha=0.55)
    axes.add_patch(Rectangle((0, 0), ROOM.width, ROOM.depth, fill=False, edgecolor=BLACK, linewidth=4))
    for block in (HIDDEN, PRESENT, PARTITION):
        _block(axes, block, facecolor="#8A8A8A", edgecolor=BLACK)
    _block(axes, REMOVED, facecolor="white", edgecolor=COLOR_REMOVED, linestyle=(0, (3, 2)), linewidth=1.8)
    _block(axes, ADDED, facecolor=COLOR_ADDED, edgecolor=BLACK)
    _block(axes, TABLE, facecolor="#E9DCC3", edgecolor=GREY)
    for name, color in EVIDENCE.items():
        on_prior = SENSOR + direction[kind == name] * prior_range[kind == name, None]
        axes.plot(*on_prior.T, "o", color=color, markersize=4.6, markeredgecolor="white", markeredgewidth=0.5)
    axes.add_patch(Circle(SENSOR, 0.16, facecolor=BLACK, zorder=5))

    labels = [
        ("sensor", (SENSOR[0], SENSOR[1] - 0.45), "center"),
        ("table", (TABLE.x + TABLE.width / 2, TABLE.y - 0.3), "center"),
        ("added pillar", (ADDED.x + ADDED.width / 2, ADDED.y - 0.3), "center"),
        ("removed pillar", (REMOVED.x + REMOVED.width / 2, REMOVED.y + REMOVED.depth + 0.22), "center"),
        ("prior wall", (PARTITION.x + PARTITION.width + 0.12, 4.75), "left"),
        ("pillar: occluded", (HIDDEN.x + HIDDEN.width + 0.15, HIDDEN.y + HIDDEN.depth / 2), "left"),
        ("pillar: present", (PRESENT.x + PRESENT.width + 0.12, PRESENT.y + PRESENT.depth / 2), "left"),
    ]
    for text, place, align in labels:
        axes.text(*place, text, ha=align, va="center", fontsize=10.5, bbox=_halo(), zorder=6)


def draw_key(page: Axes, left: float, top: float) -> None:
    """What the colours say, beside the plan."""
    page.text(left, top, "What a ray says of the prior", fontsize=12, fontweight="bold")
    rows = [
        (COLOR_REMOVED, "through", "The robot saw farther than the prior allows:\nwhat stood there is removed."),
        (GREEN, "support", "It saw the surface where the prior has it:\npresent."),
        (
            COLOR_HIDDEN,
            "blocked",
            "Something stands in front. The prior behind it is\nnot removed and not confirmed: occluded.",
        ),
        (COLOR_ADDED, "added", "What stands in front is structure, and the prior\nhas nothing there."),
    ]
    for index, (color, name, text) in enumerate(rows):
        y = top - 0.5 - 0.72 * index
        page.plot([left + 0.1], [y + 0.05], "s" if name == "added" else "o", color=color, markersize=11)
        page.text(left + 0.35, y, name, fontsize=12, fontweight="bold", color=BLACK)
        page.text(left + 0.35, y - 0.08, text, fontsize=10.5, va="top", linespacing=1.25)
    note = "Dots lie on the prior's surfaces; grey areas lie in shadow."
    page.text(left, top - 3.5, note, fontsize=10, color="#555555", va="bottom")


def cast(direction: np.ndarray, blocks: tuple[Block, ...]) -> np.ndarray:
    """(P,) distance [m] from the sensor along unit vectors (P, 2) to the nearest block or the room's wall."""
    near = np.stack([_slab(direction, block)[0] for block in blocks])
    return np.minimum(near.min(axis=0), _slab(direction, ROOM)[1])


def shadow(direction: np.ndarray, blocker: Block, reach: np.ndarray) -> np.ndarray:
    """Corners (n, 2) [m] of what a block hides, out to `reach` (P,) along unit vectors (P, 2)."""
    distance = _slab(direction, blocker)[0]
    hit = distance < reach
    near = SENSOR + direction[hit] * distance[hit, None]
    far = SENSOR + direction[hit] * reach[hit, None]
    return np.concatenate([near, far[::-1]])


def _slab(direction: np.ndarray, block: Block) -> tuple[np.ndarray, np.ndarray]:
    """(P,) distances at which rays enter (inf on a miss) and leave a block."""
    low, high = np.array([block.x, block.y]), np.array([block.x + block.width, block.y + block.depth])
    with np.errstate(divide="ignore"):
        first, second = (low - SENSOR) / direction, (high - SENSOR) / direction
    enter, leave = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
    return np.where((enter <= leave) & (leave > 0), enter, np.inf), leave


def _block(axes: Axes, block: Block, **style) -> None:
    axes.add_patch(Rectangle((block.x, block.y), block.width, block.depth, **({"linewidth": 1.2} | style)))


def _halo() -> dict:
    return {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.2}


def _left(column: int) -> float:
    return 0.22 + COLUMN * column


def _right(column: int) -> float:
    return _left(column) + BOX_WIDTH


def _center(column: int) -> float:
    return _left(column) + BOX_WIDTH / 2


def _middle(row: float) -> float:
    return row + BOX_HEIGHT / 2


def _box(page: Axes, column: int, row: float, name: str, text: str, fill: str) -> None:
    shape = FancyBboxPatch(
        (_left(column), row),
        BOX_WIDTH,
        BOX_HEIGHT,
        boxstyle="round,pad=0,rounding_size=0.09",
        facecolor=fill,
        edgecolor=PALE,
        linewidth=1.2,
    )
    page.add_patch(shape)
    page.text(_center(column), row + 0.64, name, ha="center", va="center", fontsize=12, fontweight="bold")
    page.text(_center(column), row + 0.29, text, ha="center", va="center", fontsize=9, linespacing=1.2)


def _arrow(page: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    style = {"arrowstyle": "-|>", "color": GREY, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 11}
    page.annotate("", xy=end, xytext=start, arrowprops=style)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, help="image to write: .png, .pdf or .svg")
    main(parser.parse_args().path)
