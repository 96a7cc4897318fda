"""What other programs read in the files that jaxmm writes, in numbers.

    python -m benchmarks.clients --out runs/clients.json [--npm FOLDER] [--python FILE] [--keep FOLDER]

Scans a changed room, near the origin and on a national grid, compares it with the model of what it was, and opens all
that is written in every program that is installed: of points, the greatest error of a coordinate [mm] and the names of
fields; of BCF, the topics, whether they select what changed, and the error of the camera; of the updated IFC model, how
many of the removed and new elements have their colours. What is not installed is told. JavaScript libraries are looked
for in FOLDER/node_modules, Python libraries in the environment of FILE, an interpreter: they need not go with jaxmm's
own. Prints Markdown; takes two minutes.
"""

import json
import subprocess
import sys
from pathlib import Path
from shutil import which
from typing import Any, NamedTuple

import numpy as np

from benchmarks.clients.outputs import Cloud, Outputs, make
from benchmarks.clients.readers import READERS
from benchmarks.command_line import CommandLine
from jaxmm.files import write_json

ABSENT = "not installed"
SCRIPT = Path(__file__).with_name("browser_libraries.mjs")
NODE = ("bcf-js", "@thatopen/components")
COLUMNS = ("file", "client", "reads")


class Where(NamedTuple):
    """Where programs are."""

    npm: Path  # folder with node_modules
    python: Path  # interpreter whose environment has the Python libraries


def of_cloud(cloud: Cloud, name: str, work: Path, where: Where) -> dict[str, Any]:
    """What one program reads of a point cloud."""
    row = {"file": cloud.path.name, "client": name}
    out = work / "read.npz"
    out.unlink(missing_ok=True)
    words = [where.python, "-m", "benchmarks.clients.readers", name, cloud.path, out]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300)
    if done.returncode == 3:
        return row | {"reads": ABSENT}
    if not out.exists():
        last = (done.stderr.strip().splitlines() or ["nothing said"])[-1]
        return row | {"reads": f"refused: {last[:90]}"}
    with np.load(out) as read:
        points, fields = read["points"], list(map(str, read["fields"]))
    if len(points) != len(cloud.points):
        return row | {"reads": f"{len(points)} of {len(cloud.points)} points"}
    error = 1000.0 * float(np.abs(points - cloud.points).max())
    told = f"; {', '.join(fields)}" if fields else ""
    return row | {"reads": f"{error:.3f} mm{told}", "error_mm": error, "fields": fields}


def of_bcf(outputs: Outputs, where: Where) -> list[dict[str, Any]]:
    """What every program reads of the topics."""
    rows = []
    for version, path in outputs.bcf.items():
        for name in (*NODE, "bcf-client"):
            row = {"file": f"mismatches.bcf {version}", "client": name}
            topics = (_python if name == "bcf-client" else _node)(where, name, path, version)
            rows.append(row | (topics if isinstance(topics, dict) else _told(topics, outputs)))
    return rows


def _told(topics: list[dict[str, Any]], outputs: Outputs) -> dict[str, Any]:
    own = [one for one in topics if one["title"].split(":")[0] != "Overview"]
    chosen = sorted(guid for one in own for guid in one["selected"])
    right = len(set(chosen) & set(outputs.selected))
    off = max(1000.0 * float(np.abs(np.subtract(one["camera"], outputs.camera)).max()) for one in own)
    words = f"{len(topics)} topics, {right} of {len(outputs.selected)} elements selected, camera {off:.3f} mm"
    return {"reads": words, "topics": len(topics), "selected": right, "camera_mm": off}


def of_ifc(outputs: Outputs, where: Where) -> list[dict[str, Any]]:
    """What viewers see of the updated model."""
    found = _node(where, "web-ifc", outputs.ifc, "")
    if "reads" not in found:
        right = sum(found.get(guid) == [",".join(map(str, colour))] for guid, colour in outputs.painted.items())
        words = f"{len(found)} elements, {right} of {len(outputs.painted)} changed ones in their colour"
        found = {"reads": words, "elements": len(found), "painted": right}
    marks = _python(where, "ifctester", outputs.ifc, "")
    if "reads" not in marks:
        words = f"{marks['verdicts']} elements with a verdict, {marks['probabilities']} with its probability"
        marks = {"reads": words} | marks
    return [
        {"file": "updated.ifc", "client": "web-ifc"} | found,
        {"file": "updated.ifc", "client": "ifctester"} | marks,
    ]


def _node(where: Where, kind: str, path: Path, version: str) -> Any:
    if which("node") is None or not (where.npm / "node_modules").is_dir():
        return {"reads": ABSENT}
    return _answer(["node", SCRIPT, kind, path.resolve(), version], where.npm)


def _python(where: Where, name: str, path: Path, version: str) -> Any:
    return _answer([where.python, "-m", "benchmarks.clients.model_readers", name, path.resolve(), version], None)


def _answer(words: list[Any], folder: Path | None) -> Any:
    """The JSON that a program prints, or why there is none."""
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=300)
    if done.returncode == 3:
        return {"reads": ABSENT}
    try:
        return json.loads(done.stdout)
    except ValueError:
        return {"reads": f"refused: {(done.stderr.strip().splitlines() or ['nothing said'])[-1][:90]}"}


def main(out: Path, where: Where, work: Path, kinds: tuple[str, ...] | None) -> None:
    """Write the files, ask, print and keep the rows."""
    work.mkdir(parents=True, exist_ok=True)
    outputs, rows, absent = make(work), [], set()
    print("| file | client | reads |\n|---|---|---|")

    def tell(row: dict[str, Any]) -> None:
        rows.append(row)
        print(f"| {' | '.join(str(row[column]) for column in COLUMNS)} |", flush=True)

    for row in (*of_bcf(outputs, where), *of_ifc(outputs, where)):
        tell(row)
    for cloud in outputs.clouds:
        for name, (_, suffixes) in READERS.items():
            if cloud.path.suffix not in suffixes or (kinds is not None and cloud.path.suffix not in kinds):
                continue
            row = {"reads": ABSENT} if name in absent else of_cloud(cloud, name, work, where)
            if row["reads"] == ABSENT:
                absent.add(name)
                row = {"file": cloud.path.name, "client": name, "reads": ABSENT}
            tell(row)
    write_json(out, {"rows": rows})


if __name__ == "__main__":
    parser = CommandLine(__doc__, {"npm": Path(), "python": Path(sys.executable), "kinds": None}, {"kinds": (".ply",)})
    parser.add_out("FILE")
    parser.add_argument("--npm", type=Path, metavar="FOLDER", help="with the node_modules of JavaScript libraries")
    parser.add_argument("--python", type=Path, metavar="FILE", help="interpreter of an environment with the libraries")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="of the files that are written; default: none")
    asked = parser.parse_args()
    places = Where(asked.npm, asked.python)
    if asked.keep:
        main(asked.out, places, asked.keep, asked.kinds)
    else:
        import tempfile

        with tempfile.TemporaryDirectory() as folder:
            main(asked.out, places, Path(folder), asked.kinds)
