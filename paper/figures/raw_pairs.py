"""Both scans of a test room of every scenario on each other, before any filter.

python -m paper.figures.raw_pairs runs/paper --out raw_pairs.png
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxmm.figures import BLUE, ORANGE, save, styled
from paper.figures.panels import (
    Place,
    command,
    dots,
    example_of,
    inside,
    key,
    mixed,
    page,
    raw_pair,
    room_panel,
    titled,
)


@styled
def draw(run: Path, path: Path) -> Figure:
    """Eight pairs; one colour alone is where the scans differ: a change, furniture, or its shadow."""

    def panel(figure: Figure, place: Place, scenario: str, condition: str) -> None:
        room = example_of(run, f"{scenario}_{condition}", scenario).room
        pair = raw_pair(run, scenario, condition, room)
        both = {
            color: np.column_stack([scan.points, scan.changed])
            for color, scan in ((BLUE, pair.dt), (ORANGE, pair.robot))
        }
        rows, color = mixed(both)
        axes, shown = room_panel(figure, inside(place), rows[:, :3], rows[:, 3] > 0)
        dots(axes, rows[shown, :3], color[shown], shown, s=2.5)
        axes.set_title(f"{titled(scenario, condition)}\ntest room {room}")

    figure = page("A raw pair: scan of the prior and scan of reality", panel)
    key(figure, {"DT scan": BLUE, "robot scan (where colours mix, both see the same)": ORANGE})
    return save(figure, path)


if __name__ == "__main__":
    command(__doc__, draw)
