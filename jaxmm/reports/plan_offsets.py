"""Displaced elements on a floor plan: an arrow along each offset, and a short table of the worst.

Positions are offsets from the drawing's origin [m] until they are drawn.
"""

import functools
import textwrap
from collections.abc import Sequence
from string import ascii_uppercase
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxmm.reports.deviation_words import kind_of_class, off_in_words
from jaxmm.reports.figures import COLOR_DISPLACED
from jaxmm.reports.markdown import printable
from jaxmm.reports.offset_arrows import offsets_of
from jaxmm.reports.plan_levels import CUT, Level, base_of
from jaxmm.verdicts.results import Drawing, ElementVerdict

ARROW_TIMES = (50, 20, 10, 5)  # as long as the offsets arrows may be drawn
LONGEST_ARROW = 1.5  # [m] on the plan
BEYOND = 0.6  # [m] about the tips of arrows that the plan leaves free
MOST_WORST = 10  # that get a letter, and a line in the table
LEAST_DRAWN = 0.001  # [m] of an offset in plan: a slab that is too high has no arrow there
MISSING = "\u25a1"  # for what the font cannot show
_LONGEST_NAME, _LINE = 26, 42  # characters of a name, and of a line in the table


class Arrow(NamedTuple):
    """An offset, as it is drawn."""

    number: int  # of the element, of the worst first
    tail: np.ndarray  # (2,) [m]
    tip: np.ndarray  # (2,) [m]
    times: int  # as long as the offset


def arrows_of(
    drawing: Drawing, worst: Sequence[ElementVerdict], level: Level, limits: tuple[np.ndarray, np.ndarray]
) -> list[Arrow]:
    """The arrows of the displaced elements that the cut of a storey meets.

    Args:
        drawing: the prior's surface.
        worst: displaced elements, the worst first.
        level: the storey.
        limits: lower and upper corner (2,) [m] of the plan: arrows of what reaches beyond begin within.
    """
    height, found = level.floor + CUT, []
    times = arrow_times(drawing, worst)
    for number, one in enumerate(worst):
        corners = drawing.corners(one.key)
        if corners is None:
            continue
        low, high = corners.min(axis=0), corners.max(axis=0)
        start, end = np.maximum(low[:2], limits[0]), np.minimum(high[:2], limits[1])
        if not (low[2] < height < high[2] and (start <= end).all()):
            continue
        for place, step in offsets_of(one.deviation, corners, limits):
            if LEAST_DRAWN <= np.linalg.norm(step[:2]) < np.inf:
                found.append(Arrow(number, place[:2], place[:2] + times * step[:2], times))
    return found


def with_room(limits: tuple[np.ndarray, np.ndarray], arrows: Sequence[Arrow]) -> tuple[np.ndarray, np.ndarray]:
    """The limits of a plan, wide enough for the arrows and their letters."""
    tips = np.array([one.tip for one in arrows]).reshape(-1, 2)
    return np.vstack([limits[0], tips - BEYOND]).min(axis=0), np.vstack([limits[1], tips + BEYOND]).max(axis=0)


def draw_offsets(axes: Axes, drawing: Drawing, arrows: Sequence[Arrow]) -> list[Line2D]:
    """Draw the arrows, the first MOST_WORST with letters; returns what the legend needs."""
    shift = (drawing.origin - base_of(drawing))[:2]
    lettered = set()
    for one in arrows:
        look = {"arrowstyle": "-|>", "color": COLOR_DISPLACED, "linewidth": 2.2, "shrinkA": 0, "shrinkB": 0}
        tip, tail = one.tip + shift, one.tail + shift
        axes.annotate("", tip, tail, arrowprops=look | {"mutation_scale": 14}, zorder=8)
        if one.number < MOST_WORST and one.number not in lettered:
            lettered.add(one.number)
            _write_letter(axes, ascii_uppercase[one.number], tip, tip - tail)
    look = {"color": COLOR_DISPLACED, "linewidth": 2.2, "marker": ">", "markersize": 7, "markevery": [-1]}
    return [Line2D([], [], label=f"offset, the arrow {one.times} times as long", **look) for one in arrows[:1]]


def offset_entries(worst: Sequence[ElementVerdict]) -> list[Patch]:
    """The table of the worst, as entries of a legend; empty where nothing is displaced."""
    entries = []
    for letter, one in zip(ascii_uppercase[:MOST_WORST], worst, strict=False):
        name = shown_name(one.name or one.guid)
        words = off_in_words(one.deviation)
        text = f"{letter}: {kind_of_class(one.ifc_class)} {name}, {words}"
        entries.append(textwrap.fill(text, _LINE, subsequent_indent="    "))
    if len(worst) > MOST_WORST:
        entries.append(f"and {len(worst) - MOST_WORST} more displaced: see deviations.csv")
    if entries:
        entries.append("north is up, the model's +y; in brackets: 95 %")
    return [Patch(facecolor="none", label=text) for text in entries]


def arrow_times(drawing: Drawing, worst: Sequence[ElementVerdict]) -> int:
    """How many times as long as the offsets the arrows of all storeys are: the most that keeps them bearable."""
    drawn = ((one, corners) for one in worst if (corners := drawing.corners(one.key)) is not None)
    steps = (offset.step for one, corners in drawn for offset in offsets_of(one.deviation, corners))
    longest = max((float(np.linalg.norm(step)) for step in steps), default=0.0)
    return next((times for times in ARROW_TIMES if times * longest <= LONGEST_ARROW), ARROW_TIMES[-1])


def shown_name(name: str) -> str:
    """A name as the figure's font can show it, on one line of a bearable length; one mark for signs it has not."""
    has, text = _font().get_char_index, ""
    for sign in " ".join(printable(name).split()):
        if has(ord(sign)):
            text += sign
        elif not text.endswith(MISSING):
            text += MISSING
    return text if len(text) <= _LONGEST_NAME else f"{text[: _LONGEST_NAME - 1]}…"


@functools.cache
def _font():
    return get_font(findfont(FontProperties()))


def _write_letter(axes: Axes, letter: str, tip: np.ndarray, offset: np.ndarray) -> None:
    note = {"boxstyle": "round,pad=0.2", "facecolor": "white", "edgecolor": COLOR_DISPLACED, "linewidth": 1.4}
    ahead = 12.0 * offset / np.linalg.norm(offset)  # [pt]
    words = {"ha": "center", "va": "center", "fontweight": "bold", "fontsize": 9.5, "bbox": note, "zorder": 9}
    axes.annotate(letter, tip, ahead, textcoords="offset points", **words)
