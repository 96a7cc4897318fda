"""Both scans of a test room of every scenario on each other, before any filter.

python -m paper.figures.raw_pairs runs/paper --out raw_pairs.png
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxmm.reports.figures import save, styled
from paper.figures.examples import example_of, raw_pair
from paper.figures.panels import SCANS, Place, command, draw_both, inside, key, page, titled


@styled
def draw(run: Path, path: Path) -> Figure:
    """Eight pairs; one colour alone is where the scans differ: a change, furniture, or its shadow."""

    def panel(figure: Figure, place: Place, scenario: str, condition: str) -> None:
        room = example_of(run, f"{scenario}_{condition}", scenario).room
        pair = raw_pair(run, scenario, condition, room)
        dt, robot = (np.column_stack([scan.points, scan.changed]) for scan in (pair.dt, pair.robot))
        axes = draw_both(figure, inside(place), dt, robot, s=2.5)
        axes.set_title(f"{titled(scenario, condition)}\ntest room {room}")

    figure = page("A raw pair: scan of the prior and scan of reality", panel)
    key(figure, SCANS)
    return save(figure, path)


if __name__ == "__main__":
    command(__doc__, draw)
