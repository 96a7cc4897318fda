"""The plain files of a detection: JSON, text, tables and coloured point clouds.

World frame of the prior, metres, z up; angles in degrees. Every file is written whole or not at all.
"""

import csv
import io
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxmm.classes.unexplained import Unexplained
from jaxmm.deviations.deviation import Deviation
from jaxmm.files import write_atomically, write_json, write_text
from jaxmm.formats.cloud_files import write_ply
from jaxmm.rays.evidence import BLOCKED, FRACTIONS, SUPPORT, THROUGH, UNSEEN
from jaxmm.reports.deviation_words import displaced, measured, off_in_words, place_in_words, span_of
from jaxmm.reports.markdown import as_markdown, printable
from jaxmm.reports.removed_words import removed_in_words, removed_others
from jaxmm.reports.report_json import to_json
from jaxmm.verdicts.mismatch_points import mismatch_points, signed_distances
from jaxmm.verdicts.results import Detection, ElementVerdict, Mismatch, told_probability

PLAIN_FILES = (
    "report.json", "report.md", "sentences.txt", "mismatches.csv", "elements.csv", "deviations.csv", "unexplained.csv",
    "mismatches.ply", "points.ply",
)  # fmt: skip
ADDED_COLOR, REMOVED_COLOR = (0, 114, 178), (213, 94, 0)  # blue and vermillion: told apart with every colour blindness
UNEXPLAINED_COLOR = (86, 180, 233)  # sky-blue
GREYS = {SUPPORT: 205, THROUGH: 160, UNSEEN: 115, BLOCKED: 70}  # of points that show no mismatch, by their evidence
BEHIND_COLOR, ON_COLOR, BEFORE_COLOR = (140, 81, 10), (163, 170, 177), (1, 102, 94)  # as the page's: ColorBrewer's BrBG
FAR_COLOR, COLORED_TO = (204, 121, 167), 0.1  # of points that are more [m] off the model than the colours tell apart
POSITION = ("x [m]", "y [m]", "z [m]")
MISMATCH_COLUMNS = (
    "number", "mismatch_type", "object_type", "shape", *(f"center_{name}" for name in POSITION),
    *(f"dimension_{name}" for name in POSITION), "rotation [deg]", "probability", "observable_fraction", "element",
    "moved_from", "measured", "type_probability", "file", "in_doubt",
)  # fmt: skip
DEVIATION_COLUMNS = (
    *(f"offset_{axis}{end} [m]" for axis in "xyz" for end in ("", "_low", "_high")),
    *(f"distance{end} [m]" for end in ("", "_low", "_high")), *(f"direction_{axis}" for axis in "xyz"), "turn [deg]",
    "lean [deg]", "flatness [m]", "coverage", "rays_on_it", "loa", "din18202",
)  # fmt: skip
WORST_COLUMNS = ("guid", "ifc_class", "name", "storey", "verdict", "in_words", *DEVIATION_COLUMNS, "file")
ELEMENT_COLUMNS = (
    "guid", "ifc_class", "name", "storey", "verdict", "probability_removed", "prior_points",
    *(f"rays_{name}" for name in FRACTIONS), *(f"next_view_{name}" for name in POSITION), "next_view_yaw [deg]",
    "next_view_pitch [deg]", *DEVIATION_COLUMNS, "file", "same_as", "parts_gone", "parts", "part_of",
)  # fmt: skip
UNEXPLAINED_COLUMNS = (
    "number", *(f"center_{name}" for name in POSITION), *(f"dimension_{name}" for name in POSITION), "rotation [deg]",
    "points",
)  # fmt: skip


def write_plain(folder: Path, detection: Detection) -> None:
    """Write PLAIN_FILES; the last only where the prior has a surface; and the moved PLY files of far coordinates.

    Args:
        folder: exists; older files of these names are replaced, each in one move.
        detection: what was found.

    Raises:
        OSError: a file cannot be written.
    """
    write_json(folder / "report.json", to_json(detection))
    write_text(folder / "report.md", as_markdown(detection))
    doubts = (" ".join(printable(doubt).split()) for doubt in detection.doubts)
    lines = (*(f"In doubt: {doubt}" for doubt in doubts), *sentences_of(detection))
    write_text(folder / "sentences.txt", "".join(f"{line}\n" for line in lines))
    write_csv(folder / "mismatches.csv", mismatches_csv(detection.mismatches, detection.doubts))
    write_csv(folder / "elements.csv", elements_csv(detection.elements))
    write_csv(folder / "deviations.csv", deviations_csv(detection.elements))
    write_csv(folder / "unexplained.csv", unexplained_csv(detection.unexplained))
    write_mismatch_points(folder / "mismatches.ply", detection)
    write_points(folder / "points.ply", detection)


