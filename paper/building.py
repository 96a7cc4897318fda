"""What scanners see of a building, and one change in it.   python -m paper.building FILE.ifc --out FIGURE.png

Takes seconds, and whatever file `jaxmm scan` takes. From one free place a full sphere, and a pair of scans by a depth
camera that differ in one wall or column. All is rays cast at the building's triangles; positions are world coordinates,
metres. P rays.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Polygon

from jaxmm.reports.figures import BLACK, COLOR_ADDED, COLOR_REMOVED, GREEN, GREY, ORANGE, PALE, save, styled
from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.pairs import BuildingPairConfig, make_building_pairs
from warp_scanner.buildings.positions import check_position
from warp_scanner.rooms.pairs import Pairs
from warp_scanner.rooms.scenarios import SCENARIOS
from warp_scanner.scenes import scenes
from warp_scanner.scenes.building import Building, bounds
from warp_scanner.sensors.poses import Pose, rotation_of
from warp_scanner.sensors.scan import Rays, Scan
from warp_scanner.sensors.sensors import Pinhole, Spinning
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, prepare

CUT = 0.3  # [m] above the sensor, where the plan looks down from
UNDER = 0.05  # [m] a wall that ends this little below a floor's surface stands on it
CANDIDATES = 8  # pairs of which the one that shows most of its change is drawn
SLAB = 0.05  # [m] above and below the sensor, of the points of the sphere drawn in the plan
FURNITURE_FILL, STRUCTURE_FILL = "#E9DCC3", "#C9C9C9"
CLASSES = {
    scenes.FLOOR: ("floor", "#A89F8F"),
    scenes.CEILING: ("ceiling, roof", PALE),
    scenes.WALL: ("wall", "#56B4E9"),
    scenes.PILLAR: ("column", "#CC79A7"),
    scenes.DOOR: ("door", GREEN),
    scenes.WINDOW: ("window", "#F0E442"),
    scenes.FURNITURE: ("furniture", ORANGE),
    scenes.OTHER: ("other", GREY),
}
LABELS = {
    "structure": STRUCTURE_FILL,
    "all else": FURNITURE_FILL,
    "added": COLOR_ADDED,
    "removed (seen in the prior)": COLOR_REMOVED,
}


class Detail(NamedTuple):
    """How finely all is drawn."""

    sphere: tuple[int, int] = (1440, 720)  # columns and rows
    image: tuple[int, int] = (640, 400)
    plan: int = 1100  # pixels along its longer side


FINE = Detail()


class View(NamedTuple):
    """A building, and where it is looked at from."""

    building: Building
    scene: TriangleScene
    pose: Pose  # one, as an offset from the building's origin


class Plan(NamedTuple):
    """A building from above, cut open: what lies below every pixel."""

    scan: Scan  # one view of rows x columns rays
    shape: tuple[int, int]
    extent: tuple[float, float, float, float]  # [m] left, right, bottom, top; world


def main(
    path: Path, out: Path, pose: np.ndarray | None = None, scenario: str = "wall_added", detail: Detail = FINE
) -> None:
    """Draw the building from a pose (x, y, z [m], yaw and pitch [deg], world), or where the pair was drawn.

    Raises:
        ValueError: no readable building, a pose where no sensor can be, nothing to remove.
        RuntimeError: no place where a sensor sees such a change.
    """
    building = read_building(path)
    save(draw(building, path.stem, pose, scenario, detail), out)


@styled
def draw(building: Building, name: str, pose: np.ndarray | None, scenario: str, detail: Detail) -> Figure:
    """The plan, the sphere by element and by range, and the pair."""
    camera = Pinhole(*detail.image)
    scene = prepare(building.triangles)
    if pose is not None:
        check_position(building, scene, pose[:3])
    pairs = pair_of(building, scenario, camera)
    view = View(building, scene, pairs.pose if pose is None else pose_of(building, pose))

    figure = Figure((14.6, 11.2))
    grid = figure.add_gridspec(
        3, 12, height_ratios=(1, 1, 0.95), left=0.05, right=0.965, top=0.925, bottom=0.09, hspace=0.3, wspace=0.9
    )
    draw_plan(figure.add_subplot(grid[:2, :6]), view, pairs, detail)
    draw_sphere([figure.add_subplot(grid[row, 6:]) for row in (0, 1)], view, detail)
    draw_pair([figure.add_subplot(grid[2, 4 * part : 4 * part + 4]) for part in range(3)], pairs, camera)
    shown = np.unique(building.elements.semantic)
    handles = [Patch(facecolor=color, edgecolor=BLACK, label=text) for kind, (text, color) in CLASSES.items()
               if kind in shown]  # fmt: skip
    figure.legend(handles=handles, loc="lower left", bbox_to_anchor=(0.04, 0.0), ncols=8, frameon=False)
    handles = [Patch(facecolor=color, edgecolor=BLACK, label=text) for text, color in LABELS.items()]
    figure.legend(handles=handles, loc="lower right", bbox_to_anchor=(0.97, 0.0), ncols=4, frameon=False)
    figure.suptitle(f"{name}: {len(building.elements.guid)} elements, {len(building.triangles.faces):,} triangles")
    return figure


def pose_of(building: Building, pose: np.ndarray) -> Pose:
    """A pose (5,) in world coordinates as an offset from the building's origin."""
    position = (pose[:3] - building.origin).astype(np.float32)
    return Pose(position[None], pose[3:4].astype(np.float32), pose[4:5].astype(np.float32))


