"""What the four scenarios are: a test room of each from above, with what changes and what the sensor looks at.

python -m paper.figures.scenario_rooms runs/paper --out scenario_rooms.png
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from jaxmm.data.simulator_settings import CloudSource, pair_config
from jaxmm.reports.figures import BLACK, save, styled
from jaxmm.run_folder import read_config
from paper.figures.examples import example_of
from paper.figures.panels import Place, command, inside, page, titled
from paper.floor_plan import CHANGE_FILL, FURNITURE_FILL, STRUCTURE_FILL, VIEW, draw_floor_plan
from warp_scanner.rooms.scenarios import make_scenes

MARGIN = 0.3  # [m] beside the room
BEYOND = 1.0  # [m] of the view behind the middle of what changed


@styled
def draw(run: Path, path: Path) -> Figure:
    """Eight rooms; prior and reality on each other, so what is added and what is removed both show."""
    config = read_config(run)

    def panel(figure: Figure, place: Place, scenario: str, condition: str) -> None:
        room = example_of(run, f"{scenario}_{condition}", scenario).room
        pair = pair_config(config, CloudSource(scenario, scenario, condition, config.data.test_seed))
        scenes = make_scenes(pair.scene, pair.seed, np.array([room]))
        axes = figure.add_axes(inside(place, left=0.14, bottom=0.19, right=0.03, top=0.11))
        away = np.linalg.norm(scenes.box.center[0, 0, :2] - scenes.pose.position[0, :2])
        draw_floor_plan(axes, scenes, pair.sensor, float(away) + BEYOND)
        width, depth, height = scenes.size[0]
        axes.set(xlim=(-width / 2 - MARGIN, width / 2 + MARGIN), ylim=(-depth / 2 - MARGIN, depth / 2 + MARGIN))
        axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
        axes.grid(False)
        axes.set_title(f"{titled(scenario, condition)}\ntest room {room}, {height:.1f} m high")

    figure = page("The four scenarios, without and with furniture", panel)
    handles = [
        Patch(facecolor=CHANGE_FILL[1], edgecolor=BLACK, label="added: in reality only"),
        Patch(facecolor=CHANGE_FILL[-1], edgecolor=BLACK, label="removed: in the prior only"),
        Patch(facecolor=STRUCTURE_FILL, edgecolor=BLACK, label="structure: in both"),
        Patch(facecolor=FURNITURE_FILL, edgecolor=BLACK, label="furniture: in reality only"),
        Patch(**VIEW, label="where the sensor looks"),
        Line2D([], [], marker="o", linestyle="", color=BLACK, markersize=5, label="sensor"),
    ]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False)
    return save(figure, path)


if __name__ == "__main__":
    command(__doc__, draw)