def mismatches_csv(mismatches: Iterable[Mismatch], doubts: Sequence[str] = ()) -> str:
    """A row for each mismatch: RFC 4180, units in the header, an empty cell where nothing is known.

    `number` counts from 1, as in report.md and the figures, and `moved_from` is such a number; `measured` names
    the dimensions that are seen from end to end, or the model's own, as "x z", or "none": all others are assumed;
    `type_probability`, whether a real object is of this type; `in_doubt`, in every row, the first of the `doubts`
    whether a scan is of this place and pose, and how many more there are. Text that begins with =, +, -, @, a tab or a
    line break gets a leading apostrophe: spreadsheets would run it as a formula.
    """
    rows, told = [], doubts_in_short(doubts)
    for number, one in enumerate(mismatches, 1):
        origin = None if one.moved_from is None else one.moved_from + 1
        rows.append([
            number, one.mismatch_type, one.object_type, one.shape, *map(float, one.center),
            *map(float, one.dimensions), float(one.rotation), told_probability(one.probability),
            one.observable_fraction, one.element, origin, _axes(one.measured),
            None if one.type_probability is None else told_probability(one.type_probability), one.file, told,
        ])  # fmt: skip
    return as_csv(MISMATCH_COLUMNS, rows)


def _axes(seen: Iterable[bool]) -> str:
    return " ".join(axis for axis, one in zip("xyz", seen, strict=True) if one) or "none"


def elements_csv(elements: Iterable[ElementVerdict]) -> str:
    """A row for each element that has a verdict, in the manner of `mismatches_csv`.

    `same_as` names those of other files that are the same, `parts` what it is put together from, or another file has it
    in, `parts_gone` of these the removed ones, `part_of` its wholes; a `;` between two.
    """
    rows = []
    for one in elements:
        rows.append([
            one.guid, one.ifc_class, one.name, one.storey, one.verdict, told_probability(one.probability), one.points,
            *one.rays, *(one.next_view or [None] * 5), *_deviation(one.deviation), one.file,
            *map(listed_keys, (one.same_as, one.parts_gone, one.parts, one.part_of)),
        ])  # fmt: skip
    return as_csv(ELEMENT_COLUMNS, rows)


def doubts_in_short(doubts: Sequence[str]) -> str | None:
    """The first doubt on one line, and how many more there are; None where there is none."""
    if not doubts:
        return None
    more = f" (and {len(doubts) - 1} more: see report.md)" if len(doubts) > 1 else ""
    return " ".join(printable(doubts[0]).split()) + more


def listed_keys(keys: Iterable[tuple[str, str]]) -> str | None:
    """Elements by file and GlobalId, as one cell; None where there are none."""
    return "; ".join(f"{guid} of {file}" if file else guid for file, guid in keys) or None


def deviations_csv(elements: Iterable[ElementVerdict]) -> str:
    """A row for each element whose place was measured, the worst first, in the manner of `mismatches_csv`.

    `low` and `high` bound the interval of 95 %; they are empty along an axis that no face seen fixes, where the offset
    is 0. `distance` is along the direction, toward the scanner positive.
    """
    rows = []
    for one in measured(elements):
        words = off_in_words(one.deviation)
        rows.append(
            [one.guid, one.ifc_class, one.name, one.storey, one.verdict, words, *_deviation(one.deviation), one.file]
        )
    return as_csv(WORST_COLUMNS, rows)


def unexplained_csv(things: Iterable[Unexplained]) -> str:
    """A row for each thing that is not in the model, in the manner of `mismatches_csv`; `points` of the scans on it."""
    rows = [
        [number, *map(float, one.center), *map(float, one.dimensions), float(one.rotation), one.points]
        for number, one in enumerate(things, 1)
    ]
    return as_csv(UNEXPLAINED_COLUMNS, rows)


def sentences_of(detection: Detection) -> tuple[str, ...]:
    """What is new, what is gone, and what stands off its place, a line each."""
    gone = (removed_in_words(one) for one in removed_others(detection))
    off = (place_in_words(one) for one in displaced(detection.elements))
    return (*detection.sentences, *map(printable, (*gone, *off)))


