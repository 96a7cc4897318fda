"""Every benchmark runs through at its smallest size, and what it prints and writes is finite and whole."""

import json
import math
import re
import subprocess
import sys

import pytest

from tests.test_imports import ROOT

JSON, FOLDER, FILE = "--json file", "--out folder", "--out file"
# What each benchmark writes.
WRITES = {
    "ablation": FOLDER, "accuracy": FOLDER, "buildings": FOLDER, "classes": FOLDER, "clients": FILE, "clouds": FOLDER,
    "commands": JSON, "detect": JSON, "detections": FOLDER, "deviations": JSON, "dynamic_maps": FILE, "flats": JSON,
    "growth": JSON,
    "large_scans": JSON,
    "latency": JSON, "matrix": JSON, "mirrors": JSON, "neighbours": JSON, "objects": FOLDER, "outdoors": FOLDER,
    "pairs": JSON, "pillars": FILE, "pose_search": JSON, "poses": FOLDER, "progress": FOLDER, "rays": JSON,
    "reality": JSON, "released": JSON, "rivals": FILE, "rooms": JSON, "rows": FOLDER, "sensors": FOLDER,
    "stations": JSON,
    "train": JSON, "triangles": JSON, "unchanged": JSON, "voxels": JSON,
}  # fmt: skip
NEEDS_FILES = {"released"}  # which no smoke run can make
NOT_MEASURED = {"commands", "unchanged"}  # what compares two checkouts
NUMBERS = ("ours", "peer", "ratio")


def benchmarks_with_a_main():
    folder = ROOT / "benchmarks"
    files = {path.stem for path in folder.glob("*.py") if "__main__" in path.read_text(encoding="utf-8")}
    return files | {path.parent.name for path in folder.glob("*/__main__.py")}


def test_no_benchmark_is_left_out():
    assert WRITES.keys() == benchmarks_with_a_main()


@pytest.mark.parametrize("name", sorted(WRITES.keys() - NOT_MEASURED))
def test_every_benchmark_stands_in_the_makefile_and_in_the_text(name):
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").partition("\nbench: ")[2].partition("\nbench-smoke:")[0]
    assert re.search(rf"-m benchmarks\.{name}\b", makefile)
    assert re.search(rf"^\| `{name}` \|", (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8"), re.MULTILINE)


def numbers_of(value):
    """All numbers anywhere in what JSON holds."""
    if isinstance(value, dict | list):
        for part in value.values() if isinstance(value, dict) else value:
            yield from numbers_of(part)
    elif isinstance(value, int | float):
        yield value


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(WRITES))
def test_a_smoke_run_ends_well_and_tells_finite_and_whole_numbers(name, tmp_path):
    out = tmp_path / ("out" if WRITES[name] == FOLDER else "out.json")
    words = ["--json" if WRITES[name] == JSON else "--out", out]
    done = subprocess.run(
        [sys.executable, "-m", f"benchmarks.{name}", "--smoke", *words], cwd=ROOT, capture_output=True, text=True,
        timeout=300,
    )  # fmt: skip
    if name in NEEDS_FILES:
        assert done.returncode == 2 and not done.stdout and len(done.stderr.splitlines()) == 1
        return
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() or " left out: " in done.stderr
    assert not re.search(r"\b(nan|inf|None)\b", done.stdout), done.stdout
    files = [out] if out.suffix else [*sorted(out.rglob("*.json")), *sorted(out.rglob("*.jsonl"))]
    texts = [(path, path.read_text(encoding="utf-8")) for path in files]
    assert any(text.strip() for _, text in texts)
    told = [
        (path, each)
        for path, text in texts
        for each in (filter(None, text.split("\n")) if path.suffix == ".jsonl" else [text])
    ]
    for path, each in told:
        found = json.loads(each)
        assert all(map(math.isfinite, numbers_of(found))), path
    if WRITES[name] == JSON:
        check_rows(name, found, done.stderr)


def check_rows(name, found, complaints):
    """Rows are all there, but for those of a peer that is said to be missing; commands of a build end well."""
    if name == "unchanged":
        said = {what: words for what, words in found.items() if what.endswith("says")}
        assert len(said) == 4 and all(words.startswith("exit 0") for words in said.values()), said
    elif name == "reality":  # tells in words what each build makes of a case; without another there is no peer
        assert [row["this build"] for row in found["rows"]] == ["right"]
    elif name == "stations":  # likewise
        assert found["rows"] and all(row["case"] and row["unit"] and row["ours"] > 0.0 for row in found["rows"])
    elif name == "flats":  # likewise, without another judge
        assert found["rows"] and all(row["ours"]["flats"] > 0 and row["ours"]["new"] > 0 for row in found["rows"])
    elif name == "matrix":
        assert len(found["cells"]) == 16
    else:
        assert found["rows"] or " left out: " in complaints
        for row in found["rows"]:
            assert row["case"] and row["unit"] and row["peer_name"]
            assert all(row[number] >= 0 for number in NUMBERS), row
