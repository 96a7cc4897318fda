"""What each sensor sees of one room, from one place.   python paper/sensors.py OUT.png   (half a minute)

The room is drawn from a seed as any other; the scans, and the drawing of the room itself, are rays cast at it. R = 1
room, P rays, N points.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from jaxmm.reports.figures import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION, save, styled
from warp_scanner import draws
from warp_scanner.clouds.points import points_of
from warp_scanner.rooms.rooms import RoomConfig, make_rooms
from warp_scanner.rooms.standing import Standing, draw_poses
from warp_scanner.scenes import scenes
from warp_scanner.scenes.scenes import Primitives
from warp_scanner.sensors.imperfections import imperfect
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Rays, Scan, cast_rays, cast_slots
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.surface import incidence_of, normals_of

SEED, ROOM_NUMBER = 21, 85  # one where the camera looks away from the reader, so that what it sees can be seen
SENSOR_HEIGHT = 1.2  # [m]
AZIMUTH, ELEVATION = -60.0, 48.0  # [deg] from where the reader looks into the room
LEFT_OUT = (1, 3, 4)  # elements between the reader and the room: the ceiling and the two outer walls on this side
PIXEL = 0.012  # [m] of the drawing of the room
COLORS = {
    scenes.FLOOR: ("floor", "#A89F8F"),
    scenes.WALL: ("walls", BLUE),
    scenes.PILLAR: ("pillars", VERMILLION),
    scenes.DOOR: ("doors", GREEN),
    scenes.TABLE: ("tables", ORANGE),
    scenes.CHAIR: ("chairs", "#CC79A7"),
}
TITLES = {
    "oak-d-pro": "depth camera, 80° x 55°",
    "oak-d-pro-small": "the same field of view, 320 x 200",
    "velodyne-16": "spinning, 16 channels over 30°",
    "ouster-64": "spinning, 64 channels over 45°",
    "tls": "terrestrial, all round",
}
CLOSE_UPS = ("oak-d-pro-small", "velodyne-16", "tls")


class Room(NamedTuple):
    """The room, where the sensor stands, and how the reader sees it."""

    primitives: Primitives  # R = 1
    pose: Pose
    view: np.ndarray  # (3, 3) rows: to the right, up, and away from the reader; orthonormal


class Drawing(NamedTuple):
    """The room as the reader sees it, in parallel projection."""

    color: np.ndarray  # (height, width, 3) shaded by incidence
    depth: np.ndarray  # (height, width) [m] along the view; inf beside the room
    extent: tuple[float, float, float, float]  # [m] left, right, bottom, top


def main(path: Path) -> None:
    save(draw(), path)


@styled
def draw() -> Figure:
    """The room, what every preset sees of it, and what errors do to three of them."""
    room = make_room()
    drawing = render(room)
    figure = Figure((12.6, 11.6))
    draw_room(_panel(figure, 0), room, drawing)
    for number, (name, text) in enumerate(TITLES.items(), start=1):
        draw_scan(_panel(figure, number), room, drawing, name, text)
    for number, name in enumerate(CLOSE_UPS, start=6):
        draw_close_up(_panel(figure, number), room, name)
    handles = [Line2D([], [], marker="o", linewidth=0, color=color, label=name) for name, color in COLORS.values()]
    handles.append(Line2D([], [], marker="o", linewidth=0, color=GREY, label="ideal (last row)"))
    handles.append(
        Line2D([], [], marker="*", linewidth=0, markersize=11, color=BLACK, label="sensor, looking along the arrow")
    )
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False, fontsize=11)
    figure.suptitle("One room, five sensors, one place", y=0.99)
    return figure


def make_room() -> Room:
    """A room of the thesis's ranges with a free place for the sensor."""
    config, index = RoomConfig(), np.array([ROOM_NUMBER])
    primitives = make_rooms(config, SEED, index)
    pose, found = draw_poses(primitives, config.size, Standing(height=SENSOR_HEIGHT), draws.keys(SEED, index))
    assert found[0]
    azimuth, elevation = np.radians([AZIMUTH, ELEVATION])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    away = -np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    return Room(primitives, pose, np.stack([right, np.cross(right, away), away]))


def render(room: Room) -> Drawing:
    """Cast one parallel ray per pixel at the room without its lid."""
    reach = np.abs(room.view[:2]) @ (np.array(RoomConfig().size) / 2 + 0.2)
    x, y = (np.arange(-limit, limit, PIXEL) for limit in reach)
    grid = np.stack(np.meshgrid(x, y[::-1]), axis=-1)
    origin = (grid.reshape(-1, 2) @ room.view[:2] - 20.0 * room.view[2])[None]
    rays = Rays(origin.astype(np.float32), np.broadcast_to(room.view[2], origin.shape[1:]).astype(np.float32))
    present = ~np.isin(room.primitives.element, LEFT_OUT)
    distance, slot = cast_slots(room.primitives, present, rays)
    incidence = incidence_of(normals_of(room.primitives, slot, distance, rays), rays)
    hit = np.maximum(slot[0], 0)
    color = colors_of(room.primitives.element[0, hit], room.primitives.semantic[0, hit])
    shaded = color * (0.55 + 0.45 * np.nan_to_num(np.cos(incidence[0])))[:, None]
    shaded[slot[0] < 0] = 1.0
    depth = np.where(slot[0] < 0, np.inf, distance[0] - 20.0)
    shape = grid.shape[:2]
    return Drawing(shaded.reshape(*shape, 3), depth.reshape(shape), (-reach[0], reach[0], -reach[1], reach[1]))