def _deviation(one: Deviation | None) -> list[Any]:
    """The cells of DEVIATION_COLUMNS; empty where nothing was measured."""
    if one is None:
        return [None] * len(DEVIATION_COLUMNS)
    ends = [span or (None, None) for span in one.interval]
    along = [value for axis in range(3) for value in (one.offset[axis], *ends[axis])]
    told = [one.turn, one.lean, one.flatness, one.coverage, one.rays, one.classes["loa"], one.classes["din18202"]]
    return [*along, one.distance, *span_of(one), *one.direction, *told]


def write_mismatch_points(path: Path, detection: Detection) -> tuple[Path, ...]:
    """Write the points of both sides as a PLY file, see formats.cloud_files; returns the files.

    Blue points show something added, vermillion ones something removed, sky-blue ones what else is not in the model;
    all others are grey, the darker the less a ray met them (see GREYS). `scalar_probability` is that of the point;
    `scalar_side` is 0 for the robot's points, 1 for the prior's.
    """
    drawing, shown = detection.drawing, mismatch_points(detection)
    count = len(drawing.robot)
    points = np.concatenate([drawing.robot, drawing.prior]).astype(np.float64) + drawing.origin
    color = np.zeros((len(points), 3), np.uint8)
    sides = (
        (color[:count], drawing.robot_evidence, shown.robot, ADDED_COLOR),
        (color[count:], drawing.prior_evidence, shown.prior, REMOVED_COLOR),
    )
    grey = np.array([GREYS[index] for index in range(len(FRACTIONS))], np.uint8)
    for rows, evidence, mismatch, own in sides:
        rows[:] = np.where((mismatch >= 0)[:, None], np.array(own, np.uint8), grey[evidence][:, None])
    color[:count][shown.unexplained] = UNEXPLAINED_COLOR
    fields = dict(zip(("red", "green", "blue"), color.T, strict=True)) | {
        "scalar_probability": np.concatenate([drawing.robot_probability, drawing.prior_probability]).astype(np.float32),
        "scalar_side": (np.arange(len(points)) >= count).astype(np.uint8),
    }
    return write_ply(path, points, fields, (
        "metres, z up; blue: added, vermillion: removed, sky-blue: else not in the model, grey: unchanged or not told",
        "side 0: measured by the robot, 1: of the building model",
    ))  # fmt: skip


def write_points(path: Path, detection: Detection) -> tuple[Path, ...]:
    """Write the robot's points with their signed distances to the model's surface; nothing where it has none.

    `scalar_distance` [m] is positive before the surface, as seen from where the point was measured, negative behind it;
    `scalar_scan` counts the scans from 1. CloudCompare takes both for scalar fields. Colours tell the same to programs
    that read no fields (see `distance_colors`).
    """
    distance, drawing = signed_distances(detection), detection.drawing
    if distance is None:
        return ()
    points = drawing.origin + drawing.robot.astype(np.float64)
    fields = dict(zip(("red", "green", "blue"), distance_colors(distance).T, strict=True)) | {
        "scalar_distance": distance.astype(np.float32),
        "scalar_scan": (drawing.robot_scan + 1).astype(np.int32),
    }
    return write_ply(path, points, fields, (
        "metres, z up; distance to the model, before it positive",
        f"grey: on the model, teal: {COLORED_TO} m before it, brown: {COLORED_TO} m behind it, pink: farther off",
    ))  # fmt: skip


def distance_colors(distance: np.ndarray) -> np.ndarray:
    """(N, 3) uint8 of signed distances (N,) [m]: from ON_COLOR to one of the others at COLORED_TO, then FAR_COLOR."""
    part = np.clip(distance / COLORED_TO, -1.0, 1.0)[:, None]
    on, ends = np.array(ON_COLOR), np.where(part < 0.0, BEHIND_COLOR, BEFORE_COLOR)
    mixed = on + (ends - on) * np.abs(part)
    return np.where(np.abs(distance)[:, None] > COLORED_TO, FAR_COLOR, np.round(mixed)).astype(np.uint8)


def as_csv(columns: Iterable[str], rows: Iterable[list]) -> str:
    """A table by RFC 4180: numbers to six digits, empty where there is none; no text in it runs as a formula."""
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
        return round(float(value), 6) + 0.0 if math.isfinite(value) else None  # a zero has no sign
    return value


def write_csv(path: Path, text: str) -> None:
    """Write what `as_csv` made, whole or not at all."""
    # As bytes: a text file would turn the line ends of the format into those of the machine.
    write_atomically(path, lambda temporary: temporary.write_bytes(text.encode("utf-8")))
