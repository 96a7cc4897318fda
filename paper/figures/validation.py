"""Precision and recall on validation rooms while the thesis networks of the individual models of Table I learn.

python -m paper.figures.validation runs/paper --out validation.png
"""

from pathlib import Path

from matplotlib.figure import Figure

from jaxmm.figures import styled, validation_curves
from paper.figures.panels import command, training_curves


@styled
def draw(run: Path, path: Path) -> Figure:
    """One panel a scenario; a precision is missing where nothing was called changed."""
    title = "Validation of the thesis networks (coordinates and distance, augmented)"
    return validation_curves(training_curves(run, "xyz_nn"), path, title)


if __name__ == "__main__":
    command(__doc__, draw)
