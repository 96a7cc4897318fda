"""Sample rooms of both presets, from above and as scans by element and by label.   python -m paper.rooms OUT.png"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import hsv_to_rgb, to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from jaxmm.reports.figures import BLACK, COLOR_ADDED, COLOR_REMOVED, GREEN, save, styled
from paper.floor_plan import FURNITURE_FILL, draw_floor_plan
from warp_scanner.rooms.pairs import PRESETS, Pairs, make_pairs
from warp_scanner.rooms.scenarios import Scenes, make_scenes
from warp_scanner.sensors.sensors import Pinhole

SENSOR = Pinhole(320, 200)
SAMPLES = {"thesis": (3, 8), "varied": (1, 4, 38, 11)}  # room numbers
SKY = "#FFFFFF"
LABELS = {
    "structure": "#C9C9C9",
    "furniture": FURNITURE_FILL,
    "added": COLOR_ADDED,
    "removed (seen in the prior)": COLOR_REMOVED,
}


def main(path: Path) -> None:
    save(draw(), path)


@styled
def draw() -> Figure:
    """One column for each sample: plan, robot scan by element, robot and DT scan by label."""
    columns = [(name, index) for name, indices in SAMPLES.items() for index in indices]
    figure = Figure((2.55 * len(columns), 9.4))
    axes = figure.subplots(4, len(columns), gridspec_kw={"height_ratios": [1.55, 1, 1, 1]})
    for column, (name, index) in enumerate(columns):
        config = dataclasses.replace(PRESETS[name], scenario="all_four", condition="occluded", sensor=SENSOR, seed=1)
        scenes, pairs = make_scenes(config.scene, config.seed, np.array([index])), make_pairs(config, np.array([index]))
        _plan(axes[0, column], scenes)
        size = " x ".join(f"{length:.1f}" for length in scenes.size[0])
        axes[0, column].set_title(f"{name}\n{size} m", fontsize=11)
        for row, picture in enumerate(
            (_by_element(pairs), _by_label(pairs, robot=True), _by_label(pairs, robot=False))
        ):
            axes[row + 1, column].imshow(picture.reshape(SENSOR.height, SENSOR.width, 3), interpolation="nearest")
            axes[row + 1, column].set(xticks=[], yticks=[])
    names = ("from above", "robot scan, a colour\nfor each element", "robot scan by label", "DT scan by label")
    for axis, name in zip(axes[:, 0], names, strict=True):
        axis.set_ylabel(name, fontsize=11)
    handles = [Patch(facecolor=color, edgecolor=BLACK, label=name) for name, color in LABELS.items()]
    handles.append(Patch(facecolor=GREEN, alpha=0.25, label="field of view"))
    figure.legend(handles=handles, loc="lower center", ncols=5, frameon=False, fontsize=11)
    figure.subplots_adjust(left=0.045, right=0.995, top=0.93, bottom=0.06, wspace=0.05, hspace=0.06)
    return figure


def _plan(axes: Axes, scenes: Scenes) -> None:
    """Room 0 seen from above, with the sensor and what it looks at; two metres beside it for scale."""
    half = scenes.size[0, :2] / 2
    reach = float(half.max()) + 0.6
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xticks=[], yticks=[])
    for side in axes.spines.values():
        side.set_visible(False)
    draw_floor_plan(axes, scenes, SENSOR)
    axes.plot([-half[0], -half[0] + 2], [-reach, -reach], color=BLACK, linewidth=3, solid_capstyle="butt")
    axes.text(-half[0] + 2.2, -reach, "2 m", fontsize=9, va="center")


def _by_element(pairs: Pairs) -> np.ndarray:
    """(P, 3) colours of the robot's rays: one of many for each element, darker where the surface is far."""
    element = pairs.robot.element[0]
    # The golden section spreads the hues of neighbouring ids; floor and ceiling stay grey.
    hue = np.column_stack([(element * 0.618034) % 1.0, np.full(len(element), 0.62), np.full(len(element), 0.95)])
    color = np.where(element[:, None] > 1, hsv_to_rgb(hue), to_rgb("#C9C9C9"))
    return _shaded(color, pairs.robot.distance[0])


def _by_label(pairs: Pairs, robot: bool) -> np.ndarray:
    """(P, 3) colours of one scan's rays by what their label is."""
    scan, changed = (pairs.robot, pairs.changed_robot) if robot else (pairs.dt, pairs.changed_dt)
    structure = np.isin(scan.semantic[0], np.arange(1, 6))
    names = np.where(structure, 0, 1)
    names = np.where(changed[0], 2 if robot else 3, names)
    return _shaded(np.array([to_rgb(color) for color in LABELS.values()])[names], scan.distance[0])


def _shaded(color: np.ndarray, distance: np.ndarray) -> np.ndarray:
    shade = 1.0 - 0.6 * np.clip(distance / 12.0, 0.0, 1.0)
    return np.where(np.isfinite(distance)[:, None], color * shade[:, None], to_rgb(SKY))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, help="image to write: .png, .pdf or .svg")
    main(parser.parse_args().path)
