"""Keep what a run of the paper found: its tables, settings and versions, small enough for the repository.

    python -m paper.results runs/paper --out paper/results

The report and the README's tables are filled in from this folder; `run.json` in it says when and from which commit the
run was made, and how many points, rooms and models it took.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from jaxmm import run_folder
from jaxmm.files import load_arrays, load_json, write_json, write_text
from jaxmm.inputs import InputError
from jaxmm.runs.stages import STAGE, STAGES

TABLES = ("table_1", "label_noise", "studies", "thesis_scans")  # the last only where the thesis's data was there
NEEDED = TABLES[:-1]
RUN = "run.json"


def collect(run: Path, out: Path) -> None:
    """Copy the tables of a finished run and tell what it was.

    Raises:
        InputError: the run has not been finished.
    """
    if not (run / run_folder.CONFIG).is_file():
        raise InputError(f"{run}: expected a run folder with {run_folder.CONFIG}, found none")
    if out.exists() and not out.is_dir():
        raise InputError(f"{out}: expected a folder, found a file")
    if missing := [name for name in NEEDED if not (run / f"{name}.json").is_file()]:
        raise InputError(f"{run}: expected a finished run of the paper, found no {missing[0]}.json")
    facts = told(run)
    out.mkdir(parents=True, exist_ok=True)
    for name in TABLES:
        if (run / f"{name}.json").is_file():
            write_text(out / f"{name}.json", _row_by_row(load_json(run / f"{name}.json")))
            for kind in ("csv", "md"):
                write_text(out / f"{name}.{kind}", (run / f"{name}.{kind}").read_text(encoding="utf-8"))
    write_text(out / run_folder.CONFIG, (run / run_folder.CONFIG).read_text(encoding="utf-8"))
    write_json(out / RUN, facts)


def _row_by_row(table: dict[str, Any]) -> str:
    """The JSON of a table, a row a line: half as long, and a changed row is a changed line."""
    rows = ",\n".join(json.dumps(row) for row in table["rows"])
    return f'{{"rows": [\n{rows}\n],\n"meta": {json.dumps(table["meta"], indent=1)}}}\n'


def told(run: Path) -> dict[str, Any]:
    """When and from which commit a run was made, and how much it looked at.

    Raises:
        InputError: a file of a stage is missing or damaged, or none tells a date.
    """
    stages, date = run / STAGES, date_of(run)
    if date is None:
        raise InputError(f"{stages}: expected stages that tell their date, found none; begin the run anew")
    scored = ("rooms/*/rooms.json", "files/*/building_*.json", "sweeps/*/*_*ed.json", "scaling_rooms/*/rooms.json")
    scenes = [load_json(path) for pattern in scored for path in sorted(stages.glob(pattern))]
    clouds = [load_arrays(path)["count"] for path in sorted(stages.glob("clouds/data/train_*.npz"))]
    return {
        "date": date,
        "versions": load_json(run / run_folder.VERSIONS),
        "networks": len(load_json(stages / "models" / "entries.json")),
        "training_clouds": sum(map(len, clouds)),
        "test_scenes": sum(map(len, scenes)),
        "files": sorted(path.name for path in stages.glob("files/*") if path.is_dir()),
    }


def date_of(run: Path) -> str | None:
    """The day on which a run's last stage was begun, ISO 8601; None where no stage tells, as in runs of older code."""
    dates = [load_json(path).get("date") for path in (run / STAGES).rglob(STAGE)]
    return max(filter(None, dates), default=None)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, metavar="RUN")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    asked = parser.parse_args()
    try:
        collect(asked.run, asked.out)
    except InputError as error:
        parser.exit(2, f"error: {error}\n")
