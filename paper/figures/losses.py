"""Training and validation loss of the thesis networks behind the individual models of Table I.

python -m paper.figures.losses runs/paper --out losses.png
"""

from pathlib import Path

from matplotlib.figure import Figure

from jaxmm.figures import loss_curves, styled
from paper.figures.panels import command, training_curves


@styled
def draw(run: Path, path: Path) -> Figure:
    """One panel a scenario."""
    title = "Loss of the thesis networks (coordinates and distance, augmented)"
    return loss_curves(training_curves(run, "xyz_nn"), path, title)


if __name__ == "__main__":
    command(__doc__, draw)
