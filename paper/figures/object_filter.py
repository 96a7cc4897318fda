"""What the object filter takes out of the robot scans of rooms with furniture, by height alone.

python -m paper.figures.object_filter runs/paper --out object_filter.png
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxmm.learning.preprocess import object_filter
from jaxmm.reports.figures import BLACK, GREY, ORANGE, VERMILLION, save, styled
from paper.figures.examples import RawPair, example_of, raw_pair
from paper.figures.panels import Place, command, dots, few, grid, inside, key, room_panel, titled
from warp_scanner.scenes.scenes import STRUCTURE

BEFORE, AFTER = "before", "after"
COLORS = {
    "structure, kept": GREY,
    "furniture, dropped": VERMILLION,
    "furniture, kept: it reaches as high as structure": ORANGE,
    "structure, dropped: too little of it was seen": BLACK,
}


@styled
def draw(run: Path, path: Path) -> Figure:
    """Above what was scanned, below what is left; the filter never sees what is furniture, only how high it reaches."""
    rooms, seen = {}, set()

    def panel(figure: Figure, place: Place, scenario: str, when: str) -> None:
        if scenario not in rooms:
            number = example_of(run, f"{scenario}_occluded", scenario).room
            rooms[scenario] = number, raw_pair(run, scenario, "occluded", number)
        room, pair = rooms[scenario]
        kept, kind = kept_of(pair), kinds_of(pair)
        axes, shown = room_panel(figure, inside(place), pair.robot.points, pair.robot.changed | ~kept)
        seen.update(np.unique(kind))
        chosen = few(len(shown))
        chosen = chosen[shown[chosen] & (kept[chosen] | (when == BEFORE))]
        colors = np.array(list(COLORS.values()))[kind[chosen]]
        dots(axes, pair.robot.points[chosen], colors, shown[few(len(shown))], s=2.5)
        count = kept.sum() if when == AFTER else len(kept)
        axes.set_title(f"{titled(scenario, 'occluded')}, test room {room}\n{when}: {count:,} points")

    figure = grid("The object filter on robot scans", (BEFORE, AFTER), panel, 0.05, (17.0, 8.6))
    key(figure, {name: color for number, (name, color) in enumerate(COLORS.items()) if number in seen})
    return save(figure, path)


def kept_of(pair: RawPair) -> np.ndarray:
    """(N,) bool: which returns of the robot scan the thesis's filter, by height, lets through."""
    half = float(pair.pairs.size[0, 2]) / 2
    height = pair.config.preprocess.filter_height
    return object_filter(pair.robot.points, pair.robot.element, -half, half, height)


def kinds_of(pair: RawPair) -> np.ndarray:
    """(N,) which of COLORS each return of the robot scan is, as an index."""
    structure, kept = np.isin(pair.robot.semantic, STRUCTURE), kept_of(pair)
    return np.select([structure & kept, ~structure & ~kept, ~structure & kept], [0, 1, 2], 3)


if __name__ == "__main__":
    command(__doc__, draw)
