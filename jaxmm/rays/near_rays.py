"""Which rays are closest to some directions: by a tree of all of them, or of those around what is asked for.

P rays of a scan, n directions asked for, K rays closest to each.
"""

import numpy as np
import small_gicp

from warp_scanner.launches import thread_count

STRIP = np.radians(2.0)  # of azimuths
FIRST_CELL = 0.0175  # side of cubes of directions, about a degree; twice as long for what finds too few rays in them
MOST_AROUND = 0.3  # share of the rays in cubes around what is asked for; with more, a tree of all is as good
AT_ONCE = 16_384  # directions
EXACT = 0.999  # of a cube's side: rays closer than that are surely in it or beside it


def nearest_rays(tree: small_gicp.KdTree, direction: np.ndarray, count: int) -> np.ndarray:
    """The rays (n, count) int32 closest to some directions (n, 3), the closest first."""
    # Two thirds of the time that scipy's tree takes: 0.45 s for 0.65 s, of 260,000 rays. Asked strip by strip, rays in
    # no order take half the time; the answers are the same.
    order = _by_strip(direction)
    near = np.empty((len(direction), count), np.int32)
    near[order] = tree.batch_knn_search(direction[order], count, num_threads=thread_count(None))[0]
    return near


def _by_strip(direction: np.ndarray) -> np.ndarray:
    strip = np.floor(np.arctan2(direction[:, 1], direction[:, 0]) / STRIP)
    return np.argsort((4.0 * strip + direction[:, 2]).astype(np.float32))


def rays_around(known: np.ndarray, asked: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The rays closest to each of some directions, the closest first.

    Building a tree of all rays takes far longer than to ask it of a few directions: it is built of those around them.

    Args:
        known: (P, 3) unit vectors, P >= count.
        asked: (n, 3) unit vectors.
        count: K rays for each.

    Returns:
        Rays (n, K) int32, and how far the last of them is (n,) float64, as the square of a chord.
    """
    near, square = np.empty((len(asked), count), np.int32), np.empty(len(asked))
    asked, cell, left = asked.astype(np.float64), FIRST_CELL, _by_strip(asked)
    while len(left):
        rows = _beside(known, asked[left], cell)
        if len(rows) > MOST_AROUND * len(known):
            rows, cell = np.arange(len(known)), np.inf
        if len(rows) >= count:
            tree, sure = small_gicp.KdTree(known[rows].astype(np.float64), num_threads=thread_count(None)), []
            for start in range(0, len(left), AT_ONCE):
                part = left[start : start + AT_ONCE]
                found, apart = map(np.asarray, tree.batch_knn_search(asked[part], count, thread_count(None)))
                near[part], square[part] = rows[found], apart[:, -1]
                sure.append(apart[:, -1] < (EXACT * cell) ** 2)
            left = left[~np.concatenate(sure)]
        cell *= 2.0
    return near, square


def _beside(known: np.ndarray, asked: np.ndarray, cell: float) -> np.ndarray:
    """Rays (m,) int in the cubes, of some side, that some directions (n, 3) lie in, or in cubes beside these."""
    width = int(np.ceil(1.0 / cell)) + 2  # cubes from the middle on, with one beside the outermost

    def cube(direction: np.ndarray) -> np.ndarray:
        place = np.floor(direction * (1.0 / cell)).astype(np.int32) + width
        return (place[:, 0] * (2 * width) + place[:, 1]) * (2 * width) + place[:, 2]

    wanted, aside = np.zeros((2 * width) ** 3, bool), np.arange(-1, 2)
    steps = ((aside[:, None, None] * (2 * width) + aside[:, None]) * (2 * width) + aside).ravel()
    wanted[(np.unique(cube(asked))[:, None] + steps).ravel()] = True
    return np.flatnonzero(wanted[cube(known)])
