"""How every figure looks and is written, and the figures of a training run.

Arrays in, one image file out. A figure is drawn in memory, written under a temporary name and renamed, so no
half-written file is ever seen; it holds no date or version, so the same input gives the same bytes. The suffix of the
path chooses the format: .png, .pdf or .svg. Every function returns the `Figure` it wrote, for notebooks.

T, V logged steps, S scenarios.
"""

import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from jaxmm.files import write_atomically
from jaxmm.learning.calibration import RELIABILITY_BINS, Reliability, brier, calibration_error

# Told apart with every kind of colour blindness: M. Okabe and K. Ito, "Color universal design", 2008.
BLACK, ORANGE, GREEN, BLUE, VERMILLION = "#000000", "#E69F00", "#009E73", "#0072B2", "#D55E00"
GREY, PALE, PURPLE, SKY = "#7F7F7F", "#BCC2C9", "#CC79A7", "#56B4E9"
COLOR_DISPLACED = "#B36B00"  # orange, dark enough for lines
COLOR_ADDED, COLOR_REMOVED, COLOR_HIDDEN = BLUE, VERMILLION, PURPLE  # in what is told of a building, and on the page
STYLE = {
    "font.size": 11.0,
    "axes.titlesize": 11.5,
    "figure.titlesize": 14.0,
    "figure.titleweight": "bold",
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#E3E3E3",
    "lines.linewidth": 1.8,
    "legend.fontsize": 9.5,
    "legend.framealpha": 0.9,
    "figure.dpi": 100.0,
    "savefig.dpi": 150.0,
    "pdf.fonttype": 42,
    "svg.hashsalt": "jaxmm",
}
UNDATED = {
    ".png": {"Software": None},
    ".pdf": {"Creator": None, "Producer": None, "CreationDate": None},
    ".svg": {"Creator": None, "Date": None},
}


class Curves(NamedTuple):
    """How the S models of one method trained."""

    scenarios: tuple[str, ...]  # S names
    step: np.ndarray  # (T,)
    train_loss: np.ndarray  # (T, S)
    validation_step: np.ndarray  # (V,) the steps that were validated
    validation_loss: np.ndarray  # (V, S)
    validation_precision: np.ndarray  # (V, S) nan where nothing was predicted
    validation_recall: np.ndarray  # (V, S)


def curves_from_records(records: Iterable[Mapping[str, Any]], method: str, scenarios: Sequence[str]) -> Curves:
    """Gather the lines of a metrics.jsonl that belong to one method.

    Args:
        records: dicts with "method", "step", "train_loss" and, where the step was validated, "validation_loss",
            "validation_precision" and "validation_recall"; each a list over scenarios, None or nan for no value.
        method: whose records to take; a step logged twice (after a resume) counts once, as last logged.
        scenarios: names of the S entries of each list.

    Raises:
        ValueError: no record of the method, or a list of another length than `scenarios`.
    """
    by_step = {record["step"]: record for record in records if record["method"] == method}
    if not by_step:
        raise ValueError(f"records must hold some of method {method!r}, got none")
    logged = [by_step[step] for step in sorted(by_step)]
    validated = [record for record in logged if "validation_loss" in record]

    def gather(rows: list, key: str) -> np.ndarray:
        for row in rows:
            if len(row[key]) != len(scenarios):
                raise ValueError(f"{key} of step {row['step']} must have {len(scenarios)} values, got {len(row[key])}")
        return np.array([row[key] for row in rows], dtype=np.float64).reshape(len(rows), len(scenarios))

    return Curves(
        tuple(scenarios),
        np.array([row["step"] for row in logged]),
        gather(logged, "train_loss"),
        np.array([row["step"] for row in validated]),
        *(gather(validated, f"validation_{name}") for name in ("loss", "precision", "recall")),
    )


def styled(draw: Callable[..., Figure]) -> Callable[..., Figure]:
    """Run a drawing function in our style, whatever the user's own settings are."""

    @functools.wraps(draw)
    def wrapped(*args, **kwargs):
        with style.context(["default", STYLE]):
            return draw(*args, **kwargs)

    return wrapped


