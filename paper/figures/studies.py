"""Curves that the thesis could not draw: more training rooms, more furniture, noisier ranges, poses that are off.

    python -m paper.figures.studies runs/paper --out studies.png

Also draws `paper/results`. Means over the four scenarios, occluded rooms, true labels.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmm.files import load_json
from jaxmm.reports.figures import save, styled
from paper.figures.origin import made
from paper.figures.panels import COLORS, command

STUDIES = {  # study: (title, label of x, logarithmic)
    "training rooms": ("training rooms (compact networks)", "pairs of scans", True),
    "furniture": ("furniture", "places for tables and chairs", False),
    "range noise": ("noise of ranges", "standard deviation [m]", False),
    "misalignment": ("pose that is off, as it comes", "error [m], with 20° a metre", False),
    "misalignment, registered": ("the same after registration", "error [m], with 20° a metre", False),
}
METRICS = {"roc_auc": "ROC AUC", "precision_at_95": "precision at 95 % recall"}
LOOKS = {
    "nn-raw": (COLORS["nn-raw"], "s", ":"),
    "nn": (COLORS["network"], "^", "-."),
    "rule": (COLORS["rule"], "D", "--"),
    "evidence": (COLORS["evidence"], "o", "-"),
}


@styled
def draw(run: Path, path: Path) -> Figure:
    """A column a study; whiskers reach from the worst scenario to the best."""
    rows = load_json(made(run / "studies.json"))["rows"]
    shown = [name for name in STUDIES if any(row["study"] == name for row in rows)]
    figure = Figure((3.6 * len(shown), 7.0), layout="constrained")
    grid = figure.subplots(len(METRICS), len(shown), squeeze=False, sharex="col")
    for column, name in enumerate(shown):
        title, label, logarithmic = STUDIES[name]
        own = [row for row in rows if row["study"] == name]
        for axes, metric in zip(grid[:, column], METRICS, strict=True):
            _panel(axes, own, metric)
            if logarithmic:
                levels = sorted({row["level"] for row in own if row["level"] is not None})
                axes.set_xscale("log")
                axes.set_xticks(levels, [f"{level:,}" for level in levels])
                axes.minorticks_off()
            axes.set_ylim(top=1.01)
        grid[0, column].set_title(title, fontsize=10.5)
        grid[-1, column].set_xlabel(label)
    for axes, label in zip(grid[:, 0], METRICS.values(), strict=True):
        axes.set_ylabel(label)
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(LOOKS))
    figure.suptitle("Harder scenes and more rooms: mean over the four scenarios, whiskers from the worst to the best")
    return save(figure, path)


def _panel(axes: Axes, rows: list[dict[str, Any]], metric: str) -> None:
    levels = sorted({row["level"] for row in rows if row["level"] is not None})
    for method, (color, marker, line) in LOOKS.items():
        points = {
            level: [
                row[metric]
                for row in rows
                if (row["level"], row["method"]) == (level, method) and row[metric] is not None
            ]
            for level in (*levels, None)
        }
        if points[None]:  # what does not learn is the same whatever the number of rooms
            axes.axhline(np.mean(points[None]), color=color, linestyle=line, label=method)
        at = [level for level in levels if points[level]]
        if not at:
            continue
        mean = np.array([np.mean(points[level]) for level in at])
        ends = np.array([[min(points[level]), max(points[level])] for level in at]).T
        axes.errorbar(
            at, mean, yerr=np.abs(ends - mean), color=color, marker=marker, linestyle=line, capsize=2, elinewidth=0.8,
            markersize=5, label=method,
        )  # fmt: skip


if __name__ == "__main__":
    command(__doc__, draw)
