"""The plain files of a detection: JSON, text, tables and coloured point clouds.

World frame of the prior, metres, z up; angles in degrees. Every file is written whole or not at all.
"""

import csv
import io
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.classes.unexplained import Unexplained
from jaxmm.deviations.deviation import Deviation
from jaxmm.files import write_atomically, write_json, write_text
from jaxmm.rays.evidence import BLOCKED, FRACTIONS, SUPPORT, THROUGH, UNSEEN
from jaxmm.reports.deviation_words import displaced, measured, offset_in_words, place_in_words, span_of
from jaxmm.reports.markdown import as_markdown, printable
from jaxmm.verdicts.mismatch_points import mismatch_points, signed_distances
from jaxmm.verdicts.results import Detection, ElementVerdict, Mismatch, to_json, told_probability

PLAIN_FILES = (
    "report.json", "report.md", "sentences.txt", "mismatches.csv", "elements.csv", "deviations.csv", "unexplained.csv",
    "mismatches.ply", "points.ply",
)  # fmt: skip
ADDED_COLOR, REMOVED_COLOR = (0, 114, 178), (213, 94, 0)  # blue and vermillion: told apart with every colour blindness
UNEXPLAINED_COLOR = (86, 180, 233)  # sky-blue
GREYS = {SUPPORT: 205, THROUGH: 160, UNSEEN: 115, BLOCKED: 70}  # of points that show no mismatch, by their evidence
POSITION = ("x [m]", "y [m]", "z [m]")
MISMATCH_COLUMNS = (
    "number", "mismatch_type", "object_type", "shape", *(f"center_{name}" for name in POSITION),
    *(f"dimension_{name}" for name in POSITION), "rotation [deg]", "probability", "observable_fraction", "element",
    "moved_from", "measured", "type_probability",
)  # fmt: skip
DEVIATION_COLUMNS = (
    *(f"offset_{axis}{end} [m]" for axis in "xyz" for end in ("", "_low", "_high")),
    *(f"distance{end} [m]" for end in ("", "_low", "_high")), *(f"direction_{axis}" for axis in "xyz"), "turn [deg]",
    "lean [deg]", "flatness [m]", "coverage", "rays_on_it", "loa", "din18202",
)  # fmt: skip
WORST_COLUMNS = ("guid", "ifc_class", "name", "storey", "verdict", "in_words", *DEVIATION_COLUMNS)
ELEMENT_COLUMNS = (
    "guid", "ifc_class", "name", "storey", "verdict", "probability_removed", "prior_points",
    *(f"rays_{name}" for name in FRACTIONS), *(f"next_view_{name}" for name in POSITION), "next_view_yaw [deg]",
    "next_view_pitch [deg]", *DEVIATION_COLUMNS,
)  # fmt: skip
UNEXPLAINED_COLUMNS = (
    "number", *(f"center_{name}" for name in POSITION), *(f"dimension_{name}" for name in POSITION), "rotation [deg]",
    "points",
)  # fmt: skip
PLY_FIELDS = [
    *((name, "<f8", "double") for name in "xyz"), *((name, "u1", "uchar") for name in ("red", "green", "blue")),
    ("probability", "<f4", "float"), ("side", "u1", "uchar"),
]  # fmt: skip


def write_plain(folder: Path, detection: Detection) -> None:
    """Write PLAIN_FILES; the last only where the prior has a surface.

    Args:
        folder: exists; older files of these names are replaced, each in one move.
        detection: what was found.

    Raises:
        OSError: a file cannot be written.
    """
    write_json(folder / "report.json", to_json(detection))
    write_text(folder / "report.md", as_markdown(detection))
    write_text(folder / "sentences.txt", "".join(f"{line}\n" for line in sentences_of(detection)))
    _write_csv(folder / "mismatches.csv", mismatches_csv(detection.mismatches))
    _write_csv(folder / "elements.csv", elements_csv(detection.elements))
    _write_csv(folder / "deviations.csv", deviations_csv(detection.elements))
    _write_csv(folder / "unexplained.csv", unexplained_csv(detection.unexplained))
    write_mismatch_points(folder / "mismatches.ply", detection)
    write_points(folder / "points.ply", detection)


def mismatches_csv(mismatches: Iterable[Mismatch]) -> str:
    """A row for each mismatch: RFC 4180, units in the header, an empty cell where nothing is known.

    `number` counts from 1, as in report.md and the figures, and `moved_from` is such a number; `measured` says of each
    dimension, in order, whether it is seen from end to end, or the model's own, or else assumed;
    `type_probability`, whether a real object is of this type. Text that begins with
    =, +, -, @, a tab or a line break gets a leading apostrophe: spreadsheets would run it as a formula.
    """
    rows = []
    for number, one in enumerate(mismatches, 1):
        origin = None if one.moved_from is None else one.moved_from + 1
        rows.append([
            number, one.mismatch_type, one.object_type, one.shape, *map(float, one.center),
            *map(float, one.dimensions), float(one.rotation), told_probability(one.probability),
            one.observable_fraction, one.element, origin, " ".join("yes" if seen else "no" for seen in one.measured),
            None if one.type_probability is None else told_probability(one.type_probability),
        ])  # fmt: skip
    return _as_csv(MISMATCH_COLUMNS, rows)


def elements_csv(elements: Iterable[ElementVerdict]) -> str:
    """A row for each element that has a verdict, in the manner of `mismatches_csv`."""
    rows = []
    for one in elements:
        rows.append([
            one.guid, one.ifc_class, one.name, one.storey, one.verdict, told_probability(one.probability), one.points,
            *one.rays, *(one.next_view or [None] * 5), *_deviation(one.deviation),
        ])  # fmt: skip
    return _as_csv(ELEMENT_COLUMNS, rows)