def save(figure: Figure, path: Path | str) -> Figure:
    """Write a figure in one move; on failure nothing is left behind and an older file stays as it was.

    Raises:
        ValueError: the suffix of `path` is not a known format.
    """
    path = Path(path)
    if path.suffix not in UNDATED:
        raise ValueError(f"{path}: the suffix of a figure must be one of {sorted(UNDATED)}, got {path.suffix!r}")
    write_atomically(
        path, lambda temporary: figure.savefig(temporary, format=path.suffix[1:], metadata=UNDATED[path.suffix])
    )
    return figure


@styled
def loss_curves(curves: Curves, path: Path | str, title: str = "") -> Figure:
    """Training and validation loss over the steps, one panel a scenario, on a logarithmic scale."""
    figure, panels = _panels(curves.scenarios, title, "loss")
    for index, axes in enumerate(panels):
        axes.plot(curves.step, curves.train_loss[:, index], color=BLUE, label="training")
        axes.plot(
            curves.validation_step,
            curves.validation_loss[:, index],
            color=ORANGE,
            label="validation",
            **_marked(curves.validation_step),
        )
        axes.set_yscale("log")
    panels[0].legend()
    return save(figure, path)


@styled
def validation_curves(curves: Curves, path: Path | str, title: str = "") -> Figure:
    """Precision and recall on the validation rooms over the steps, one panel a scenario."""
    figure, panels = _panels(curves.scenarios, title, "precision, recall")
    for index, axes in enumerate(panels):
        marked = _marked(curves.validation_step)
        # The dashes let a curve be seen where both lie at 1.
        axes.plot(
            curves.validation_step, curves.validation_precision[:, index], color=BLUE, label="precision", **marked
        )
        axes.plot(
            curves.validation_step,
            curves.validation_recall[:, index],
            color=ORANGE,
            linestyle="--",
            label="recall",
            **marked,
        )
        axes.set_ylim(-0.03, 1.05)
    panels[0].legend(loc="lower right")
    return save(figure, path)


@styled
def reliability_curves(sums: Mapping[str, Reliability], path: Path | str, title: str = "") -> Figure:
    """Frequency of changed points against their predicted probability, and how many points there are of each.

    Args:
        sums: by name of a curve.
        path: file to write.
        title: above both panels.
    """
    figure = Figure((9.6, 4.2 + 0.15 * len(sums)), layout="constrained")
    axes, counts = figure.subplots(1, 2)
    axes.plot([0, 1], [0, 1], color=GREY, linestyle=":", label="perfect")
    edges = np.linspace(0.0, 1.0, RELIABILITY_BINS + 1)
    looks = zip((BLUE, ORANGE, GREEN, VERMILLION, BLACK), ("o", "s", "^", "D", "v"), strict=True)
    for (name, one), (color, marker) in zip(sums.items(), looks, strict=False):
        held = one.count > 0
        told = f"{name}: ECE {calibration_error(one):.4f}, Brier {brier(one):.4f}"
        places = one.expected[held] / one.count[held], one.found[held] / one.count[held]
        axes.plot(*places, color=color, marker=marker, markersize=5, label=told)
        counts.stairs(one.count, edges, color=color, linewidth=1.8)
    axes.set(xlabel="predicted probability", ylabel="share of points that changed", xlim=(0, 1), ylim=(0, 1.02))
    counts.set(xlabel="predicted probability", ylabel="points", yscale="log", xlim=(0, 1))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    if title:
        figure.suptitle(title)
    return save(figure, path)


def _panels(scenarios: Sequence[str], title: str, y_label: str) -> tuple[Figure, Sequence[Axes]]:
    figure = Figure((3.3 * len(scenarios) + 0.6, 3.4), layout="constrained")
    panels = figure.subplots(1, len(scenarios), sharex=True, sharey=True, squeeze=False)[0]
    for axes, scenario in zip(panels, scenarios, strict=True):
        axes.set(title=scenario.replace("_", " "), xlabel="training step")
        axes.xaxis.set_major_locator(MaxNLocator(5, integer=True))
    panels[0].set_ylabel(y_label)
    if title:
        figure.suptitle(title)
    return figure, panels


def _marked(steps: np.ndarray) -> dict[str, Any]:
    """Show the single values while they are few enough to be told apart."""
    return {"marker": "o", "markersize": 4} if len(steps) <= 30 else {}
