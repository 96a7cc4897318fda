"""Whether a probability means what it says: predicted against found, the thesis's network and ours.

python -m paper.figures.reliability runs/paper --out reliability.png
"""

from pathlib import Path

from matplotlib.figure import Figure

from jaxmm.config import CONDITIONS, SCENARIOS
from jaxmm.evaluate import reliability_of
from jaxmm.figures import reliability_curves
from jaxmm.files import load_json
from jaxmm.stages import STAGES
from paper.figures.panels import command

METHODS = {"xyz_nn": "thesis's network", "evidence": "evidence"}


def draw(run: Path, path: Path) -> Figure:
    """All points of all test rooms of the individual rows, true labels."""
    sums = {}
    for method, name in METHODS.items():
        for condition in CONDITIONS:
            sides = [
                room["sides"][scenario]
                for scenario in SCENARIOS
                for room in load_json(run / STAGES / "rooms" / f"{scenario}_{condition}" / "rooms.json")
            ]
            sums[f"{name}, {condition}"] = reliability_of(sides, method)
    return reliability_curves(sums, path, "Probabilities on test rooms, true labels")


if __name__ == "__main__":
    command(__doc__, draw)