def pair_of(building: Building, scenario: str, camera: Pinhole) -> Pairs:
    """Of a few pairs the one that shows most of its change, up to a quarter of the image."""
    index = np.arange(CANDIDATES)
    few = make_building_pairs(building, BuildingPairConfig(scenario=scenario, sensor=Pinhole(80, 50)), index)
    told = (few.changed_dt & few.testable_dt) | (few.changed_robot & few.testable_robot)
    best = index[[np.argmax(np.minimum(told.mean(axis=1), 0.25))]]
    return make_building_pairs(building, BuildingPairConfig(scenario=scenario, sensor=camera), best)


def plan_of(view: View, pixels: int) -> Plan:
    """Look straight down from a little above the sensor, over the whole building."""
    low, high = (
        corner[:2] - margin for corner, margin in zip(bounds(view.building.triangles), (0.5, -0.5), strict=True)
    )
    step = float((high - low).max()) / pixels
    x, y = (np.arange(start + step / 2, stop, step) for start, stop in zip(low, high, strict=True))
    grid = np.stack(np.meshgrid(x, y[::-1], [view.pose.position[0, 2] + CUT]), axis=-1).reshape(-1, 3)
    down = np.broadcast_to(np.array([0.0, 0.0, -1.0], np.float32), grid.shape)
    rays = Rays(grid.astype(np.float32)[None], down)
    scan = cast_triangles(view.scene, rays)
    # What is cut through shows its own underside, though the floor that it stands on is as near.
    upright = ~np.isin(view.building.elements.semantic, (scenes.FLOOR, scenes.CEILING))
    cut = cast_triangles(view.scene, rays, upright)
    scan = Scan(*(np.where(cut.distance <= scan.distance + UNDER, a, b) for a, b in zip(cut, scan, strict=True)))
    return Plan(scan, (len(y), len(x)), _shifted(view.building, (low[0], high[0], low[1], high[1])))


def sphere_of(view: View, size: tuple[int, int]) -> tuple[Scan, np.ndarray]:
    """One scan in all directions by columns x rows level rays, and its points (P, 3) world; NaN for misses."""
    sensor = Spinning(size[0], size[1], elevation_range=(-90.0, 90.0))
    rotation, directions = rotation_of(view.pose.yaw, [0.0]), sensor.directions()
    scan = cast_triangles(view.scene, Rays(view.pose.position, directions, rotation))
    reach = np.where(np.isfinite(scan.distance[0]), scan.distance[0], np.nan).astype(np.float64)
    place = view.building.origin + view.pose.position[0].astype(np.float64)
    return scan, place + reach[:, None] * (directions @ rotation[0].T)


