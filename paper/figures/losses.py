"""Training and validation loss of the thesis networks behind the individual models of Table I.

python -m paper.figures.losses runs/paper --out losses.png
"""

from pathlib import Path

from matplotlib.figure import Figure

from jaxmm.reports.figures import loss_curves
from paper.figures.panels import command, draw_training


def draw(run: Path, path: Path) -> Figure:
    """One panel a scenario."""
    return draw_training(run, path, loss_curves, "Loss")


if __name__ == "__main__":
    command(__doc__, draw)
