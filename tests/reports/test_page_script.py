"""The script of report.html run by Node in a stand-in for a document: what it shows of displaced elements, and when."""

import json
import re
import subprocess
from pathlib import Path
from shutil import which

import numpy as np
import pytest

from jaxmm.reports.deviation_words import NORTH_WORDS, UNMEASURED_WORDS
from jaxmm.reports.page import page_text
from tests.cases.displaced import deviation, with_displaced

NODE = which("node")
DOCUMENT = Path(__file__).parents[1] / "cases" / "page_document.js"
VIEWER = Path(__file__).parents[2] / "jaxmm" / "reports" / "viewer"
pytestmark = pytest.mark.skipif(NODE is None, reason="needs node")


def run(folder, detection, act: str, *more: str) -> dict:
    """What `act`, a body of a function in JavaScript, returns after the page was loaded."""
    text = page_text(detection)
    script = text[text.rindex("<script>") + len("<script>") : text.rindex("</script>")]
    data = re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)[1]
    (folder / "script.js").write_text(script, encoding="utf-8")
    (folder / "data.json").write_text(data, encoding="utf-8")
    command = [NODE, str(DOCUMENT), str(folder / "script.js"), str(folder / "data.json"), *more]
    done = subprocess.run(command, input=act, capture_output=True, text=True, encoding="utf-8", timeout=60)
    told = json.loads(done.stdout)
    assert "failure" not in told, told["failure"]
    assert told["ready"] and not told["errors"], told["errors"]
    return told["told"]


def evaluated(expression: str):
    """What an expression of deviations.js, which needs no document, is."""
    code = (VIEWER / "deviations.js").read_text(encoding="utf-8")
    done = subprocess.run([NODE, "-e", f"{code}\nconsole.log(JSON.stringify({expression}))"], capture_output=True)
    assert not done.stderr, done.stderr.decode()
    return json.loads(done.stdout)


def test_counts_are_those_of_the_intervals():
    rng = np.random.default_rng(0)
    rows = [
        None if rng.random() < 0.2 else {"most": abs(rng.normal(0, 0.03)), "half": rng.uniform(0, 0.02)}
        for _ in range(300)
    ]
    known = [(one["most"], one["half"]) for one in rows if one]
    for tolerance in (0.0, 0.01, 0.03, 0.2):
        told = evaluated(f"offCounts({json.dumps(rows)}, {tolerance})")
        beyond = sum(size - half > tolerance for size, half in known)
        reach = sum(size + half > tolerance for size, half in known)
        assert told == {"measured": len(known), "beyond": beyond, "open": reach - beyond}


def test_colours_go_both_ways_from_none_and_end_with_the_scale():
    ends = evaluated("[offTint(-1, 0.1), offTint(0, 0.1), offTint(0.1, 0.1), offTint(-0.05, 0.1), OFF_RAMP]")
    ramp = ends.pop()
    assert ends[:3] == ramp
    middle = [(int(ramp[0][at : at + 2], 16) + int(ramp[1][at : at + 2], 16)) / 2 for at in (1, 3, 5)]
    assert np.allclose([int(ends[3][at : at + 2], 16) for at in (1, 3, 5)], middle, atol=1)
    most = [0.004, 0.0051, 0.06, 0.9]
    scales = evaluated(f"{most}.map((size) => offScale([null, {{ distance: -size, half: 0 }}]))")
    assert scales == [0.005, 0.01, 0.1, 0.5]
    turned = "{ distance: -0.0001, most: 0.1, half: 0.001, at_ends: true }"
    assert evaluated(f"offLook({turned}, 0.03, 0.1).tint") == ramp[0]


def test_an_arrow_is_as_many_times_as_long_as_the_legend_says():
    strokes = evaluated("arrowStrokes([1, 2, 3], [0.03, 0, -0.04], 20)")
    (start, tip), *heads = np.array(strokes)
    np.testing.assert_allclose(tip - start, 20 * np.array([0.03, 0.0, -0.04]))
    rows = "[[], [{ offset: [0, 0.06, 0] }], [{ offset: [0.3, 0.3, 0] }]]"
    assert evaluated(f"{rows}.map(arrowTimes)") == [50, 20, 5]
    turned = "[{ offset: [0, 0, 0], arrows: [[[0, 0, 0], [0, 0.1, 0]], [[3, 0, 0], [0, -0.1, 0]]] }]"
    assert evaluated(f"arrowTimes({turned})") == 10  # what is turned about its middle is off at its ends
    assert len(heads) == 2 and all(np.allclose(stroke[0], tip) for stroke in heads)
    assert evaluated("arrowStrokes([1, 2, 3], [0, 0, 0], 20)") == []


LISTED = """
return {
  list: byId("displaced-list").children.map((one) => one.text), hidden: byId("displaced").hidden,
  words: byId("displaced-words").text, rows: byId("table").children[1].children.map((one) => one.text),
};
"""


@pytest.mark.parametrize("more", [(), ("blind",)])
def test_the_displaced_are_listed_the_worst_first_with_or_without_3d(removed, tmp_path, more):
    told = with_displaced(removed)
    second = next(row for row, one in enumerate(told.elements) if one.verdict == "present")
    elements = list(told.elements)
    elements[second] = elements[second]._replace(verdict="displaced", name="far", deviation=deviation(-0.08))
    shown = run(tmp_path, told._replace(elements=tuple(elements)), LISTED, *more)
    assert [line.partition(" stands ")[2] for line in shown["list"]] == [
        "80 mm (78 to 82) to the west of its place.",
        "23 mm (21 to 25) to the east of its place.",
    ]
    assert shown["words"] == NORTH_WORDS and not shown["hidden"]
    places = [next(n for n, row in enumerate(shown["rows"]) if word in row) for word in ("-80.0", "23.0")]
    assert places == sorted(places) and "23.0" in shown["rows"][places[1]]
    assert run(tmp_path, removed, LISTED)["hidden"]


