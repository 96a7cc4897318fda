"""The table of sensors: what is counted in it, from rooms whose scores are made up."""

from benchmarks.sensors import table
from jaxmm.files import write_json


def room(boxes=(), objects=(), elements=()):
    return {
        "boxes": [{"change": change, "right": right} for change, right in boxes],
        "objects": [{"change": change, "shown": shown, "found": found} for change, shown, found in objects],
        "elements": [[truth, verdict, 0.5] for truth, verdict in elements],
    }


def test_each_sensor_has_a_row_for_each_way_and_exact_ranges_one(tmp_path):
    good = room(
        [("added", True), ("added", False), ("removed", True)],
        [("added", 0.9, True), ("added", 0.5, False), ("added", 0.1, False), ("removed", 0.3, True)],
        [("present", "present"), ("present", "occluded"), ("removed", "present"), ("occluded", "unscanned")],
    )
    scenes = {"wall_added": [good], "unchanged": [room(), room([("added", False)])]}
    for sensor, settles in (("tls-real", True), ("velodyne-16", False)):
        for scene, rooms in scenes.items():
            told = [{"settled": one, "as they are": room()} if settles else {"exact": one} for one in rooms]
            write_json(tmp_path / f"{sensor}_{scene}_3_2.json", told)
            write_json(tmp_path / f"{sensor}_{scene}_4_2.json", [])  # of another seed
    _, _, ideal, settled, raw = table(tmp_path, 2, 3).splitlines()
    counted = "0.333 (1/3) | 0.500 (1/2) | 1.000 (1/1) | 1.000 (1/1) | 0.500 (1/2) | 0.333 (1/3) | 0.333 (1/3) |"
    assert ideal == f"| velodyne-16, ideal | exact | {counted}"
    assert settled == f"| tls, as built | settled | {counted}"
    assert raw == "| tls, as built | as they are | - | - | - | - | 1.000 (2/2) | - | - |"
