"""report.html in headless Chromium: it draws, answers the mouse, runs nothing foreign and asks no network."""

import time

import numpy as np
import pytest

from jaxmm.classes.unexplained import Unexplained
from jaxmm.verdicts.verdicts import VERDICTS
from tests.cases.detections import true_case
from tests.cases.displaced import with_displaced
from tests.cases.pages import EVIL, Page, as_cloud, changed_share, hostile, open_browser, points_on

PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
SHOWN = {
    "surface": True,
    "prior": True,
    "robot": True,
    "boxes": True,
    "things": True,
    "arrows": True,
    "frustum": True,
    "ceiling": False,
}
AREA = "const a = document.getElementById('canvas').getBoundingClientRect(); return [a.x, a.y, a.width, a.height]"
# Of the text of a node to the first background behind it that is not transparent.
CONTRAST = """
const parts = (text) => text.match(/[\\d.]+/g).map(Number);
const light = (rgb) => rgb.slice(0, 3).map((value) => value / 255).map((value) =>
    value <= 0.03928 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4)
    .reduce((sum, value, at) => sum + value * [0.2126, 0.7152, 0.0722][at], 0);
let node = document.getElementById(arguments[0]);
const ink = light(parts(getComputedStyle(node).color));
let back = parts(getComputedStyle(node).backgroundColor);
while (back[3] === 0 && node.parentElement) {
    node = node.parentElement;
    back = parts(getComputedStyle(node).backgroundColor);
}
const [low, high] = [ink, light(back)].sort((a, b) => a - b);
return (high + 0.05) / (low + 0.05);
"""
SET = """
const one = document.getElementById(arguments[0]);
one.value = arguments[1];
one.dispatchEvent(new Event(arguments[2]));
"""


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    return true_case(tmp_path_factory.mktemp("case"))


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    browser = open_browser(tmp_path_factory.mktemp("browser"))
    yield browser
    browser.quit()


@pytest.mark.long
def test_browser_draws_and_layers_change_the_picture(driver, case, tmp_path):
    middle = np.asarray(case.detection.mismatches[0].center, float) + np.array([0.5, 0.5, 0.0])
    thing = Unexplained(middle, np.array([1.2, 0.8, 1.5]), 30.0, 40)
    with Page(driver, tmp_path / "report.html", case.detection._replace(unexplained=(thing,))) as page:
        assert page.run("return window.jaxmm.webgl")
        page.run("document.getElementById('labels').hidden = true")  # they come and go with their layers
        all_on = page.picture()
        assert len(np.unique(all_on.reshape(-1, 3), axis=0)) > 200
        layers = page.run("return window.jaxmm.layers")
        assert layers == SHOWN
        for layer in [name for name in layers if name != "arrows"]:  # nothing of it is displaced
            page.run("document.getElementById(`layer-${arguments[0]}`).click()", layer)
            assert changed_share(all_on, page.picture()) > 1e-3, layer
            page.run("window.jaxmm.layers[arguments[0]] = arguments[1]", layer, layers[layer])
            assert changed_share(all_on, page.picture()) == 0.0, layer
        assert "from 0 % (left) to 100 %" in page.text("legend")
        shown = page.run("return getComputedStyle(document.querySelector('#legend .ramp')).backgroundImage")
        assert shown.startswith("linear-gradient")
        page.run(SET, "mode", "evidence", "change")
        by_evidence = page.picture()
        assert changed_share(all_on, by_evidence) > 1e-3 and "support" in page.text("legend")
        page.run(SET, "mode", "distance", "change")
        assert changed_share(by_evidence, page.picture()) > 1e-3 and "by how far off the model" in page.text("legend")
        page.run(SET, "cut-height", "-1.5", "input")
        assert changed_share(all_on, page.picture()) > 0.05
        assert case.detection.summary() in page.driver.title
        listed = page.text("mismatches")
        for one in case.detection.mismatches:
            x, y = one.center[:2]
            words = f"{one.mismatch_type.capitalize()} {one.object_type} at x {x:.2f}, y {y:.2f}"
            assert words in listed and "[" not in listed


