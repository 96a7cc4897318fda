"""What a plan of each storey draws: the lines of its elements as seen from above, or as cut through the model.

World frame, metres; counted from `base`, as numbers of seven digits cannot be read.
"""

from typing import NamedTuple

import numpy as np

from jaxmm.reports.plan_levels import CUT, FAR_ORIGIN
from jaxmm.weeks.history import Progress
from jaxmm.weeks.model import Model, cut_at
from jaxmm.weeks.reports import Key
from jaxmm.weeks.shares import storey_of, storeys_of

Rings = list[np.ndarray]  # (n, 2) float64 [m] each, filled together so that what is hollow stays empty


class Storey(NamedTuple):
    """One storey."""

    name: str
    floor: float  # [m] world
    elements: dict[Key, Rings]  # the largest first, so that what is small is drawn on what is large
    others: Rings  # what no report lists, of the model where it was given


class Outlines(NamedTuple):
    """All storeys of which places are known, from the lowest up."""

    base: np.ndarray  # (2,) [m] world that all lines count from
    storeys: tuple[Storey, ...]

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (2,) of all elements: plans of all storeys are in one frame."""
        every = np.concatenate([ring for one in self.storeys for rings in one.elements.values() for ring in rings])
        return every.min(axis=0), every.max(axis=0)


def outlines_of(progress: Progress, model: Model | None = None) -> Outlines:
    """Footprints of the boxes that the reports state, or, of what the cut of a given model meets, its true outline."""
    groups = {name: [] for name in storeys_of(progress)}
    for one in progress.elements:
        if one.latest.box is not None:
            groups[storey_of(one)].append(one)
    known = [one.latest.box for members in groups.values() for one in members]
    middle = np.median([box.center[:2] for box in known], axis=0) if known else np.zeros(2)
    base = np.round(middle) if np.abs(middle).max() > FAR_ORIGIN else np.zeros(2)
    keys, storeys = {one.key for one in progress.elements}, []
    for name, members in groups.items():
        if not members:
            continue
        bottoms = [one.latest.box.center[2] - one.latest.box.dimensions[2] / 2 for one in members]
        floor = float(np.median(bottoms))
        cut = None if model is None else cut_at(model, keys, floor + CUT)
        lines = {}
        for one in members:
            rings = (cut.followed.get(one.key) if cut else None) or [_closed(one.latest.box.corners)]
            lines[one.key] = [ring - base for ring in rings]
        order = sorted(lines, key=lambda key: -_extent(lines[key]))
        others = [ring - base for ring in cut.others] if cut else []
        storeys.append(Storey(name, floor, {key: lines[key] for key in order}, others))
    return Outlines(base, tuple(storeys))


def _closed(corners: np.ndarray) -> np.ndarray:
    """Corners (n, 2), the first again at the end."""
    return np.concatenate([corners, corners[:1]])


def _extent(rings: Rings) -> float:
    """Area [m^2] of the rectangle around some lines."""
    every = np.concatenate(rings)
    return float(np.prod(np.ptp(every, axis=0)))