def deviations_csv(elements: Iterable[ElementVerdict]) -> str:
    """A row for each element whose place was measured, the worst first, in the manner of `mismatches_csv`.

    `low` and `high` bound the interval of 95 %; they are empty along an axis that no face seen fixes, where the offset
    is 0. `distance` is along the direction, toward the scanner positive.
    """
    rows = []
    for one in measured(elements):
        words = offset_in_words(one.deviation)
        rows.append([one.guid, one.ifc_class, one.name, one.storey, one.verdict, words, *_deviation(one.deviation)])
    return _as_csv(WORST_COLUMNS, rows)


def unexplained_csv(things: Iterable[Unexplained]) -> str:
    """A row for each thing that is not in the model, in the manner of `mismatches_csv`; `points` of the scans on it."""
    rows = [
        [number, *map(float, one.center), *map(float, one.dimensions), float(one.rotation), one.points]
        for number, one in enumerate(things, 1)
    ]
    return _as_csv(UNEXPLAINED_COLUMNS, rows)


def sentences_of(detection: Detection) -> tuple[str, ...]:
    """What is new, what is gone, and what stands off its place, a line each."""
    return (*detection.sentences, *(printable(place_in_words(one)) for one in displaced(detection.elements)))


def _deviation(one: Deviation | None) -> list[Any]:
    """The cells of DEVIATION_COLUMNS; empty where nothing was measured."""
    if one is None:
        return [None] * len(DEVIATION_COLUMNS)
    ends = [span or (None, None) for span in one.interval]
    along = [value for axis in range(3) for value in (one.offset[axis], *ends[axis])]
    told = [one.turn, one.lean, one.flatness, one.coverage, one.rays, one.classes["loa"], one.classes["din18202"]]
    return [*along, one.distance, *span_of(one), *one.direction, *told]


def write_mismatch_points(path: Path, detection: Detection) -> None:
    """Write the points of both sides as a PLY file: binary, little endian, with double coordinates.

    Blue points show something added, vermillion ones something removed, sky-blue ones what else is not in the model;
    all others are grey, the darker the less a ray met them (see GREYS). `probability` is that of the point; `side` is 0
    for the robot's points, 1 for the prior's.
    """
    drawing, shown = detection.drawing, mismatch_points(detection)
    count = len(drawing.robot)
    table = np.zeros(count + len(drawing.prior), [(name, kind) for name, kind, _ in PLY_FIELDS])
    sides = (
        (table[:count], drawing.robot, drawing.robot_probability, drawing.robot_evidence, shown.robot, ADDED_COLOR),
        (table[count:], drawing.prior, drawing.prior_probability, drawing.prior_evidence, shown.prior, REMOVED_COLOR),
    )
    grey = np.array([GREYS[index] for index in range(len(FRACTIONS))], np.uint8)
    for side, (rows, points, probability, evidence, mismatch, color) in enumerate(sides):
        for axis, name in enumerate("xyz"):
            rows[name] = drawing.origin[axis] + points[:, axis].astype(np.float64)
        for name, value in zip(("red", "green", "blue"), color, strict=True):
            rows[name] = np.where(mismatch >= 0, value, grey[evidence])
        rows["probability"], rows["side"] = probability, side
    for axis, name in enumerate(("red", "green", "blue")):
        table[name][:count][shown.unexplained] = UNEXPLAINED_COLOR[axis]
    properties = "".join(f"property {kind} {name}\n" for name, _, kind in PLY_FIELDS)
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        "comment metres, z up; blue: added, vermillion: removed, sky-blue: else not in the model, "
        "grey: unchanged or not told\n"
        "comment side 0: measured by the robot, 1: of the building model\n"
        f"element vertex {len(table)}\n{properties}end_header\n"
    )
    write_atomically(path, lambda temporary: temporary.write_bytes(header.encode() + table.tobytes()))


def write_points(path: Path, detection: Detection) -> None:
    """Write the robot's points with their signed distances to the model's surface; nothing where it has none.

    Binary, little endian, with double coordinates. `scalar_distance` [m] is positive before the surface, as seen from
    where the point was measured, negative behind it; CloudCompare takes it for a scalar field.
    """
    distance, drawing = signed_distances(detection), detection.drawing
    if distance is None:
        return
    fields = [*((name, "<f8", "double") for name in "xyz"), ("scalar_distance", "<f4", "float"), ("scan", "<i4", "int")]
    table = np.zeros(len(distance), [(name, kind) for name, kind, _ in fields])
    for axis, name in enumerate("xyz"):
        table[name] = drawing.origin[axis] + drawing.robot[:, axis].astype(np.float64)
    table["scalar_distance"], table["scan"] = distance, drawing.robot_scan + 1
    properties = "".join(f"property {kind} {name}\n" for name, _, kind in fields)
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment metres, z up; distance to the model, before it positive\n"
        f"element vertex {len(table)}\n{properties}end_header\n"
    )
    write_atomically(path, lambda temporary: temporary.write_bytes(header.encode() + table.tobytes()))


def _as_csv(columns: Iterable[str], rows: Iterable[list]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\r\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return text.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, str):
        value = printable(value)
        return f"'{value}" if value.startswith(("=", "+", "-", "@", "\t", "\r", "\n")) else value
    if isinstance(value, (float, np.floating)):
        return round(float(value), 6) if math.isfinite(value) else None
    return value


def _write_csv(path: Path, text: str) -> None:
    # As bytes: a text file would turn the line ends of the format into those of the machine.
    write_atomically(path, lambda temporary: temporary.write_bytes(text.encode("utf-8")))