def test_browser_points_at_what_is_displaced_and_colours_by_it(driver, case, tmp_path):
    with Page(driver, tmp_path / "report.html", with_displaced(case.detection, distance=0.1)) as page:
        page.run("document.getElementById('labels').hidden = true")
        all_on = page.picture()
        page.run("document.getElementById('layer-arrows').click()")
        assert changed_share(all_on, page.picture()) > 0.0
        page.run("document.getElementById('layer-arrows').click()")
        page.run(SET, "tinting", "deviation", "change")
        coloured = page.picture()
        assert changed_share(all_on, coloured) > 1e-3 and "100 mm" in page.text("legend")
        page.run(SET, "tolerance", "100", "input")
        assert changed_share(coloured, page.picture()) > 0.0 and page.text("off-counts").startswith("0 of ")


def test_browser_does_not_call_sure_what_is_nearly_sure(driver, case, tmp_path):
    chances = {0.99951: "> 99 %", 0.9894: "99 %", 0.425: "43 %", 0.0004: "< 1 %", 0.0: "0 %"}
    one = case.detection.mismatches[0]
    sure = case.detection._replace(mismatches=tuple(one._replace(probability=value) for value in chances))
    with Page(driver, tmp_path / "report.html", sure) as page:
        listed = page.run("return [...document.querySelectorAll('#mismatches small')].map((one) => one.textContent)")
    assert [text.split(",")[0] for text in listed] == [f"probability {words}" for words in chances.values()]


def test_browser_tells_both_types_of_what_may_be_either(driver, case, tmp_path):
    one = case.detection.mismatches[0]._replace(object_type="wall")
    found = tuple(one._replace(type_probability=value) for value in (0.78, 0.96, None))
    with Page(driver, tmp_path / "report.html", case.detection._replace(mismatches=found)) as page:
        panels = []
        for index in range(len(found)):
            page.run("document.querySelectorAll('#mismatches button')[arguments[0]].click()", index)
            panels.append(page.text("chosen"))
    assert "wall 78 %, pillar 22 %" in panels[0]
    assert not any("pillar" in panel for panel in panels[1:])


@pytest.mark.long
def test_browser_selects_what_is_clicked(driver, case, tmp_path):
    detection = case.detection
    with Page(driver, tmp_path / "report.html", detection) as page:
        for one in detection.elements:
            if one.verdict == "unscanned":
                continue
            assert page.run("return window.jaxmm.select(arguments[0])", one.guid)
            page.run("[...document.querySelectorAll('#chosen button')].at(-1).click()")
            page.settle()
            page.run("window.jaxmm.select(null)")
            chosen, tries = None, 0
            for place in points_on(detection, one.guid):  # other elements may stand before some of them
                page.click_at(place)
                chosen, tries = page.run("return window.jaxmm.selected"), tries + 1
                if chosen == one.guid:
                    break
            assert chosen == one.guid, (one.name, tries)
            panel = page.text("chosen")
            assert all(word in panel for word in (one.guid, one.ifc_class, one.verdict, one.storey, one.name))
            assert all(f"{rays} ray" in panel for rays in one.rays) and f"{one.points:,}" in panel
            marked = page.run("return [...document.querySelectorAll('tr.chosen')].map((row) => row.dataset.guid)")
            assert marked == [one.guid]
        with_it = page.picture()
        page.run("window.jaxmm.select(null)")
        assert changed_share(with_it, page.picture()) > 1e-3 and page.text("chosen") == ""


def test_browser_shows_hostile_names_as_text(driver, case, tmp_path):
    with Page(driver, tmp_path / "report.html", hostile(case.detection)) as page:
        page.run("document.querySelectorAll('details').forEach((one) => (one.open = true))")
        assert page.run("return window.jaxmm.select(arguments[0])", EVIL)
        assert page.run("return window.jaxmm.selected") == EVIL
        for place in ("chosen", "table", "scans", "scan-list", "notes", "settings", "scan-details"):
            assert page.run("return document.getElementById(arguments[0]).textContent", place).count(EVIL) >= 1, place
        assert "occluded" in page.text("chosen") and "next view" in page.text("chosen")
        state = page.run("return [window.hacked ?? null, document.images.length, document.scripts.length]")
        assert state == [None, 0, 2]
        shown = page.run("return document.documentElement.scrollWidth - window.innerWidth")
        assert shown <= 0  # a long name breaks its line, not the page


