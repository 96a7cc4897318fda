"""What two builds make of the same input, to the last bit: to show that a change of the code changes no result.

    python -m benchmarks.unchanged --tree OLD --json old.json        20 minutes; OLD and NEW are checkouts
    python -m benchmarks.unchanged --tree NEW --json new.json --against old.json

Every build is run as a command, from its own checkout: `jaxmm reproduce` of the demo, `jaxmm generate` of 256 pairs,
`jaxmm scan` into every format, `jaxmm detect` on the buildings and scans of JAXMM_DATA, and `jaxmm revert`. What is
kept is a sha256 of each file, without what must differ: timing, and the time of writing. Differences are listed, and
end in exit code 1.
"""

import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
from argparse import Namespace
from pathlib import Path

from benchmarks.command_line import CommandLine, end_without
from benchmarks.rays import rooms_and_poses
from benchmarks.views.building_views import made_building
from jaxmm.files import load_json, write_json
from jaxmm.inputs import InputError

POSE = "0,0,1.5,0"
# When an element of an IFC file was marked, as a date and as seconds.
WRITTEN = re.compile(rb"\d{4}-\d\d-\d\dT[\d:]{8}[+-]\d\d:\d\d|(?<=ADDED\.,\$,\$,\$,)\d+")
# Building, pose, sensor, file of the scan: views that `jaxmm scan` makes, one of every format that it writes.
VIEWS = (
    ("IfcOpenHouse_IFC4", "2.938,2.026,1,-170.9", "oak-d-pro", "openhouse.ply"),
    ("Schependomlaan_V_L_Constructief", "5.968,9.467,4,-170.9", "ouster-64-real", "schependomlaan.e57"),
    ("Schependomlaan_XELLA_Begane_grond", "3.11,-0.4,1,-170.9", "velodyne-16-real", "xella.pcd"),
    ("bimwhale_LargeBuilding", "17.57,-4.574,1,-170.9", "oak-d-pro-real", "large.npz"),
    ("bimwhale_TallBuilding", "0.323,-4.547,1,-170.9", "ouster-64", "tall.csv"),
    ("duplex_A", "5.148,-2.796,4.119,-170.9", "velodyne-16", "duplex.npz"),
    ("xbim_House", "7.198,-2.109,0.55,-170.9", "oak-d-pro-small", "house.pcd"),
    ("xbim_wall_door_column_4x3", "-11.583,9.861,1,-170.9", "velodyne-16-real", "feet.e57"),
)
# Prior, scans and options: models of other contents than the view's, faults, meshes, clouds and real sensors.
DETECTIONS = (
    ("{data}/ifc/Schependomlaan_XELLA_Begane_grond.ifc", "{out}/schependomlaan.e57"),
    ("{data}/faults/room.ifc", "{data}/faults/changed.ply", "--pose", POSE, "--sensor", "ouster-64"),
    ("{data}/faults/room.ifc", "{data}/faults/changed.ply", "--pose", POSE, "--preset", "thesis"),
    ("{data}/faults/room.ifc", "{data}/faults/changed.ply", "--pose", POSE, "--apply", "--classes", "wall,column,slab"),
    ("{data}/faults/obj_groups/g.obj", "{data}/faults/obj_groups/changed.ply", "--pose", POSE),
    ("{data}/faults/glb_extensions/instance.glb", "{data}/faults/glb_extensions/same.ply", "--pose", POSE),
    ("{data}/faults/two_representations/body_sketch.ifc", "{data}/faults/two_representations/same.ply", "--pose", POSE),
    ("{data}/faults/lined_wall/lined_cov.ifc", "{data}/faults/lined_wall/nowall.ply", "--pose", POSE),
    ("{data}/ifc/duplex_A.ifc", "{data}/faults/georef_without_mapconversion/map0.las", "--pose", POSE),
    ("{data}/scans/pcl_office1.pcd", "{data}/scans/pcl_office1.pcd"),
    ("{data}/scans/pye57_pump.e57", "{data}/scans/pye57_pump.e57", "--pose", "0,0,1,0"),
    ("{data}/real/ipad/808_db.ply", "{data}/real/ipad/808_user.ply", "--pose", "0,0,0,0"),
    ("{data}/real/kinect/capture0001.pcd", "{data}/real/kinect/capture0002.pcd", "--frame", "sensor"),
    ("{data}/real/mobile/indoor.laz", "{data}/real/mobile/indoor.laz", "--pose", "0,0,1,0"),
    ("{data}/ifc/duplex_A.ifc", "{data}/formats/ptx/no-color.ptx", "--pose", POSE),
)  # fmt: skip
FULL = {"views": VIEWS, "detections": DETECTIONS, "pairs": 256, "run": "demo.toml"}
SMOKE = {"views": (), "detections": (), "pairs": 2, "run": None}  # and the view of a building that it makes itself
TAKEN = re.compile(rb"^\| [a-z ]+ \| [\d.]+ \|$", re.MULTILINE)  # seconds of the steps of a detection


