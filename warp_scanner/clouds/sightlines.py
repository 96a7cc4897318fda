"""What the rays near a point met: something beyond it, the point itself, something before it, or nothing.

The thin host side of kernels/sightlines.py. R scans, P rays of each, N points of one scan. Any frame that directions
and points share; metres.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import warp as wp

from warp_scanner.kernels import sightlines as kernels
from warp_scanner.launches import load, share, share_out, starts_of, thread_count

THROUGH, SUPPORT, BLOCKED, UNSEEN = range(4)  # columns of Looks.count


class Grid(NamedTuple):
    """P directions, sorted into cells of about equal size on the sphere."""

    direction: np.ndarray  # (P, 3) float32 unit vectors, by cell
    ray: np.ndarray  # (P,) int32 which of the given directions stands there
    row_start: np.ndarray  # (rows + 1,) int32 first cell of each belt of elevations, and the end
    cell_start: np.ndarray  # (cells + 1,) int32 first place of each cell, and the end
    row_height: float  # [rad]


class Targets(NamedTuple):
    """N points of one scan, as seen from the sensor."""

    direction: np.ndarray  # (N, 3) unit vectors
    distance: np.ndarray  # (N,) [m]
    angle: np.ndarray  # (N,) [rad] half width of the footprint
    margin: np.ndarray  # (N,) [m] ranges that differ by less are the same; not used where ranges are predicted
    slope: np.ndarray  # (N,) [m/rad] how that margin grows away from the point's own direction
    element: np.ndarray  # (N,) int32; only rays predicted to meet this element count; -1: all. Not used otherwise


class Predicted(NamedTuple):
    """What the prior says that every ray of R scans should meet."""

    distance: np.ndarray  # (R, P) float32 [m], inf = nothing
    element: np.ndarray  # (R, P) int32
    margin: np.ndarray  # (R, P) float32 [m] ranges that differ by less are the same


class Looks(NamedTuple):
    """What the rays within each point's footprint met."""

    count: np.ndarray  # (N, 4) int32 rays THROUGH, in SUPPORT, BLOCKED before it, and without a return (UNSEEN)
    residual: np.ndarray  # (N,) float32 [m] mean of measured less expected range, each within 5 m; NaN without returns


def sort_directions(direction: np.ndarray, cell: float = 0.015) -> Grid:
    """Sort directions so that those near a given one are found at once.

    Args:
        direction: (P, 3) unit vectors.
        cell: height of a belt and width of a cell [rad].

    Raises:
        ValueError: not (P, 3), not of unit length, or a cell not within 1e-3 and 1 rad.
    """
    direction = np.asarray(direction, np.float32)
    if direction.ndim != 2 or direction.shape[1] != 3:
        raise ValueError(f"direction must be (P, 3), got {direction.shape}")
    if not np.all(np.abs(np.einsum("pc,pc->p", direction, direction) - 1.0) < 1e-3):
        raise ValueError("direction must hold unit vectors")
    if not 1e-3 <= cell <= 1.0:
        raise ValueError(f"cell must be within 0.001 and 1 rad, got {cell}")
    at, row_start, height = cells_of(direction, cell)
    order = np.argsort(at, kind="stable")
    cell_start = starts_of(np.bincount(at, minlength=int(row_start[-1])))
    return Grid(direction[order], order.astype(np.int32), row_start, cell_start, float(height))


