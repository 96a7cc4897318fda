"""A generated room seen from above: what stands in it, what changed, the sensor and what it looks at.

World frame: metres.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

from jaxmm.reports.figures import BLACK, COLOR_ADDED, COLOR_REMOVED, GREEN
from warp_scanner.rooms.scenarios import Scenes
from warp_scanner.scenes.scenes import CEILING, CYLINDER, FLOOR, GAP, Primitives, is_structure
from warp_scanner.sensors.sensors import Sensor

STRUCTURE_FILL, FURNITURE_FILL = "#8A8A8A", "#E9DCC3"
CHANGE_FILL = {1: COLOR_ADDED, -1: COLOR_REMOVED}
VIEW = {"color": GREEN, "alpha": 0.3, "linewidth": 0}


def draw_floor_plan(axes: Axes, scenes: Scenes, sensor: Sensor, reach: float = 3.0) -> None:
    """Draw room 0 of some scenes; the sensor's view is drawn as far as `reach` [m]."""
    table, pose = scenes.primitives, scenes.pose
    angle = np.radians(pose.yaw[0] + np.linspace(*sensor.azimuths, 9))
    view = pose.position[0, :2] + reach * np.column_stack([np.cos(angle), np.sin(angle)])
    axes.add_patch(Polygon(np.vstack([pose.position[0, :2], view]), zorder=0.5, **VIEW))
    structure, there = is_structure(table)[0], scenes.in_prior[0] | scenes.in_real[0]
    height = table.center[0, :, 2] + table.half_size[0, :, 2]
    for slot in np.argsort(height, kind="stable"):
        if not there[slot] or table.kind[0, slot] == GAP or table.semantic[0, slot] in (FLOOR, CEILING):
            continue
        plain = STRUCTURE_FILL if structure[slot] else FURNITURE_FILL
        fill = CHANGE_FILL.get(int(scenes.change[0, slot]))
        # Black edges would hide the colour of a thin wall.
        edge = {"edgecolor": BLACK, "linewidth": 0.4} if fill is None else {"edgecolor": fill, "linewidth": 1.5}
        axes.add_patch(_outline(table, slot, facecolor=fill or plain, **edge))
    axes.plot(*pose.position[0, :2], "o", color=BLACK, markersize=5, zorder=4)


def _outline(table: Primitives, slot: int, **style) -> Polygon | Circle:
    center, half, yaw = table.center[0, slot, :2], table.half_size[0, slot, :2], float(table.yaw[0, slot])
    if table.kind[0, slot] == CYLINDER:
        return Circle(center, half[0], **style)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
    return Polygon(corners @ turn + center, **style)
