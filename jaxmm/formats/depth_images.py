"""Folders of depth images as scans: each pixel with a depth is a point along its ray, one without is a ray unseen.

An image is a scan. Images whose camera stood still, as the trajectory tells, are one scan together; without a
trajectory nobody knows, and each is its own. Frame of points: optical (x right, y down, z forward).
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from jaxmm.formats.depth_folders import Camera, DepthFolder, open_depth_folder
from jaxmm.formats.raw_scans import GrowingPoints, RawScan, to_world
from jaxmm.formats.standstill import is_rest
from jaxmm.inputs import InputError

MOST_POINTS = 100_000_000  # of all images of a folder together: more do not fit into usual memory
LEAST_CONFIDENCE = 1  # of maps with 0, 1 and 2, as devices of Apple write them
SATURATED = 65535  # the largest value of 16 bits: at least so far away


def read_depth_folder(path: Path) -> list[RawScan]:
    """The scans of a folder of depth images, in the world where it holds a trajectory.

    Raises:
        InputError: no such folder; an image that is none, or not of 16 bits, or of another size than its camera; no
            image with a pose where there is a trajectory.
    """
    folder = open_depth_folder(path)
    chosen, remarks = _chosen(path, folder)
    scans: list[RawScan] = []
    for group in _at_rest(folder, chosen):
        held = GrowingPoints()
        for place in group:
            held.append(_posed_points(folder, place))
        if folder.poses is None:
            scans.append(RawScan(held.points(), frame="optical"))
        else:
            position, rotation = folder.poses[group[0]]
            scans.append(RawScan(held.points(), position, rotation, in_world=True, frame="optical"))
    scans[0] = scans[0]._replace(remarks=remarks)
    return scans


def _chosen(path: Path, folder: DepthFolder) -> tuple[list[int], tuple[str, ...]]:
    """Which images to read, and what is to be said of the others."""
    count, remarks = len(folder.images), []
    chosen = [place for place in range(count) if folder.poses is None or folder.poses[place] is not None]
    if not chosen:
        raise InputError(f"{path}: expected a trajectory with a pose for its images, got none at the time of any")
    if len(chosen) < count:
        remarks.append(f"{count - len(chosen)} of {count} images have no pose in its trajectory and are left out")
    step = -(-len(chosen) * folder.camera.width * folder.camera.height // MOST_POINTS)
    if step > 1:
        remarks.append(f"one of {step} of its {len(chosen)} images is read: all hold more points than fit into memory")
    return chosen[::step], tuple(remarks)


def _at_rest(folder: DepthFolder, chosen: list[int]) -> Iterator[list[int]]:
    """Runs of images whose camera stands where it stood at the first of them."""
    group: list[int] = []
    for place in chosen:
        if group and not (folder.poses is not None and is_rest(folder.poses[group[0]], folder.poses[place])):
            yield group
            group = []
        group.append(place)
    yield group


def _posed_points(folder: DepthFolder, place: int) -> np.ndarray:
    """(N, 3) float64 [m] of an image, in the world where it has a pose."""
    depth = _image(folder.images[place], folder.camera, ("I;16", "I;16B", "I"), "16 bits of grey")
    there = (depth > 0) & (depth < SATURATED)
    if folder.confidence is not None:
        confidence = _image(folder.confidence / folder.images[place].name, folder.camera, ("L",), "8 bits of grey")
        there &= confidence >= LEAST_CONFIDENCE
    rows, columns = np.nonzero(there)
    reach, camera = depth[there] / folder.units, folder.camera
    across, down = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    points = np.column_stack([across * reach, down * reach, reach])
    if folder.poses is not None:
        position, rotation = folder.poses[place]
        to_world(points, rotation, position)
    return points


def _image(path: Path, camera: Camera, modes: tuple[str, ...], wanted: str) -> np.ndarray:
    """(height, width) int32 of a PNG file."""
    from PIL import Image

    try:
        with Image.open(path, formats=("PNG",)) as image:
            if image.size != (camera.width, camera.height):
                raise InputError(
                    f"{path}: expected an image of {camera.width} x {camera.height} pixels, as its camera has, got "
                    f"{image.size[0]} x {image.size[1]}"
                )
            if image.mode not in modes:
                raise InputError(f"{path}: expected a PNG image of {wanted}, got mode {image.mode}")
            return np.asarray(image).astype(np.int32)
    except FileNotFoundError as error:
        raise InputError(f"{path}: expected a PNG image of {wanted}, found nothing there") from error
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{path}: expected a whole PNG image: {error}") from error
