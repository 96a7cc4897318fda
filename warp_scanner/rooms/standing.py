"""Where in a room a sensor may stand, and how free places are drawn. R rooms. Angles of poses are in degrees."""

import dataclasses

import numpy as np

from warp_scanner import draws
from warp_scanner.rooms import footprints
from warp_scanner.scenes.scenes import Primitives
from warp_scanner.sensors.poses import Pose


@dataclasses.dataclass(frozen=True)
class Standing:
    """Where a sensor may stand, and how far it may tilt; the defaults are the thesis's."""

    height: float | tuple[float, float] = 1.0  # [m] above the floor; a pair is a range, drawn from uniformly
    gap: float = 0.3  # [m] at least, to anything that stands in the room
    tries: int = 32  # places drawn before giving up on a room
    pitch: tuple[float, float] = (0.0, 0.0)  # [deg] upwards, drawn from uniformly

    def __post_init__(self):
        low, high = self.height_range
        # Written so that NaN fails too.
        if not 0.0 <= low <= high < np.inf:
            raise ValueError(f"standing.height must be at least 0, or (low, high) with low <= high, got {self.height}")
        if not -90.0 <= self.pitch[0] <= self.pitch[1] <= 90.0:
            raise ValueError(f"standing.pitch must be (low, high) within -90 and 90 degrees, got {self.pitch}")
        if not 0.0 <= self.gap < np.inf or self.tries < 1:
            raise ValueError(f"standing needs a gap of at least 0 and a try, got gap {self.gap}, tries {self.tries}")

    @property
    def height_range(self) -> tuple[float, float]:
        """Lowest and greatest height [m] above the floor."""
        return self.height if isinstance(self.height, tuple) else (self.height, self.height)


def draw_poses(
    primitives: Primitives, size: tuple[float, float, float] | np.ndarray, standing: Standing, key: np.ndarray
) -> tuple[Pose, np.ndarray]:
    """Poses at random free places, looking anywhere.

    Args:
        primitives: everything that stands in the R rooms.
        size: (x, y, z) [m] inside of the shell, centred on the origin; (3,), or (R, 3) where rooms differ.
        standing: heights, pitches, gap and number of tries. Where a range of heights reaches closer to the ceiling
            than the gap, its upper end is lowered.
        key: (R,) uint64 from draws.keys.

    Returns:
        The poses, and (R,) bool: False where no free place was found and the pose means nothing.
    """
    size = np.broadcast_to(np.asarray(size, np.float64), (len(key), 3))
    place = []
    for axis in (0, 1):
        reach = size[:, axis, None] / 2
        place.append(draws.between(key, f"sensor {axis}", (standing.gap - reach, reach - standing.gap), standing.tries))
    place = np.stack(place, axis=-1)
    # A hair more than the gap, so that it still holds once the place is rounded to float32.
    first = footprints.first_clear_point(place, footprints.of_primitives(primitives), standing.gap + 1e-5)
    rooms = np.arange(len(key))
    low, high = standing.height_range
    # A single height stays what it is: only a range gives way to the ceiling.
    high = np.maximum(low, np.minimum(high, size[:, 2:] - standing.gap))
    height = draws.between(key, "sensor height", (low, high), 1)[:, 0] - size[:, 2] / 2
    position = np.column_stack([place[rooms, first], height]).astype(np.float32)
    yaw = draws.between(key, "sensor yaw", (-180.0, 180.0), 1)[:, 0].astype(np.float32)
    pitch = draws.between(key, "sensor pitch", standing.pitch, 1)[:, 0].astype(np.float32)
    return Pose(position, yaw, pitch), first >= 0