def scan_of(room: Room, name: str) -> tuple[Scan, np.ndarray]:
    """One scan by the preset, and its points (P, 3) [m]; NaN for misses."""
    sensor = sensor_named(name)
    rays = Rays(room.pose.position, sensor.directions(), rotation_of(room.pose.yaw, room.pose.pitch))
    distance, slot = cast_slots(room.primitives, None, rays)
    incidence = incidence_of(normals_of(room.primitives, slot, distance, rays), rays)
    ideal = cast_rays(room.primitives, None, rays)
    scan = imperfect(ideal, incidence, sensor, SEED, np.array([ROOM_NUMBER]))
    return scan, points_of(room.pose, sensor.directions(), scan.distance)[0]


def colors_of(element: np.ndarray, semantic: np.ndarray) -> np.ndarray:
    """Colours (N, 3): the hue says the class, the lightness tells its elements apart."""
    table = np.ones((256, 3))
    for kind, (_, color) in COLORS.items():
        table[kind] = to_rgb(color)
    lightness = 0.45 * ((element * 0.618) % 1.0)[:, None]
    return table[semantic] * (1.0 - lightness) + lightness


def draw_room(axes: Axes, room: Room, drawing: Drawing) -> None:
    axes.imshow(drawing.color, extent=drawing.extent, interpolation="antialiased")
    axes.set_title("the room (ceiling and two walls left out)")
    _mark_sensor(axes, room.pose, room.view[:2])


def draw_scan(axes: Axes, room: Room, drawing: Drawing, name: str, text: str) -> None:
    """The points of one scan over a pale drawing of the room; points that the reader could not see are left out."""
    axes.imshow(0.88 + 0.12 * drawing.color, extent=drawing.extent, interpolation="antialiased")
    scan, points = scan_of(room, name)
    hit = np.isfinite(scan.distance[0])
    shown = np.flatnonzero(hit & ~np.isin(scan.element[0], LEFT_OUT))
    x, y, depth = room.view @ points[shown].T
    left, right, bottom, top = drawing.extent
    height, width = drawing.depth.shape
    row = np.clip(((top - y) / (top - bottom) * height).astype(int), 0, height - 1)
    column = np.clip(((x - left) / (right - left) * width).astype(int), 0, width - 1)
    seen = depth < drawing.depth[row, column] + 0.08
    color = colors_of(scan.element[0, shown], scan.semantic[0, shown])
    area = 0.35 if len(shown) > 300_000 else 0.9
    axes.scatter(x[seen], y[seen], s=area, c=color[seen], linewidths=0, rasterized=True)
    axes.set_title(f"{name}: {hit.sum():,} points\n{text}")
    _mark_sensor(axes, room.pose, room.view[:2])


def draw_close_up(axes: Axes, room: Room, name: str) -> None:
    """From above: the ideal points around the sensor in grey, and over them those of the `-real` preset."""
    for suffix, area in (("", 3.0), ("-real", 1.6)):
        scan, points = scan_of(room, name + suffix)
        low, high = room.pose.position[0, 2] - 0.35, room.pose.position[0, 2] + 0.35
        shown = (points[:, 2] > low) & (points[:, 2] < high)
        color = colors_of(scan.element[0, shown], scan.semantic[0, shown]) if suffix else GREY
        axes.scatter(*points[shown, :2].T, s=area, c=color, linewidths=0, rasterized=True)
    axes.set(
        xlim=(-5.2, 5.2), ylim=(-5.2, 5.2), title=f"{name}-real over ideal\nfrom above, within 0.35 m of its height"
    )
    _mark_sensor(axes, room.pose, np.eye(3)[:2])


def _mark_sensor(axes: Axes, pose: Pose, plane: np.ndarray) -> None:
    """A star where it stands and an arrow to where it looks, projected by `plane` (2, 3)."""
    ahead = np.append(1.8 * np.array([np.cos(np.radians(pose.yaw[0])), np.sin(np.radians(pose.yaw[0]))]), 0.0)
    start, end = plane @ pose.position[0], plane @ (pose.position[0] + ahead)
    axes.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": BLACK, "linewidth": 1.6, "shrinkA": 0})
    axes.plot(*start, "*", color=BLACK, markersize=13, markeredgecolor="white", markeredgewidth=0.8)


def _panel(figure: Figure, number: int) -> Axes:
    row, column = divmod(number, 3)
    axes = figure.add_axes((0.01 + 0.33 * column, 0.665 - 0.315 * row, 0.32, 0.262))
    axes.set_aspect("equal")
    axes.axis("off")
    return axes


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, help="image to write: .png, .pdf or .svg")
    main(parser.parse_args().path)
