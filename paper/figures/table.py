"""All rows of Table I at one glance: precision at 95 % recall of every method, on true labels.

    python -m paper.figures.table runs/paper --out table.png

Also draws `paper/results`, which holds the same table.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from jaxmm.files import load_json
from jaxmm.reports.figures import BLACK, save, styled
from jaxmm.runs.paper.rows import SECTIONS
from paper.figures.origin import made
from paper.figures.panels import COLORS, command

METRIC = "precision_at_95"
LOOKS = {  # method: (name, colour, marker)
    "nn-raw": ("nn-raw: the distance itself", COLORS["nn-raw"], "s"),
    "network": ("the thesis's network", COLORS["network"], "^"),
    "rule": ("rule: evidence, not learned", COLORS["rule"], "D"),
    "evidence": ("evidence", COLORS["evidence"], "o"),
}
FIRST = "generated rooms"  # of several sources of a section, the one that every machine has comes first


@styled
def draw(run: Path, path: Path) -> Figure:
    """A line a row; marks that lie at 1 are right at the edge of the axes."""
    rows = [row for row in load_json(made(run / "table_1.json"))["rows"] if row["label_kind"] == "true"]
    parts = [
        (section, source, [row for row in rows if (row["section"], row["source"]) == (section, source)])
        for section, source in sorted(
            {(row["section"], row["source"]) for row in rows},
            key=lambda one: (SECTIONS.index(one[0]), one[1] != FIRST, one),
        )
    ]
    counts = [len({(row["test_case"], row["condition"]) for row in own}) for *_, own in parts]
    half = sum(counts) / 2
    left = int(np.searchsorted(np.cumsum(counts), half)) + 1
    columns = [parts[:left], parts[left:]]
    figure = Figure((15.0, 12.0), layout="constrained")
    for column, own in zip(figure.subfigures(1, 2), columns, strict=True):
        if own:
            _column(column, own)
    figure.suptitle("Table I: precision at 95 % recall, true labels, mean over test scenes with its 95 % interval")
    known = dict(zip(*reversed(figure.subfigs[0].axes[0].get_legend_handles_labels()), strict=True))
    shown = [known[name] for name, *_ in LOOKS.values() if name in known]  # from above, as in every row
    figure.legend(handles=shown, loc="outside lower center", ncols=len(LOOKS))
    return save(figure, path)


def _column(figure: Any, parts: list[tuple[str, str, list[dict[str, Any]]]]) -> None:
    heights = [len({(row["test_case"], row["condition"]) for row in own}) + 1 for *_, own in parts]
    for axes, (section, source, own) in zip(
        figure.subplots(len(parts), 1, gridspec_kw={"height_ratios": heights}, sharex=True, squeeze=False)[:, 0],
        parts,
        strict=True,
    ):
        _panel(axes, own)
        axes.set_title(f"{section} ({source})", fontsize=10, loc="left")


def _panel(axes: Axes, rows: list[dict[str, Any]]) -> None:
    cases = list(dict.fromkeys((row["test_case"], row["condition"]) for row in rows))
    for row in rows:
        method = row["method"] if row["method"] in LOOKS else "network"
        if row[METRIC] is None:
            continue
        name, color, marker = LOOKS[method]
        place = cases.index((row["test_case"], row["condition"])) + 0.2 * (list(LOOKS).index(method) - 1.5)
        low, high = row["ci95"][METRIC] or (row[METRIC], row[METRIC])
        axes.plot([low, high], [place, place], color=color, linewidth=1.2)
        axes.plot(row[METRIC], place, marker, color=color, markersize=4.5, linestyle="", label=name, clip_on=False)
    axes.set_yticks(range(len(cases)), [f"{case.lower()}, {condition}" for case, condition in cases], fontsize=8)
    axes.set(ylim=(len(cases) - 0.4, -0.6), xlim=(0.0, 1.0))
    known = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    for handle in axes.lines:
        if handle.get_label() in known and handle is not known[handle.get_label()]:
            handle.set_label("_")
    axes.axvline(1.0, color=BLACK, linewidth=0.6)


if __name__ == "__main__":
    command(__doc__, draw)
