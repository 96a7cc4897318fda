"""The empty shells that walls, pillars and furniture are put into. R rooms. World frame: metres, z up."""

from typing import NamedTuple

import numpy as np

from warp_scanner.rooms import footprints
from warp_scanner.rooms.footprints import Footprints


class Site(NamedTuple):
    """Shells of R rooms, centred on the origin."""

    key: np.ndarray  # (R,) uint64 from draws.keys
    size: np.ndarray  # (R, 3) float64 [m] inside of the shells
    greatest: tuple[float, float]  # [m] x and y that no room of the settings exceeds: it fixes the number of slots
    clearance: float  # [m] least gap between things that do not belong together
    corner: Footprints  # (R, 1) the closed corner, where a room has one

    def within(self, marks: Footprints) -> np.ndarray:
        """(R, N) bool: the whole rectangle lies inside the shell, with the clearance to it."""
        return footprints.inside(marks, self.size[:, None, :2] / 2 - self.clearance)

    def settled(self, marks: Footprints, others: Footprints) -> np.ndarray:
        """(R, N) bool: the marks that can stay inside the shell, clear of the others and of each other."""
        inside = marks._replace(valid=marks.valid & self.within(marks))
        return footprints.settle(inside, others, self.clearance, self.clearance)