@pytest.mark.long
def test_browser_goes_to_mismatches_and_filters(driver, case, tmp_path):
    detection = hostile(case.detection)
    with Page(driver, tmp_path / "report.html", detection) as page:
        page.run("window.matchMedia = () => ({ matches: false })")  # let the camera fly, as it does for most
        for index, one in enumerate(detection.mismatches):
            page.run("document.querySelectorAll('#mismatches button')[arguments[0]].click()", index)
            page.settle()
            assert page.run("return window.jaxmm.selectedMismatch") == index
            assert page.run("return window.jaxmm.selected") == one.element
            x, y = page.run("return window.jaxmm.project(arguments[0])", one.center.tolist())
            left, top, width, height = page.run(AREA)
            assert abs(x - left - width / 2) < width / 5 and abs(y - top - height / 2) < height / 5
            page.run("window.jaxmm.select(null)")
            page.click_at(one.center - [0.0, 0.0, 0.5])
            assert page.run("return window.jaxmm.selectedMismatch") == index
        both = page.picture()
        page.run("document.getElementById('scan-0').click()")
        assert changed_share(both, page.picture()) > 1e-3
        for verdict in VERDICTS:
            page.run("document.querySelector(`#filters [data-verdict=${arguments[0]}]`).click()", verdict)
            rows = page.run("return [...document.querySelectorAll('tbody tr')].map((row) => row.dataset.guid)")
            assert sorted(rows) == sorted(one.guid for one in detection.elements if one.verdict == verdict)


@pytest.mark.long
def test_browser_is_steered_by_mouse_and_keys(driver, case, tmp_path):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
    from selenium.webdriver.common.keys import Keys

    with Page(driver, tmp_path / "report.html", case.detection) as page:
        canvas = driver.find_element("id", "canvas")
        place = case.detection.mismatches[0].center.tolist()

        def moved(act) -> bool:
            before = page.run("return window.jaxmm.project(arguments[0])", place)
            act.perform()
            page.settle()
            return not np.allclose(before, page.run("return window.jaxmm.project(arguments[0])", place), atol=1.0)

        home = page.run("return window.jaxmm.project(arguments[0])", place)
        for act in (
            ActionChains(driver).click_and_hold(canvas).move_by_offset(60, 20).release(),
            ActionChains(driver).key_down(Keys.SHIFT).click_and_hold(canvas).move_by_offset(40, 0).release(),
            ActionChains(driver).key_up(Keys.SHIFT).scroll_from_origin(ScrollOrigin.from_element(canvas), 0, 120),
            ActionChains(driver).send_keys("+"),
            ActionChains(driver).send_keys(Keys.ARROW_LEFT),
            ActionChains(driver).key_down(Keys.SHIFT).send_keys(Keys.ARROW_UP).key_up(Keys.SHIFT),
            ActionChains(driver).send_keys(Keys.HOME),
        ):  # fmt: skip
            assert moved(act)
        assert page.run("return window.jaxmm.selected") is None  # a drag is no click
        assert np.allclose(home, page.run("return window.jaxmm.project(arguments[0])", place), atol=1e-3)


@pytest.mark.parametrize("prior, scans", [(5000, 1), (0, 1), (0, 0)])
def test_browser_shows_clouds_and_nothing_at_all(driver, case, tmp_path, prior, scans):
    with Page(driver, tmp_path / "report.html", as_cloud(case.detection, prior, scans)) as page:
        assert "No mismatch" in page.text("mismatches")
        colours = len(np.unique(page.picture().reshape(-1, 3), axis=0))
        assert colours > (20 if prior else 1)