def cells_of(direction: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Cells of about equal size that the sphere is divided into.

    Args:
        direction: (P, 3) unit vectors.
        cell: height of a belt and width of a cell [rad].

    Returns:
        The cell of each direction (P,) int64, the first cell of each belt and the end (rows + 1,), and the height of a
        belt [rad].
    """
    rows = int(np.ceil(np.pi / cell))
    height = np.pi / rows
    middle = (np.arange(rows) + 0.5) * height - np.pi / 2
    cells = np.maximum(1, np.floor(2 * np.pi * np.cos(middle) / cell)).astype(np.int64)
    row_start = starts_of(cells)
    elevation = np.arcsin(np.clip(direction[:, 2].astype(np.float64), -1.0, 1.0))
    # In float32, minus pi may be less than minus pi.
    turn = np.maximum(np.arctan2(direction[:, 1], direction[:, 0]).astype(np.float64) + np.pi, 0.0) / (2 * np.pi)
    row = np.clip(np.floor((elevation + np.pi / 2) / height), 0, rows - 1).astype(np.int64)
    at = row_start[row] + np.minimum(np.floor(turn * cells[row]), cells[row] - 1).astype(np.int64)
    return at, row_start, height


def look(
    grid: Grid,
    distance: np.ndarray,
    targets: Sequence[Targets],
    predicted: Predicted | None = None,
    width: np.ndarray | None = None,
    threads: int | None = None,
) -> list[Looks]:
    """Compare each point with the rays of its scan that lie within the point's footprint.

    Where ranges are predicted, every ray is compared with its own prediction, and only rays that should meet the
    point's element count: exact, whatever the slope of the surface. Otherwise with the point's range, within a margin
    that grows with the angle between the two.

    Args:
        grid: directions of the rays.
        distance: (R, P) measured ranges [m] in the order of the directions that were sorted, inf = no return.
        targets: the points of each of R scans.
        predicted: what the rays should meet.
        width: (R, P) half width [rad] of what each ray stands for, where rays are points of a thinned cloud: those
            that end before a point count as BLOCKED if the point lies within their width.
        threads: how many to use; by default one for each core it may run on.

    Raises:
        ValueError: the shapes disagree.
    """
    distance = np.asarray(distance, np.float32)
    if distance.shape != (len(targets), len(grid.ray)):
        raise ValueError(f"distance must be {(len(targets), len(grid.ray))}, got {distance.shape}")
    if predicted is not None and any(np.shape(field) != distance.shape for field in predicted):
        raise ValueError(f"predicted must be {distance.shape}, got {[np.shape(field) for field in predicted]}")
    if width is not None and np.shape(width) != distance.shape:
        raise ValueError(f"width must be {distance.shape}, got {np.shape(width)}")
    start = starts_of([len(target.distance) for target in targets])
    count, residual = np.zeros((start[-1], 4), np.int32), np.full(start[-1], np.nan, np.float32)
    if start[-1]:
        load(kernels)
        rays, points = _rays(grid, distance, predicted, width), _points(targets, start)
        outputs = [share(count, wp.int32), share(residual, wp.float32)]

        def launch(first: int, size: int) -> None:
            wp.launch(kernels.look, dim=size, inputs=[first, rays, points, *outputs], device="cpu")

        share_out(launch, int(start[-1]), thread_count(threads))
    return [Looks(count[a:b], residual[a:b]) for a, b in pairwise(start)]


def _rays(grid: Grid, distance: np.ndarray, predicted: Predicted | None, width: np.ndarray | None) -> kernels.Rays:
    rays = kernels.Rays()
    rays.direction, rays.ray = share(grid.direction, wp.vec3), share(grid.ray, wp.int32)
    rays.row_start, rays.cell_start = share(grid.row_start, wp.int32), share(grid.cell_start, wp.int32)
    rays.row_height = grid.row_height
    rays.distance = share(distance, wp.float32)
    nothing = np.zeros((len(distance), 0), np.float32)
    expected, element, margin = predicted or (nothing, nothing, nothing)
    rays.expected = share(np.asarray(expected, np.float32), wp.float32)
    rays.margin = share(np.asarray(margin, np.float32), wp.float32)
    rays.element = share(np.asarray(element, np.int32), wp.int32)
    width = nothing if width is None else np.asarray(width, np.float32)
    rays.width, rays.widest = share(width, wp.float32), float(width.max(initial=0.0))
    return rays


def _points(targets: Sequence[Targets], start: np.ndarray) -> kernels.Points:
    points = kernels.Points()
    scan = np.repeat(np.arange(len(targets), dtype=np.int32), np.diff(start))
    points.scan = share(scan, wp.int32)
    joined = [np.concatenate(fields) for fields in zip(*targets, strict=True)]
    kinds = (wp.vec3, wp.float32, wp.float32, wp.float32, wp.float32, wp.int32)
    for name, values, kind in zip(Targets._fields, joined, kinds, strict=True):
        setattr(points, name, share(values.astype(np.int32 if kind is wp.int32 else np.float32), kind))
    return points
