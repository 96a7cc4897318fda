"""A report's page of a made-up detection of any size: `python made_page.py FILE POINTS ELEMENTS`.

Whatever build is on the path writes it, so nothing here may be newer than the oldest that is compared.
"""

import sys
from pathlib import Path

import numpy as np

from jaxmm.reports.page import write_page
from jaxmm.verdicts.results import Detection, Drawing, ElementVerdict, ScanRecord

STOREYS, PLAN, HEIGHT = 10, 60.0, 3.0  # of the building; edge of its plan and height of a storey [m]
BOX = np.array([0.4, 0.4, 2.7])  # [m] of an element


def written(page: str, points: int, elements: int) -> None:
    """Write the page of a detection in which every tenth element is gone; by whatever build is imported."""
    rng = np.random.default_rng(5)
    low = np.column_stack([
        rng.uniform(0.0, PLAN, (elements, 2)), HEIGHT * (np.arange(elements) * STOREYS // elements),
    ])  # fmt: skip
    corner = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * BOX
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = np.array([[a, b, c] for a, b, c, _ in sides] + [[a, c, d] for a, _, c, d in sides])
    faces = (triangles[None] + 8 * np.arange(elements)[:, None, None]).reshape(-1, 3)
    row, half = rng.integers(elements, size=points), points // 2
    places = (low[row] + rng.uniform(0.0, 1.0, (points, 3)) * BOX).astype(np.float32)
    probability, evidence = np.where(row % 10 == 0, 0.97, 0.02).astype(np.float32), np.zeros(points, np.uint8)
    guid, pose = tuple(f"{number:022d}" for number in range(elements)), (PLAN / 2, PLAN / 2, 1.5, 0.0, 0.0)
    drawing = Drawing(
        np.zeros(3), places[:half], probability[:half], evidence[:half], np.zeros(half, np.int32),
        places[half:], probability[half:], evidence[half:], row[half:].astype(np.int32), guid,
        (low[:, None] + corner[None]).reshape(-1, 3).astype(np.float32), faces.astype(np.int32),
        np.repeat(np.arange(elements), 12).astype(np.int32), (np.zeros((0, 3), np.float32),),
    )  # fmt: skip
    verdicts = tuple(
        ElementVerdict(
            one, "IfcColumn", f"column {number}", f"storey {number * STOREYS // elements}",
            "present" if number % 10 else "removed", 0.01 if number % 10 else 0.97, 50, (1, 400, 80, 3), None,
        )
        for number, one in enumerate(guid)
    )  # fmt: skip
    fit = {"shift": 0.0, "turn": 0.0, "residual": 0.004, "overlap": 0.97, "overlap_before": 0.97}
    counts = {"present": elements - elements // 10, "removed": elements // 10, "occluded": 0, "unscanned": 0}
    record = ScanRecord("robot.ply", half, pose, "given", None, fit, counts)
    detection = Detection(
        (), verdicts, (record,), {"refined": True, "residual": 0.004}, {}, {"total": 1.0}, (), drawing
    )
    write_page(Path(page), detection)


if __name__ == "__main__":
    written(sys.argv[1], *map(int, sys.argv[2:]))