CARD = """
const guid = arguments_.guid;
hook.select(guid);
settle();
return byId("chosen").text;
"""


def test_the_card_of_an_element_says_its_offset_and_how_sure_it_is(removed, tmp_path):
    told = with_displaced(removed)
    guid = next(one.guid for one in told.elements if one.verdict == "displaced")
    card = run(tmp_path, told, CARD.replace("arguments_.guid", json.dumps(guid)))
    assert "23 mm (21 to 25) to the east" in card and "23 mm (21 to 25)" in card and NORTH_WORDS in card
    assert card.count("nothing that was seen fixes it") == 2 and "LOA20, DIN 18202: beyond" in card
    unseen = next(one.guid for one in told.elements if one.deviation is None)
    assert "off its place" not in run(tmp_path, told, CARD.replace("arguments_.guid", json.dumps(unseen)))
    elements = [one._replace(deviation=None) if one.verdict == "present" else one for one in told.elements]
    stands = next(one.guid for one in elements if one.verdict == "present")
    open_ = told._replace(elements=tuple(elements))
    assert UNMEASURED_WORDS in run(tmp_path, open_, CARD.replace("arguments_.guid", json.dumps(stands)))


TOLERANCE = """
const seen = [];
const state = () => seen.push({
  counts: byId("off-counts").text, hidden: byId("off").hidden, legend: byId("legend").text, uploads: uploads.length,
  tints: [...uploads].reverse().find((one) => one instanceof Uint32Array && one.length > 100)?.join(),
});
state();
Object.assign(byId("tinting"), { value: "deviation" }).emit("change");
settle();
state();
for (const value of ["10", "24", "50"]) {
  Object.assign(byId("tolerance"), { value }).emit("input");
  settle();
  state();
}
return seen;
"""


def test_the_tolerance_recolours_and_recounts_at_once(removed, tmp_path):
    first, coloured, *after = run(tmp_path, with_displaced(removed), TOLERANCE)
    assert first["hidden"] and not coloured["hidden"]
    assert "mm" not in first["legend"] and "50 mm, away from" in coloured["legend"] and "+50 mm" in coloured["legend"]
    assert [one["counts"].split(" of ")[0] for one in after] == ["1", "0", "0"]
    assert [one["counts"].split("beyond it, ")[1] for one in after] == ["0 perhaps", "1 perhaps", "0 perhaps"]
    assert coloured["tints"] != first["tints"] and after[0]["tints"] != after[1]["tints"] == after[2]["tints"]


TAP = """
const seen = [focused()];
const at = { pointerId: 1, clientX: 5, clientY: 5, offsetX: 5, offsetY: 5, button: 0, buttons: 1 };
byId("canvas").emit("pointerdown", at);
byId("canvas").emit("pointermove", { ...at, clientY: 60 });
byId("canvas").emit("pointercancel", at);
seen.push(focused());
byId("canvas").emit("pointerdown", at);
byId("canvas").emit("pointerup", at);
seen.push(focused());
document.emit("pointerdown", { target: byId("table") });
seen.push(focused());
return seen;
"""


def test_a_swipe_leaves_the_page_its_finger_until_the_view_is_tapped(removed, tmp_path):
    """The style gives the view all fingers while it has the focus, and else leaves swipes up and down to the page."""
    style = (VIEWER / "page.css").read_text(encoding="utf-8")
    assert re.search(r"#canvas \{[^}]*touch-action: pan-y", style)
    assert re.search(r"#canvas:focus \{ touch-action: none; \}", style)
    assert run(tmp_path, removed, TAP) == [None, None, "canvas", None]


FROM_SCANS = """
const views = byId("cameras").children;
const list = views.find((one) => one.tag === "select");
const seen = [];
for (const [scan, place] of %s.entries()) {
  if (list) Object.assign(list, { value: String(scan) }).emit("change");
  else views[2 + scan].click();
  settle();
  seen.push(hook.project(place));
}
const chosen = list?.value ?? "";
list?.emit("blur");
const left = list?.value ?? "";
return { seen, buttons: views.filter((one) => one.tag === "button").length, chosen, left };
"""


@pytest.mark.parametrize(("count", "buttons"), [(1, 3), (8, 10), (9, 2), (40, 2)])
def test_the_view_goes_to_every_scan_however_many_there_are(removed, tmp_path, count, buttons):
    """What is ahead of each sensor is in the middle of the window then."""
    x, y, z, _, _ = removed.scans[0].pose
    poses = [(x + 0.1 * n, y, z, 360.0 * n / count, 0.0) for n in range(count)]
    scans = tuple(removed.scans[0]._replace(pose=pose) for pose in poses)
    yaws = np.radians([pose[3] for pose in poses])
    ahead = np.array([pose[:3] for pose in poses]) + 2.0 * np.stack([np.cos(yaws), np.sin(yaws), 0.0 * yaws], axis=1)
    told = run(tmp_path, removed._replace(scans=scans), FROM_SCANS % json.dumps(ahead.tolist()))
    assert told["buttons"] == buttons
    assert told["chosen"] == (str(count - 1) if buttons == 2 else "")  # keys go on from there
    assert told["left"] == ""  # the same scan can be chosen again
    np.testing.assert_allclose(told["seen"], [[400.0, 300.0]] * count, atol=1.0)