def draw_plan(axes: Axes, view: View, pairs: Pairs, detail: Detail) -> None:
    """The storey around the sensor with what the sphere met at its height, and the changed object."""
    plan = plan_of(view, detail.plan)
    color = colors_of(plan.scan)
    # What lies deeper than this storey's floor is outside, or below.
    deep = np.clip((plan.scan.distance[0] - 2.0) / 2.0, 0.0, 1.0)[:, None]
    color = outlined(color * (1.0 - 0.75 * deep) + 0.75 * deep, plan.scan, plan.shape)
    axes.imshow(color, extent=plan.extent, interpolation="antialiased")
    _, points = sphere_of(view, (4 * detail.sphere[0], 181))
    place = view.building.origin + view.pose.position[0]
    level = points[np.abs(points[:, 2] - place[2]) < SLAB]
    axes.scatter(*level[:, :2].T, s=1.2, color=BLACK, linewidths=0, rasterized=True)
    _mark(axes, place, view.pose.yaw[0], BLACK)
    there = view.building.origin + pairs.pose.position[0]
    if np.any(np.abs(there - place) > 1e-6):
        _mark(axes, there, pairs.pose.yaw[0], GREY)
    fill = COLOR_ADDED if pairs.box.change[0, 0] > 0 else COLOR_REMOVED
    corners = _footprint(view.building, pairs)
    axes.add_patch(Polygon(corners, facecolor=fill, edgecolor=BLACK, linewidth=0.8, zorder=5))
    # What is added may stand beside a building without floors.
    left, bottom = np.minimum(corners.min(axis=0) - 0.5, [plan.extent[0], plan.extent[2]])
    right, top = np.maximum(corners.max(axis=0) + 0.5, [plan.extent[1], plan.extent[3]])
    axes.set(
        xlabel="x [m]", ylabel="y [m]", xlim=(left, right), ylim=(bottom, top),
        title=f"from above, cut at z = {place[2] + CUT:.2f} m; black: what the sphere met at its height",
    )  # fmt: skip
    axes.ticklabel_format(useOffset=False, style="plain")
    axes.grid(False)


def draw_sphere(both: list[Axes], view: View, detail: Detail) -> None:
    """The scan in all directions, a colour for each element and one for each range."""
    scan, _ = sphere_of(view, detail.sphere)
    shape, extent = detail.sphere[::-1], (180.0, -180.0, -90.0, 90.0)
    place = ", ".join(f"{value:.2f}" for value in view.building.origin + view.pose.position[0])
    both[0].imshow(outlined(shaded(colors_of(scan), scan), scan, shape), extent=extent, interpolation="antialiased")
    both[0].set_title(f"full sphere from ({place}) m, by element")
    distance = np.where(np.isfinite(scan.distance[0]), scan.distance[0], np.nan).reshape(shape)
    # One far glimpse through a door must not take all of the colours.
    top = float(np.nanpercentile(distance, 98)) if np.isfinite(distance).any() else 1.0
    image = both[1].imshow(distance, extent=extent, cmap="viridis", vmin=0.0, vmax=top, interpolation="antialiased")
    both[1].set_title(f"the same by range; {np.isfinite(distance).mean():.0%} of the rays return")
    for axes in both:
        axes.set(xlabel="azimuth [°], left of forward", ylabel="elevation [°]")
        axes.set(xticks=range(180, -181, -60), yticks=range(-90, 91, 30))
        axes.grid(False)
        bar = axes.inset_axes((1.015, 0.0, 0.018, 1.0))
        if axes is both[0]:
            bar.axis("off")  # keeps the two as wide
        else:
            axes.figure.colorbar(image, cax=bar, label="range [m]", extend="max")
            bar.grid(False)


def draw_pair(three: list[Axes], pairs: Pairs, camera: Pinhole) -> None:
    """The prior by element, and both scans by true label."""
    box = pairs.box
    word = "added" if box.change[0, 0] > 0 else "removed"
    size = " x ".join(f"{length:.2f}" for length in box.size[0, 0])
    kind = CLASSES[int(box.object_type[0, 0])][0]
    pictures = (
        (outlined(shaded(colors_of(pairs.dt), pairs.dt), pairs.dt, camera.shape), "DT scan (of the prior), by element"),
        (labelled(pairs.dt, pairs.changed_dt, "removed (seen in the prior)", camera.shape), "DT scan, by true label"),
        (labelled(pairs.robot, pairs.changed_robot, "added", camera.shape), f"robot scan: {kind} {word}, {size} m"),
    )
    for axes, (picture, title) in zip(three, pictures, strict=True):
        axes.imshow(picture, interpolation="antialiased")
        axes.set(title=title, xlabel="column [pixels]")
        axes.grid(False)
    three[0].set_ylabel("row [pixels]")


