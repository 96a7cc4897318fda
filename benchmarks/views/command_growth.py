"""How what whole commands take grows with their work: points, elements, stations, pairs, and the cores that share it.

A curve is one command at several sizes, each in a process of its own, after one that is not counted. Its *exponent* is
the slope of the logarithm of computing over that of the size: 1 grows as the work does, 0 not at all. Small sizes are
mostly what every command takes, so the slope between the two largest is told, too.
"""

import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from benchmarks.commands import ROOT, Usage, measured, scans_of
from benchmarks.large_scans import SEED, scanned
from benchmarks.views.scan_writers import FORMATS, Blocks
from jaxmm.reports.figures import BLUE, VERMILLION, styled
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.rooms.pairs import PairConfig
from warp_scanner.rooms.scenarios import make_scenes
from warp_scanner.scenes.scenes import BOX, CEILING, FLOOR, GAP, PILLAR, WALL, Primitives

SPACING, HEIGHT = 4.0, 3.0  # [m] from one column or wall of the hall to the next
SENSOR = "ouster-64"
PAIRS = 'seed = 0\n[scan]\npreset = "varied"\n'


class Curve(NamedTuple):
    """One command at several sizes."""

    name: str
    axis: str  # what its sizes count
    sizes: tuple[int, ...]
    usages: tuple[Usage, ...]

    @property
    def exponents(self) -> tuple[float, float]:
        """Over all sizes, and between the two largest; 0 of a single one."""
        if len(self.sizes) < 2:
            return 0.0, 0.0
        size, computing = np.log(self.sizes), np.log([one.computing for one in self.usages])
        return float(np.polyfit(size, computing, 1)[0]), float(np.diff(computing)[-1] / np.diff(size)[-1])

    def rows(self) -> list[dict[str, Any]]:
        """For the table of a benchmark; the peer is the smallest size."""
        least = self.usages[0]
        return [
            {
                "case": f"{self.name}, {size} {self.axis}", "ours": round(one.computing, 2),
                "peer": round(least.computing, 2), "peer_name": "the smallest", "unit": "s of computing",
                "ratio": round(one.computing / least.computing, 2), "seconds": round(one.seconds, 2),
                "peak_mb": round(one.peak), "exponent": round(self.exponents[0], 3),
                "last_exponent": round(self.exponents[1], 3), "size": size,
            }
            for size, one in zip(self.sizes, self.usages, strict=True)
        ]  # fmt: skip


def curves(names: Sequence[str], sizes: dict[str, tuple[int, ...]], pairs: int, folder: Path) -> Iterator[Curve]:
    """The curves of these names, one after the other, in a folder for what they need.

    Args:
        names: of CURVES.
        sizes: by name.
        pairs: that every number of workers generates.
        folder: exists; a file in it takes 24 bytes a point.
    """
    for name in names:
        axis, job = CURVES[name]
        usages = []
        for number, size in enumerate((sizes[name][0], *sizes[name])):  # the first compiles
            place = folder / f"{name}_{number}"
            place.mkdir()
            usages.append(_run(job(place, size, pairs)))
            shutil.rmtree(place)
        yield Curve(name, axis, tuple(sizes[name]), tuple(usages[1:]))


def _run(words: list[str]) -> Usage:
    return measured([sys.executable, "-m", "jaxmm", *words], os.environ | {"PYTHONPATH": str(ROOT)})


def _of_points(folder: Path, count: int, _: int) -> list[str]:
    """A furnished room with a new pillar, and so many points of it with 3 mm of noise."""
    scenes = make_scenes(PairConfig(scenario="pillar_added", condition="occluded").scene, SEED, np.array([0]))
    model, scan = folder / "room.ifc", folder / "scan.ply"
    write_room(model, scenes.primitives._replace(kind=np.where(scenes.in_prior, scenes.primitives.kind, GAP)), 0)
    FORMATS["ply"].write(scan, Blocks(count, lambda part, some: scanned(scenes, part, some)))
    place = ",".join(f"{value:.6f}" for value in (*scenes.pose.position[0], 0.0))
    return ["detect", str(model), str(scan), f"--pose={place}", "--out", str(folder / "found")]


def _of_elements(folder: Path, count: int, _: int) -> list[str]:
    """A hall of so many elements, scanned from one place among them."""
    model, (place,) = folder / "hall.ifc", write_hall(folder / "hall.ifc", count, 1)
    scan = scans_of(model, place, {SENSOR}, folder)[SENSOR]
    return ["detect", str(model), str(scan), f"--pose={place}", "--sensor", SENSOR, "--out", str(folder / "found")]


