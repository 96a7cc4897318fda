"""What `detect` tells of buildings of which only a part is built yet.

    python -m benchmarks.progress FOLDER --out runs/progress [--views 6] [--seed 3]

Every IFC file below FOLDER; in each view a half of its walls and columns does not stand, nor do the doors and windows
in them. Scanned from free places by a camera of 320 x 200 and a spinning sensor. An element can be told where at least
20 rays, and 3 % of those that it would stop if it stood alone, end on it or pass its place; of one that is gone, unless
a fifth of these end there on something else, as on a second element in the same place. The table says of how many the
verdict is right, wrong or left open: by one look at the scan, as the whole model has it, and with those that follow,
past what is gone. A JSON file for each file and sensor; what is there is not made again. Prints Markdown.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.views.building_views import asked_for, kept_views, scanned, tell_views
from benchmarks.views.detection_scores import share_of
from jaxmm.inputs import InputError
from jaxmm.learning.prediction import Judges
from jaxmm.rays.scan_rays import rays_of_scan
from jaxmm.verdicts.behind_removed import filling
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.hanging_openings import without_hanging
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.priors import Prior
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.standing_alone import APART
from jaxmm.verdicts.station_steps import look_at
from jaxmm.verdicts.verdicts import PRESENT, REMOVED, STANDS, VerdictSettings, is_enough, verdicts_of
from warp_scanner import draws
from warp_scanner.buildings.positions import draw_positions
from warp_scanner.rooms.standing import Standing
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.sense import rays_of
from warp_scanner.sensors.sensors import sensor_named
from warp_scanner.sensors.triangles import cast_triangles

SENSORS = ("oak-d-pro-small", "ouster-64")
FULL, SMOKE = {"views": 6, "sensors": SENSORS}, {"views": 1}
MISSING = 0.5  # share of the walls and columns that do not stand
SAME = 1e-3  # [m] within which a ray ends on an element
LOOKS = ("one look", "all looks")


def _view(prior: Prior, judges: Judges, sensor_name: str, which: tuple[int, int]) -> dict[str, Any] | None:
    """Of each element that can be told: whether it stands, and what either look says; None without a free place."""
    building, draw, sensor = prior.building, np.random.default_rng(which), sensor_named(sensor_name)
    upright = np.isin(building.triangles.semantic, (WALL, PILLAR))
    gone = upright & (draw.random(len(upright)) < MISSING)
    gone |= filling(building, gone)
    pose, found = draw_positions(building, prior.scene, Standing(), draws.keys(which[0], np.array([which[1]])))
    if not found[0]:
        return None
    posed, reach = scanned(prior.scene, ~gone, (sensor, pose), which)
    settings = DetectSettings(refine=False, settle=False, propose_views=False)
    try:
        told = detect_scans(prior, [NamedScan(posed, "scan", len(posed.points), "given")], judges, settings)
    except InputError as error:
        return {"refused": str(error), "told": [], "new": 0}
    last = {one.guid: one.verdict for one in told.elements}
    whole = without_hanging(prior, np.isin(building.elements.semantic, (WALL, PILLAR)))
    first = verdicts_of([look_at(whole, rays_of_scan(posed), judges, ["removed"])[1]])
    rows = _can_be_told(prior, (np.flatnonzero(upright), gone), rays_of(sensor, pose), reach)
    return {
        "told": [
            (REMOVED if gone[row] else PRESENT, first[row].verdict, last[building.elements.guid[row]]) for row in rows
        ],
        "new": sum(one.mismatch_type == "added" for one in told.mismatches),
    }  # fmt: skip


def _can_be_told(prior: Prior, which: tuple[np.ndarray, np.ndarray], rays: Rays, reach: np.ndarray) -> list[int]:
    """Those of the elements, rows (n,) and whether gone (E,), that enough rays with ranges `reach` (P,) [m] tell of."""
    limits, found, (rows, gone) = VerdictSettings(), [], which
    for row in rows:
        alone = cast_triangles(prior.scene, rays, np.arange(len(gone)) == row).distance[0]
        meets = np.isfinite(alone)
        with np.errstate(invalid="ignore"):
            apart = np.where(np.isfinite(reach), reach - alone, np.nan)
            on_it, past = (int((meets & there).sum()) for there in (np.abs(apart) < SAME, apart > APART))
        tells = past if gone[row] else on_it + past
        taken = gone[row] and on_it >= STANDS * (on_it + past)
        if not taken and is_enough(tells, meets.sum(), limits):
            found.append(int(row))
    return found


def table(out: Path, seed: int) -> str:
    """Both sensors and looks, as Markdown."""
    lines = [
        "| sensor | views | refused | verdicts of | elements that can be told | right | left open "
        "| gone, called present | there, called removed | nothing new, told new |",
        f"|{' --- |' * 10}",
    ]
    for sensor in SENSORS:
        views = kept_views(out, sensor, seed)
        refused, new = sum("refused" in one for one in views), sum(one["new"] for one in views)
        for number, look in enumerate(LOOKS, start=1):
            told = [(one[0], one[number]) for view in views for one in view["told"]]
            right = sum(truth == said for truth, said in told)
            wrong = [sum(one == pair for one in told) for pair in ((REMOVED, PRESENT), (PRESENT, REMOVED))]
            cells = [sensor, len(views), refused, look, len(told), share_of(right, len(told))]
            cells += [share_of(len(told) - right - sum(wrong), len(told)), *wrong, new if number == len(LOOKS) else "-"]
            lines.append(f"| {' | '.join(map(str, cells))} |")
    return "\n".join(lines)


if __name__ == "__main__":
    asked = asked_for(__doc__, FULL, SMOKE)
    tell_views(_view, asked)
    print(table(asked.out, asked.seed))
