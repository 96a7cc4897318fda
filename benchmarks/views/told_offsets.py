"""From which offset on an element is told from one in its place: half its interval, by range and by what was seen.

Elements are dicts with `half` and `range` [m] and `coverage` (share of the surface), as `benchmarks.deviations` tells.
"""

import itertools
from pathlib import Path
from typing import Any

import numpy as np

RANGES = (0.0, 2.0, 3.0, 4.0, 6.0, 9.0, 15.0)  # [m]
SHARES = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 1.0)
LEAST = 5  # elements that tell of a bin
Elements = dict[str, list[dict[str, Any]]]  # by sensor


def told_table(found: Elements) -> list[str]:
    """Markdown lines: for each sensor the median [mm] of half the interval in each bin; a dash of few."""
    lines = []
    for name, edges, unit in (("range", RANGES, " m"), ("coverage", SHARES, "")):
        heads = [f"{low:g} to {high:g}{unit}" for low, high in itertools.pairwise(edges)]
        lines += [f"| told from zero [mm], by {name} | {' | '.join(heads)} |", f"|{' --- |' * (len(heads) + 1)}"]
        for sensor, elements in found.items():
            cells = ["-" if not np.isfinite(value) else f"{value:.1f}" for value in _medians(elements, name, edges)]
            lines.append(f"| `{sensor}` | {' | '.join(cells)} |")
        lines.append("")
    return lines


def share_with_interval(some: int, every: int) -> str:
    """So many of so many as a share with its 95 % interval (Wilson 1927); a dash of none."""
    if not every:
        return "-"
    z, share = 1.96, some / every
    middle = (share + z**2 / (2 * every)) / (1.0 + z**2 / every)
    half = z / (1.0 + z**2 / every) * np.sqrt(share * (1.0 - share) / every + z**2 / (4 * every**2))
    return f"{share:.3f} ({max(0.0, middle - half):.2f} to {min(1.0, middle + half):.2f})"


def draw_told(found: Elements, path: Path) -> None:
    """The same as curves, each element a dot, to a PNG file."""
    from matplotlib.figure import Figure

    figure = Figure((10.0, 4.2), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    axes = (("range", RANGES, "range [m]"), ("coverage", SHARES, "share of the surface seen within tolerance"))
    for axis, (name, edges, words) in zip(panels, axes, strict=True):
        for number, (sensor, elements) in enumerate(found.items()):
            known = [one for one in elements if name in one]
            tint = f"C{number}"
            halves = [1000.0 * one["half"] for one in known]
            axis.plot([one[name] for one in known], halves, ".", ms=2, color=tint, alpha=0.3)
            middles = (np.array(edges[:-1]) + np.array(edges[1:])) / 2.0
            axis.plot(middles, _medians(elements, name, edges), "o-", ms=4, color=tint, label=sensor)
        axis.set_xlim(0.0, edges[-1])
        axis.set_yscale("log")
        axis.set_xlabel(words)
        axis.grid(alpha=0.3)
    panels[0].set_ylabel("smallest offset told from zero [mm]")
    panels[0].legend()
    figure.savefig(path, dpi=130)


def _medians(elements: list[dict[str, Any]], name: str, edges: tuple[float, ...]) -> list[float]:
    known = [one for one in elements if name in one and np.isfinite(one["half"])]
    values = np.array([one[name] for one in known])
    halves = 1000.0 * np.array([one["half"] for one in known])
    inside = [(values >= low) & (values < high) for low, high in itertools.pairwise(edges)]
    return [float(np.median(halves[one])) if one.sum() >= LEAST else float("nan") for one in inside]