def _of_stations(folder: Path, count: int, _: int) -> list[str]:
    """A hall of 200 elements, scanned from so many places in it."""
    model, scans, poses = folder / "hall.ifc", [], []
    for number, place in enumerate(write_hall(model, 200, count)):
        (folder / str(number)).mkdir()
        scans.append(str(scans_of(model, place, {SENSOR}, folder / str(number))[SENSOR]))
        poses.append(f"--pose={place}")
    return ["detect", str(model), *scans, *poses, "--sensor", SENSOR, "--out", str(folder / "found")]


def _of_workers(folder: Path, count: int, pairs: int) -> list[str]:
    """A data set of always as many pairs, by so many processes."""
    config = folder / "pairs.toml"
    config.write_text(PAIRS)
    return ["generate", str(config), "--out", str(folder / "shards"), "--count", str(pairs), "--workers", str(count)]


# What the sizes count, and what makes a command's words of a folder, a size and a number of pairs.
CURVES: dict[str, tuple[str, Callable[[Path, int, int], list[str]]]] = {
    "points": ("points", _of_points),
    "elements": ("elements", _of_elements),
    "stations": ("stations", _of_stations),
    "workers": ("workers", _of_workers),
}


def write_hall(path: Path, count: int, places: int) -> list[str]:
    """Write a hall of `count` elements, half columns and half walls but for four outer walls, a floor and a ceiling.

    Returns:
        Poses as the command line takes them, spread over the hall, each a metre and more from every element.
    """
    inner = max(count - 6, 4)
    side = int(np.ceil(np.sqrt(inner)))
    number = np.arange(inner)
    at = (np.column_stack([number % side, number // side]) - (side - 1) / 2) * SPACING
    is_wall, length, middle = number % 2 == 1, side * SPACING, HEIGHT / 2
    half = np.where(is_wall[:, None], [1.0, 0.1, middle], [0.2, 0.2, middle])
    edge = length / 2 + 0.1
    outer = [[-edge, 0, middle], [edge, 0, middle], [0, -edge, middle], [0, edge, middle], [0, 0, -0.1]]
    outer += [[0, 0, HEIGHT + 0.1]]
    sizes = [[0.1, edge, middle]] * 2 + [[edge, 0.1, middle]] * 2 + [[edge, edge, 0.1]] * 2
    semantic = [*np.where(is_wall, WALL, PILLAR), *[WALL] * 4, FLOOR, CEILING]
    center, every = [*np.column_stack([at, np.full(inner, middle)]), *outer], len(semantic)
    table = Primitives(
        np.full((1, every), BOX, np.uint8), np.array([center], np.float32), np.array([[*half, *sizes]], np.float32),
        np.zeros((1, every), np.float32), np.arange(every, dtype=np.int32)[None], np.array([semantic], np.uint8),
    )  # fmt: skip
    write_room(path, table, 0)
    chosen = np.linspace(0, inner - 1, places + 2).astype(int)[1:-1]
    aside = at[chosen] + np.where(at[chosen] > 0.0, -SPACING, SPACING) / 2  # towards the middle, between all four
    return [f"{x:.3f},{y:.3f},1.5,0" for x, y in aside]


@styled
def draw(found: Sequence[Curve]) -> Figure:
    """A panel a curve: computing, and the clock, with the exponents."""
    across = min(len(found), 2)
    down = -(-len(found) // across)
    figure = Figure((5.6 * across, 3.9 * down), layout="constrained")
    panels = figure.subplots(down, across, squeeze=False).ravel()
    for axes, one in zip(panels, found, strict=False):
        for field, color, marker in (("computing", BLUE, "o"), ("seconds", VERMILLION, "s")):
            title = {"computing": "user and system time", "seconds": "by the clock"}[field]
            times = [getattr(usage, field) for usage in one.usages]
            axes.plot(one.sizes, times, color=color, marker=marker, label=title)
        every, last = one.exponents
        axes.set(
            xscale="log", yscale="log", xlabel=one.axis, ylabel="time of the command [s]",
            title=f"exponent {every:.2f}, between the two largest {last:.2f}",
        )  # fmt: skip
    for axes in panels[len(found) :]:
        axes.set_visible(False)
    panels[0].legend()
    figure.suptitle("How the cost of whole commands grows, on two cores")
    return figure
