"""Polygons of meshes, cut into triangles: fans of convex ones, ears of others, whose fans would cover their notches."""

import numpy as np

MOST_CORNERS = 2000  # of a polygon that ears are cut off from, which takes the square of them


def triangles_of(corners: np.ndarray) -> np.ndarray:
    """Triangles of a flat polygon.

    Args:
        corners: (n >= 3, 3) in order around it.

    Returns:
        (n - 2, 3) int64 of the corners.
    """
    count = len(corners)
    fan = np.column_stack([np.zeros(count - 2, int), np.arange(1, count - 1), np.arange(2, count)])
    if count == 3 or count > MOST_CORNERS or not np.isfinite(corners).all():
        return fan
    edges = corners - corners[0]
    areas = np.cross(edges[1:-1], edges[2:])
    normal = areas.sum(axis=0)
    length = np.linalg.norm(normal)
    if length == 0.0 or (areas @ normal >= 0.0).all():
        return fan
    drop = int(np.argmax(np.abs(normal)))  # the plane is looked at along this axis
    flat = np.delete(corners, drop, axis=1)
    turn = 1.0 if (normal[drop] > 0.0) == (drop != 1) else -1.0
    return _ears(flat, turn)


def _ears(flat: np.ndarray, turn: float) -> np.ndarray:
    """Ears cut off one by one; `turn` is 1 where corners (n, 2) run counter-clockwise, else -1."""
    left, found = list(range(len(flat))), []
    while len(left) > 3:
        place = next((place for place in range(len(left)) if _is_ear(flat, left, place, turn)), 0)
        found.append([left[place - 1], left[place], left[(place + 1) % len(left)]])
        left.pop(place)
    return np.array([*found, left])


def _is_ear(flat: np.ndarray, left: list[int], place: int, turn: float) -> bool:
    one, two, three = left[place - 1], left[place], left[(place + 1) % len(left)]
    if turn * _area(flat[one], flat[two], flat[three]) <= 0.0:
        return False
    others = flat[[corner for corner in left if corner not in (one, two, three)]]
    others = others[~(others[:, None] == flat[[one, two, three]][None]).all(axis=2).any(axis=1)]  # bridges to holes
    inside = np.ones(len(others), bool)
    for start, end in ((one, two), (two, three), (three, one)):
        inside &= turn * _area(flat[start], flat[end], others.T) >= 0.0
    return not inside.any()


def _area(one: np.ndarray, two: np.ndarray, three: np.ndarray) -> np.ndarray:
    return (two[0] - one[0]) * (three[1] - one[1]) - (two[1] - one[1]) * (three[0] - one[0])
