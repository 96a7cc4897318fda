"""The pair as a network gets it: objects filtered out, one point a voxel.

python -m paper.figures.voxels runs/paper --out voxels.png
"""

from pathlib import Path

from matplotlib.figure import Figure

from jaxmm.reports.figures import save, styled
from jaxmm.run_folder import read_config
from paper.figures.examples import example_of, raw_pair
from paper.figures.panels import SCANS, Place, command, draw_both, inside, key, page, titled


@styled
def draw(run: Path, path: Path) -> Figure:
    """Eight pairs, with how many points were scanned and how many are left."""

    def panel(figure: Figure, place: Place, scenario: str, condition: str) -> None:
        example = example_of(run, f"{scenario}_{condition}", scenario)
        pair = raw_pair(run, scenario, condition, example.room)
        axes = draw_both(figure, inside(place, top=0.14), example.dt, example.robot)
        counts = [
            f"{name} {len(before.points):,} → {len(after):,} points"
            for name, before, after in (("DT", pair.dt, example.dt), ("robot", pair.robot, example.robot))
        ]
        axes.set_title("\n".join([f"{titled(scenario, condition)}, test room {example.room}", *counts]))

    edge = 100 * read_config(run).preprocess.voxel_size
    figure = page(f"After the object filter, one point in every voxel of {edge:g} cm", panel)
    key(figure, SCANS)
    return save(figure, path)


if __name__ == "__main__":
    command(__doc__, draw)