def colors_of(scan: Scan) -> np.ndarray:
    """Colours (P, 3) of view 0: the hue says the class, the lightness tells its elements apart; white for misses."""
    table = np.tile(to_rgb(CLASSES[scenes.OTHER][1]), (256, 1))
    for kind, (_, color) in CLASSES.items():
        table[kind] = to_rgb(color)
    table[[scenes.TABLE, scenes.CHAIR]] = table[scenes.FURNITURE]
    # The golden section spreads the lightness of neighbouring ids.
    lightness = 0.45 * ((scan.element[0] * 0.618034) % 1.0)[:, None]
    color = table[scan.semantic[0]] * (1.0 - lightness) + lightness
    return np.where(scan.element[0][:, None] >= 0, color, 1.0)


def shaded(color: np.ndarray, scan: Scan) -> np.ndarray:
    """Colours (P, 3), darker where the surface is far."""
    shade = 1.0 - 0.55 * np.clip(scan.distance[0] / 12.0, 0.0, 1.0)
    return np.where(np.isfinite(scan.distance[0])[:, None], color * shade[:, None], color)


def outlined(color: np.ndarray, scan: Scan, shape: tuple[int, int]) -> np.ndarray:
    """Colours as a picture (rows, columns, 3) with dark lines between elements."""
    picture, element = color.reshape(*shape, 3).copy(), scan.element[0].reshape(shape)
    border = np.zeros(shape, bool)
    border[:, 1:] |= element[:, 1:] != element[:, :-1]
    border[1:] |= element[1:] != element[:-1]
    picture[border] *= 0.35
    return picture


def labelled(scan: Scan, changed: np.ndarray, name: str, shape: tuple[int, int]) -> np.ndarray:
    """A picture (rows, columns, 3) of view 0: structure, all else, and what has changed."""
    names = list(LABELS)
    kind = np.where(np.isin(scan.semantic[0], scenes.STRUCTURE), 0, 1)
    kind = np.where(changed[0], names.index(name), kind)
    color = np.array([to_rgb(color) for color in LABELS.values()])[kind]
    color[scan.element[0] < 0] = 1.0
    # Shaded, a change that is far away would look like another colour.
    return outlined(np.where(changed[0][:, None], color, shaded(color, scan)), scan, shape)


def _footprint(building: Building, pairs: Pairs) -> np.ndarray:
    """Corners (4, 2) of the changed object seen from above, world."""
    half, yaw = pairs.box.size[0, 0, :2] / 2, np.radians(pairs.box.yaw[0, 0])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    return building.origin[:2] + pairs.box.center[0, 0, :2] + corners @ turn


def _shifted(building: Building, extent: tuple[float, ...]) -> tuple[float, ...]:
    """Left, right, bottom, top in world coordinates."""
    return tuple(float(value + building.origin[place // 2]) for place, value in enumerate(extent))


def _mark(axes: Axes, place: np.ndarray, yaw: float, color: str) -> None:
    """A star where a sensor stands, and an arrow to where it looks."""
    ahead = 1.6 * np.array([np.cos(np.radians(yaw)), np.sin(np.radians(yaw))])
    arrow = {"arrowstyle": "-|>", "color": color, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=place[:2] + ahead, xytext=place[:2], arrowprops=arrow, zorder=6)
    axes.plot(*place[:2], "*", color=color, markeredgecolor="white", markersize=15, zorder=7)


def _pose(text: str) -> np.ndarray:
    values = [float(value) for value in text.split(",")]
    if len(values) not in (4, 5) or not np.isfinite(values).all():
        raise ValueError(text)
    return np.array([*values, 0.0][:5])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, help="building: .ifc, or a mesh file whose nodes are named after classes")
    parser.add_argument("--out", type=Path, required=True, help="image to write: .png, .pdf or .svg")
    parser.add_argument(
        "--pose", type=_pose, metavar="=X,Y,Z,YAW[,PITCH]", help="metres, degrees; default: a free place"
    )
    parser.add_argument("--scenario", choices=SCENARIOS, default="wall_added", help="default: wall_added")
    options = parser.parse_args()
    try:
        main(options.path, options.out, options.pose, options.scenario)
    except (ValueError, RuntimeError, ImportError, OSError) as error:
        parser.exit(2, f"paper.building: {error}\n")