class Build:
    """One checkout, run by this Python from an empty folder."""

    def __init__(self, tree: Path, work: Path, data: Path):
        self.work, self.places = work, {"data": data, "out": work}
        if not (tree / "jaxmm" / "__main__.py").is_file():
            raise InputError(f"--tree {tree}: expected a checkout of jaxmm")
        self.tree = tree.resolve()
        self.environment = os.environ | {"PYTHONPATH": str(self.tree)}

    def run(self, *words: object) -> str:
        """Run a command; returns its exit code and all that it says, without what names a folder of ours."""
        command = [str(word).format(**self.places) for word in words]
        done = subprocess.run(
            [sys.executable, "-m", "jaxmm", *command],
            cwd=self.work, env=self.environment, capture_output=True, text=True,
        )  # fmt: skip
        said = f"exit {done.returncode}\n{done.stdout}" + (done.stderr if done.returncode else "")
        for place, stands_for in ((self.work, "OUT"), (self.places["data"], "DATA"), (self.tree, "TREE")):
            said = said.replace(str(place), stands_for)
        return said

    def files(self, folder: str, *patterns: str) -> dict[str, str]:
        """sha256 of the files below a folder of the work that fit one of the patterns."""
        paths = sorted({path for pattern in patterns for path in (self.work / folder).rglob(pattern) if path.is_file()})
        return {path.relative_to(self.work).as_posix(): digest(path) for path in paths}


def digest(path: Path) -> str:
    """sha256 of a file, without how long things took, when it was written, and under which circumstances."""
    content = path.read_bytes()
    if path.name in ("updated.ifc", "report.md"):
        content = TAKEN.sub(b"", WRITTEN.sub(b"", content))
    if path.suffix == ".json":
        value = load_json(path)
        if isinstance(value, dict):
            value = {name: part for name, part in value.items() if name not in ("timing", "meta")}
        content = json.dumps(value, sort_keys=True).encode()
    return hashlib.sha256(content).hexdigest()


def made_view(data: Path) -> tuple[tuple[str, str, str, str], ...]:
    """A building below a folder of data, and a view of it, as VIEWS has them."""
    made_building(data / "ifc")
    _, pose = rooms_and_poses(1)
    place = ",".join(f"{value:.3f}" for value in (*pose.position[0], pose.yaw[0]))
    return (("room", place, "oak-d-pro-small", "room.ply"),)


def results(build: Build, sizes: Namespace) -> dict[str, str]:
    """Everything that is compared, by name."""
    found = {}
    for number, (name, pose, sensor, file) in enumerate(sizes.views):
        model = f"{{data}}/ifc/{name}.ifc"
        found[f"scan {file}: says"] = build.run(
            "scan", model, f"--pose={pose}", "--sensor", sensor, "--out", f"{{out}}/{file}"
        )
        given = () if file.endswith(("e57", "pcd", "npz")) else (f"--pose={pose}",)
        found |= detected(build, f"view_{number}", (model, f"{{out}}/{file}", "--sensor", sensor, *given))
    found |= build.files("", "*.ply", "*.pcd", "*.csv")  # E57 holds a time, NPZ is a zip file with dates
    for number, words in enumerate(sizes.detections):
        found |= detected(build, f"case_{number}", words)
    found["revert: says"] = build.run("revert", "{out}/view_0/updated.ifc", "--out", "{out}/reverted.ifc")
    found |= build.files("", "reverted.ifc")
    found["generate: says"] = build.run(
        "generate", build.tree / "configs" / "generate.toml", "--count", sizes.pairs, "--out", "{out}/shards"
    )
    found |= build.files("shards/shards", "*")
    if sizes.run:
        found["reproduce: says"] = build.run("reproduce", build.tree / "configs" / sizes.run, "--out", "{out}/demo")
    return found | build.files("demo", "table_1.*", "sentences.json", "models.safetensors", "reliability.json")


def detected(build: Build, name: str, words: tuple[str, ...]) -> dict[str, str]:
    """What one detection says, and what is in its folder."""
    said = build.run("detect", *words, "--out", f"{{out}}/{name}")
    print(f"{name}: {said.splitlines()[-2] if said.count(chr(10)) > 2 else said.splitlines()[-1]}", flush=True)
    kept = build.files(name, "report.json", "*.csv", "*.ply", "*.png", "*.md", "sentences.txt", "updated.ifc")
    return {f"{name}: says": said} | kept


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_argument("--tree", type=Path, default=Path(), metavar="DIR", help="checkout to run, default this one")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("JAXMM_DATA") or "../shared/data"))
    parser.add_argument("--json", type=Path, metavar="FILE", help="keep what was found")
    parser.add_argument("--against", type=Path, metavar="FILE", help="what another build found")
    asked = parser.parse_args()
    if asked.smoke:
        asked.data = parser.scratch / "data"
        asked.views = made_view(asked.data)
    elif not (asked.data / "faults" / "room.ifc").is_file():
        end_without(f"{asked.data}: expected the folder of buildings and scans that JAXMM_DATA names, found none")
    with tempfile.TemporaryDirectory() as work:
        found = results(Build(asked.tree, Path(work), asked.data.resolve()), asked)
    if asked.json:
        write_json(asked.json, found)
    if not asked.against:
        return 0
    before = load_json(asked.against)
    other = sorted(name for name in found.keys() | before.keys() if found.get(name) != before.get(name))
    for name in other:
        print(f"differs: {name}\n  before: {before.get(name)}\n  now: {found.get(name)}")
    print(f"{len(found) - len(other)} of {len(found)} results are the same, to the last bit")
    return 1 if other else 0


if __name__ == "__main__":
    sys.exit(main())
