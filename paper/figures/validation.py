"""Precision and recall on validation rooms while the thesis networks of the individual models of Table I learn.

python -m paper.figures.validation runs/paper --out validation.png
"""

from pathlib import Path

from matplotlib.figure import Figure

from jaxmm.reports.figures import validation_curves
from paper.figures.panels import command, draw_training


def draw(run: Path, path: Path) -> Figure:
    """One panel a scenario; a precision is missing where nothing was called changed."""
    return draw_training(run, path, validation_curves, "Validation")


if __name__ == "__main__":
    command(__doc__, draw)