def test_browser_without_webgl_says_so_and_shows_the_rest(driver, case, tmp_path):
    path = tmp_path / "report.html"
    blind = "HTMLCanvasElement.prototype.getContext = () => null"
    added = driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": blind})
    try:
        with Page(driver, path, case.detection) as page:
            assert "WebGL" in page.text("failure") and not page.run("return window.jaxmm.webgl")
            page.run("document.querySelector('tbody tr').click()")
            assert page.run("return window.jaxmm.selected") in page.text("chosen")
    finally:
        driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


def test_browser_draws_less_while_it_moves_and_all_of_it_at_rest(driver, case, tmp_path):
    with Page(driver, tmp_path / "report.html", case.detection) as page:
        size = "const c = document.getElementById('canvas'); return [c.width, c.height]"
        whole, before = page.run(size), page.picture()
        page.run("""
            const c = document.getElementById('canvas'), sent = (kind, x) => c.dispatchEvent(new PointerEvent(kind, {
                pointerId: 1, clientX: x, clientY: 400, buttons: 1 }));
            c.setPointerCapture = () => {};
            sent('pointerdown', 400);
            let x = 400;
            const drag = () => { sent('pointermove', x += 1); if (x < 430) window.setTimeout(drag, 30); };
            drag();
            window.dragged = [];
            const watch = () => { window.dragged.push(c.width); if (x < 430) requestAnimationFrame(watch);
                else sent('pointerup', x); };
            watch();
        """)
        time.sleep(2.0)
        page.settle()
        assert max(page.run("return window.dragged")) <= whole[0]
        assert page.run(size) == whole
        assert changed_share(before, page.picture()) > 0.01


def test_browser_turns_dark_with_the_system(driver, case, tmp_path):
    def scheme(name):
        features = [{"name": "prefers-color-scheme", "value": name}]
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})

    with Page(driver, tmp_path / "report.html", case.detection) as page:
        light = page.picture()
        scheme("dark")
        try:
            dark = page.picture()
            assert light.mean() > 170 > 90 > dark.mean()
            page.run("window.jaxmm.select(arguments[0])", case.detection.elements[0].guid)
            for name in ("chosen", "mismatches", "legend", "elements"):
                ratio = page.run(CONTRAST, name)
                assert ratio > 4.5, (name, ratio)  # WCAG 2.1, 1.4.3
        finally:
            scheme("")
        page.run("window.jaxmm.select(null)")
        assert changed_share(light, page.picture()) < 1e-3


def test_browser_fits_a_phone(driver, case, tmp_path):
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
    try:
        with Page(driver, tmp_path / "report.html", hostile(case.detection)) as page:
            assert page.run("return document.documentElement.scrollWidth") <= 390
            fingers = "return getComputedStyle(document.getElementById('canvas')).touchAction"
            assert page.run(fingers) == "pan-y"
            page.run("document.getElementById('canvas').focus()")
            assert page.run(fingers) == "none"
            assert page.picture().shape[1] > 700  # two pixels of the screen for each of the page
            x, y, width, height = page.run(AREA)
            middle = np.array([x + width / 2, y + height / 2])
            places = [one.pose[:3] for one in hostile(case.detection).scans]

            def apart():
                page.settle()
                seen = [page.run("return window.jaxmm.project(arguments[0])", place) for place in places]
                return np.ptp(seen, axis=0)

            before = apart()
            for kind, gap in (("Start", 40), ("Move", 60), ("Move", 80), ("End", None)):
                offsets = [] if gap is None else [-gap, gap]
                points = [{"x": middle[0] + one, "y": middle[1], "id": id} for id, one in enumerate(offsets)]
                touch = {"type": f"touch{kind}", "touchPoints": points}
                driver.execute_cdp_cmd("Input.dispatchTouchEvent", touch)
            assert (apart() > 1.3 * before).all()  # two fingers went twice as far apart
            page.run("document.querySelector('#mismatches button').click()")
            page.settle()
            shown = "return ['stage', 'chosen'].map((id) => document.getElementById(id).getBoundingClientRect())"
            stage, panel = page.run(shown)
            assert 0 <= stage["top"] < stage["bottom"] <= panel["top"] < panel["bottom"] <= PHONE["height"]
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
