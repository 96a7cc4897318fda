"""Verdicts on a building's elements from one scan: present, removed, occluded, unscanned; and where to look next.

    python -m paper.figures.verdicts runs/paper --out verdicts.png

A room of the run's test seed with all four changes, behind furniture, seen from above, by the default preset.
"""

from pathlib import Path

from matplotlib.figure import Figure

from jaxmm import run_folder
from jaxmm.data.simulator_settings import CloudSource, pair_config
from jaxmm.learning.prediction import read_judges
from jaxmm.reports.figures import styled
from jaxmm.reports.plan_figure import plan_figure
from jaxmm.runs.room_scans import cases_of
from jaxmm.verdicts.detection import detect_scans
from jaxmm.verdicts.named_scans import NamedScan
from jaxmm.verdicts.settings import DetectSettings
from jaxmm.verdicts.verdicts import VERDICTS
from jaxmm.weights import DEFAULT
from paper.figures.panels import command

SCENE, CONDITION = "all_four", "occluded"
TRIED = 60  # test rooms; where none of them has all, the last is drawn


@styled
def draw(run: Path, path: Path) -> Figure:
    """The floor plan of a detection, as `jaxmm detect` draws it: the first room that has every kind of verdict."""
    config, judges = run_folder.read_config(run), read_judges(DEFAULT)
    source = CloudSource("", SCENE, CONDITION, config.data.test_seed)
    settings = DetectSettings(refine=False)
    for room in range(TRIED):
        (case,) = cases_of(pair_config(config, source), range(room, room + 1))
        scan = NamedScan(case.scan, f"test room {room}", len(case.scan.points), "given")
        found = detect_scans(case.prior, [scan], judges, settings)
        if {one.verdict for one in found.elements} == set(VERDICTS) and any(one.next_view for one in found.elements):
            break
    return plan_figure(found, path)


if __name__ == "__main__":
    command(__doc__, draw)
