"""How small, how far and how slantwise a changed object can be before `detect` misses it: a figure out of a benchmark.

    python paper/limits.py runs/detections --figure limits.png

Reads what `python -m benchmarks.detections --out runs/detections` wrote, and makes nothing anew.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxmm.files import load_json
from jaxmm.reports.figures import save, styled

KINDS = (("pillar", "added"), ("pillar", "removed"), ("wall", "added"), ("wall", "removed"))
STYLES = {("pillar", "added"): ("#0072B2", "o-"), ("pillar", "removed"): ("#D55E00", "o--"),
          ("wall", "added"): ("#56B4E9", "s-"), ("wall", "removed"): ("#E69F00", "s--")}  # fmt: skip
PANELS = (
    ("shown", "observable fraction", np.array([0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0])),
    ("size", "longer edge of the footprint [m]", np.array([0.0, 0.25, 0.4, 0.6, 1.0, 1.6, 2.5, 5.0])),
    ("range", "distance from the sensor [m]", np.array([0.0, 1.5, 3.0, 4.5, 6.0, 8.0, 11.0, 20.0])),
    ("incidence", "angle to the broad side's normal [°]", np.array([0.0, 15.0, 30.0, 45.0, 60.0, 70.0, 80.0, 90.0])),
)
LEAST_SHOWN = 0.2  # of the objects in all panels but the first
LEAST_OBJECTS = 8  # in a bin that is drawn


@styled
def limits(objects: list[dict], path: Path) -> Figure:
    """Recall of the default preset against what makes an object hard to see."""
    figure = Figure(figsize=(9.0, 6.4), layout="constrained")
    for axes, (name, label, edges) in zip(figure.subplots(2, 2).ravel(), PANELS, strict=True):
        for kind in KINDS:
            own = [one for one in objects if (one["type"], one["change"]) == kind]
            if name != "shown":
                own = [one for one in own if one["shown"] >= LEAST_SHOWN]
            middle, recall, spread = _binned(own, name, edges)
            color, style = STYLES[kind]
            axes.errorbar(middle, recall, yerr=spread, fmt=style, color=color, capsize=2, label=" ".join(kind))
        whose = "share found" if name == "shown" else "found, of those that show a fifth"
        axes.set(xlabel=label, ylabel=whose, ylim=(-0.03, 1.05))
    figure.axes[0].set_xscale("symlog", linthresh=0.02)
    ticks = [0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0]
    figure.axes[0].set(xlim=(-0.002, 1.1), xticks=ticks, xticklabels=[f"{tick:g}" for tick in ticks])
    figure.axes[0].minorticks_off()
    figure.axes[1].legend(loc="lower right", ncols=2)
    figure.suptitle("How many changed objects are found")
    return save(figure, path)


def _binned(objects: list[dict], name: str, edges: np.ndarray) -> tuple[list[float], list[float], np.ndarray]:
    """Median of each bin that holds enough, the share found there, and its Wilson interval of 95 %."""
    middle, recall, below, above = [], [], [], []
    values, found = np.array([one[name] for one in objects]), np.array([one["found"] for one in objects], bool)
    for low, high in pairwise(edges):
        inside = (values >= low) & ((values < high) | (high == edges[-1]))
        count = int(inside.sum())
        if count < LEAST_OBJECTS:
            continue
        share, z = found[inside].mean(), 1.96
        centre = (share + z**2 / (2 * count)) / (1 + z**2 / count)
        half = z * np.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
        middle.append(float(np.median(values[inside])))
        recall.append(float(share))
        below.append(max(share - (centre - half), 0.0))
        above.append(max(centre + half - share, 0.0))
    return middle, recall, np.array([below, above]).reshape(2, -1)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="RUN")
    parser.add_argument("--figure", type=Path, required=True, metavar="FILE")
    asked = parser.parse_args()
    rooms = [room for path in sorted(asked.folder.glob("*.json")) for room in load_json(path)]
    limits([one for room in rooms for one in room["default"]["objects"]], asked.figure)
