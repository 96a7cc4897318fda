"""A generated room as files, to try `jaxmm detect` on: its building model, a scan of what it became, and the truth.

    python paper/detect_example.py --out example [--scene all_four] [--room 0]

Writes room.ifc, scan.ply and pose.json, and prints the command that compares them and what it should find.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import trimesh

from jaxmm.config import SCENES
from jaxmm.files import write_json
from jaxmm.learning.boxes import sentence
from jaxmm.runs.room_scans import room_cases, true_boxes
from warp_scanner.buildings.room_ifc import write_room
from warp_scanner.sensors.sensors import OAK_D_PRO

SEED = 41  # of no training, validation or test


def main(out: Path, scene: str, room: int) -> None:
    out.mkdir(parents=True, exist_ok=True)
    (case,) = room_cases(scene, "occluded", SEED, range(room, room + 1), sensor=OAK_D_PRO)
    write_room(out / "room.ifc", case.pairs.prior, case.row)
    trimesh.PointCloud(case.scan.points).export(out / "scan.ply")
    pose = case.pairs.pose
    place = [round(float(value), 5) for value in case.scan.position]
    angles = {"yaw": round(float(pose.yaw[case.row]), 4), "pitch": round(float(pose.pitch[case.row]), 4)}
    write_json(out / "pose.json", {"position": place} | angles)
    for sign, change in ((1, "added"), (-1, "removed")):
        for box, shown in zip(*true_boxes(case.pairs, case.row, sign), strict=True):
            print(f"{sentence(box, change)} ({shown:.0%} of it can be observed)")
    print(f"{len(case.scan.points)} points of {np.prod(OAK_D_PRO.shape)} rays; {json.dumps(angles)}")
    print(f"jaxmm detect {out}/room.ifc {out}/scan.ply --pose {out}/pose.json --sensor oak-d-pro --out {out}/found")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--scene", choices=SCENES, default="all_four")
    parser.add_argument("--room", type=int, default=0, metavar="N")
    asked = parser.parse_args()
    main(asked.out, asked.scene, asked.room)
