"""The thesis network as blocks, with the widths and the shapes of the run.

python -m paper.figures.network runs/paper --out network.png
"""

from pathlib import Path
from typing import NamedTuple

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

from jaxmm.config import TRAINED_METHODS, NetworkConfig
from jaxmm.reports.figures import BLACK, GREY, PALE, save, styled
from jaxmm.run_folder import read_config
from paper.figures.panels import command

FILLS = {"data": "#F1F1F1", "layer": "#E3EFF8", "summary": "#FBE9D3", "head": "#E2F3EC"}
WIDTH, HEIGHT, STEP = 1.52, 0.95, 1.95  # [inch] of a block, and from one to the next


class Block(NamedTuple):
    """One block of a row."""

    name: str
    told: str  # what is in it
    shape: str  # of what comes out
    kind: str  # key of FILLS


@styled
def draw(run: Path, path: Path) -> Figure:
    """The encoder above, the head below; the summary of the cloud joins every point again."""
    above, below = blocks_of(read_config(run).network, TRAINED_METHODS["xyz_nn"])
    across = max(len(above), len(below))
    figure = Figure((STEP * across + 0.2, 5.2))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, STEP * across + 0.2), ylim=(0, 5.2))
    axes.axis("off")
    for row, y in ((above, 3.55), (below, 1.0)):
        for column, block in enumerate(row):
            _draw_block(axes, column, y, block)
            if column:
                _arrow(axes, (_left(column - 1) + WIDTH, y + HEIGHT / 2), (_left(column), y + HEIGHT / 2))
    joined, encoded, gap = _left(0) + WIDTH / 2, _left(len(above) - 2) + WIDTH / 2, 2.85
    # Below the shapes of the row above, each with its own way down.
    for start, way, name in (
        (encoded, gap, "local: features of every point"),
        (_left(len(above) - 1) + WIDTH / 2, gap - 0.35, "global: one summary, for every point the same"),
    ):
        offset = 0.2 if way != gap else -0.2
        axes.plot([start, start, joined + offset], [3.2, way, way], color=GREY, linewidth=1.6)
        _arrow(axes, (joined + offset, way), (joined + offset, 1.0 + HEIGHT))
        axes.text(joined + 0.5, way + 0.05, name, fontsize=10, color=BLACK)
    axes.text(0.2, 4.82, "The network of the thesis", fontsize=14, fontweight="bold")
    note = "N points of one cloud. Layers act on each point alone (1 x 1 convolutions); BN: batch normalisation."
    axes.text(0.2, 0.2, note, fontsize=10, color="#444444")
    return save(figure, path)


def blocks_of(network: NetworkConfig, features: int) -> tuple[list[Block], list[Block]]:
    """The blocks of encoder and head, as network.PointNetwork puts them together."""
    *encoder, deepest = network.encoder
    drop = f"dropout {network.dropout:g}"
    above = [Block("features", "x, y, z and distance\nto the other scan", f"(N, {features})", "data")]
    above += [Block(f"dense {width}", "BN, ReLU", f"(N, {width})", "layer") for width in encoder]
    above += [Block(f"dense {deepest}", f"BN, ReLU,\n{drop}", f"(N, {deepest})", "layer")]
    above += [Block("maximum", "over all points", f"({deepest},)", "summary")]
    below = [Block("join", "each point and\nthe summary", f"(N, {2 * deepest})", "data")]
    below += [Block(f"dense {width}", f"BN, ReLU,\n{drop}", f"(N, {width})", "head") for width in network.head]
    below += [Block("dense 1", "no BN", "(N,) logits", "head")]
    below += [Block("sigmoid", "probability that\nthe point changed", "(N,)", "data")]
    return above, below


def _draw_block(axes: Axes, column: int, y: float, block: Block) -> None:
    box = FancyBboxPatch(
        (_left(column), y), WIDTH, HEIGHT, boxstyle="round,pad=0,rounding_size=0.09", facecolor=FILLS[block.kind],
        edgecolor=PALE, linewidth=1.2,
    )  # fmt: skip
    axes.add_patch(box)
    middle = _left(column) + WIDTH / 2
    axes.text(middle, y + 0.72, block.name, ha="center", va="center", fontsize=12, fontweight="bold")
    axes.text(middle, y + 0.3, block.told, ha="center", va="center", fontsize=10, linespacing=1.2)
    axes.text(middle, y - 0.22, block.shape, ha="center", va="center", fontsize=10, family="monospace")


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    style = {"arrowstyle": "-|>", "color": GREY, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 11}
    axes.annotate("", xy=end, xytext=start, arrowprops=style)


def _left(column: int) -> float:
    return 0.2 + STEP * column


if __name__ == "__main__":
    command(__doc__, draw)
