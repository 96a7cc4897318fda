"""A building of two storeys over four weeks, as reports that say what was built, torn down, displaced or hidden.

Ground floor: walls A1 to A4 and a column C; upper floor: walls B1 to B4. In the first week only two walls stand. A3 is
torn down in the last; B2 is found 32 mm off its place in the third, and 61 mm in the last.
"""

import copy
import json
from pathlib import Path

DATES = ("2026-03-02", "2026-03-09", "2026-03-16", "2026-03-23")
WORDS = {"p": "present", "d": "displaced", "r": "removed", "o": "occluded", "u": "unscanned"}
# What each week's scans say, element by element.
SEEN = {
    "A1": "pppo", "A2": "pouu", "A3": "rppr", "A4": "rrpp", "C": "rppp",
    "B1": "urpp", "B2": "urdd", "B3": "urro", "B4": "uuuu",
}  # fmt: skip
STATES = {
    "A1": ("built",) * 4, "A2": ("built",) * 4, "A3": ("not built", "built", "built", "removed"),
    "A4": ("not built", "not built", "built", "built"), "C": ("not built", "built", "built", "built"),
    "B1": ("not seen", "not built", "built", "built"), "B2": ("not seen", "not built", "displaced", "displaced"),
    "B3": ("not seen", "not built", "not built", "not built"), "B4": ("not seen",) * 4,
}  # fmt: skip
OFF = {("B2", 2): 0.032, ("B2", 3): 0.061, ("A1", 0): 0.001, ("A1", 1): 0.002}  # [m] to the east
HALF = 0.004  # [m] of the interval


def box_of(name: str) -> dict:
    """Its place: four walls around a room of 8 x 6 m on each storey, and a column within."""
    if name == "C":
        return {"center": [2.0, 2.0, 1.5], "dimensions": [0.4, 0.4, 3.0], "rotation": 0.0}
    side, z = int(name[1]) - 1, 1.5 if name[0] == "A" else 4.7
    x, y, length, turn = ((4.0, 0.0, 8.0, 0.0), (8.0, 3.0, 6.0, -90.0), (4.0, 6.0, 8.0, 0.0), (0.0, 3.0, 6.0, -90.0))[
        side
    ]
    return {"center": [x, y, z], "dimensions": [length, 0.2, 3.0], "rotation": turn}


def element(name: str, verdict: str, off: float | None = None) -> dict:
    """One element of a report.json."""
    deviation = None
    if off is not None:
        deviation = {
            "offset": [off, 0.0, 0.0], "interval": [[off - HALF, off + HALF], None, None], "distance": off,
            "direction": [1.0, 0.0, 0.0], "turn": 0.1, "lean": None, "flatness": 0.003, "coverage": 0.7, "rays": 900,
            "classes": {"loa": "LOA20", "din18202": "beyond"},
        }  # fmt: skip
    return {
        "guid": f"guid-{name}", "ifc_class": "IfcColumn" if name == "C" else "IfcWallStandardCase", "name": name,
        "storey": "Ground floor" if name[0] in "AC" else "Upper floor", "verdict": verdict,
        "probability": 0.97 if verdict == "removed" else 0.02,
        "evidence": {"points": 50, "through": 0, "support": 50, "blocked": 0, "unseen": 0}, "next_view": None,
        "deviation": deviation, "box": box_of(name),
    }  # fmt: skip


def report(week: int, seen: dict[str, str] | None = None) -> dict:
    """A report.json of one of the weeks; `seen` instead of SEEN, with a letter of WORDS for each week."""
    scan = {
        "file": f"week{week}.e57", "points": 1000, "pose": [4.0, 3.0, 1.6, 0.0, 0.0], "pose_source": "given",
        "deviation": None, "registration": {}, "told": {}, "shows": 0, "alone": 0, "doubted": False, "doubts": [],
        "notes": [], "taken": {"date": DATES[week], "source": "header"},
    }  # fmt: skip
    added = {
        "object_type": "pillar", "mismatch_type": "added", "center": [6.0, 3.0, 1.0], "dimensions": [0.5, 0.5, 2.0],
        "rotation": 30.0, "probability": 0.9, "element": None, "moved_from": None, "observable_fraction": 0.5,
        "shape": "rectangular", "measured": [True] * 3, "type_probability": None,
    }  # fmt: skip
    return {
        "format": 2, "date": DATES[week], "mismatches": [added] if week == 1 else [],
        "elements": [
            element(name, WORDS[letters[week]], OFF.get((name, week)))
            for name, letters in (seen or SEEN).items()
        ],
        "prior": {"file": "house.ifc", "kind": "ifc", "unit": 1.0, "project": "p", "sha256": "ab" * 32},
        "scans": [scan], "sentences": [], "registration": {}, "settings": {}, "timing": {}, "notes": [],
    }  # fmt: skip


def write_reports(folder: Path, reports: list[dict] | None = None) -> list[Path]:
    """Folders week0 to week3, each with its report.json."""
    paths = []
    for number, content in enumerate(reports or [report(week) for week in range(4)]):
        paths.append(folder / f"week{number}")
        paths[-1].mkdir(parents=True)
        (paths[-1] / "report.json").write_text(json.dumps(content), encoding="utf-8")
    return paths


def changed(content: dict, place: tuple, value: object) -> dict:
    """The same report, but for one value; `...` takes it out."""
    content = copy.deepcopy(content)
    *above, last = place
    inner = content
    for step in above:
        inner = inner[step]
    if value is ...:
        del inner[last]
    else:
        inner[last] = value
    return content
