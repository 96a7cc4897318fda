"""progress.html in headless Chromium: the slider moves, what is clicked is told, nothing foreign runs."""

import json

import pytest

from jaxmm.weeks.history import follow
from jaxmm.weeks.outlines import outlines_of
from jaxmm.weeks.page import write_page
from jaxmm.weeks.reports import read_weeks
from tests.cases.four_weeks import DATES, SEEN, STATES, report, write_reports
from tests.cases.pages import EVIL, open_browser

PHONE = {"width": 390, "height": 844, "deviceScaleFactor": 2, "mobile": True}
GO = """
const week = document.getElementById("week");
week.value = arguments[0];
week.dispatchEvent(new Event("input"));
"""
SHAPES = """
return [...document.querySelectorAll("#plan .element")].map((one) => [one.textContent.split(":")[0],
  one.getAttribute("class"), getComputedStyle(one).fill]);
"""


@pytest.fixture(scope="module")
def driver(tmp_path_factory):
    browser = open_browser(tmp_path_factory.mktemp("browser"))
    yield browser
    browser.quit()


def opened(driver, folder, contents):
    progress = follow(read_weeks(write_reports(folder, contents)))
    write_page(folder / "progress.html", progress, outlines_of(progress))
    driver.get_log("performance"), driver.get_log("browser")
    driver.get((folder / "progress.html").as_uri())


def check_quiet(driver):
    """It said nothing on the console and asked nothing of a network."""
    assert driver.get_log("browser") == []
    events = [json.loads(one["message"])["message"] for one in driver.get_log("performance")]
    asked = {one["params"]["request"]["url"] for one in events if one["method"] == "Network.requestWillBeSent"}
    assert all(url.startswith(("file:", "data:", "chrome:")) for url in asked), asked


def test_the_slider_shows_every_week(driver, tmp_path):
    opened(driver, tmp_path, [report(week) for week in range(4)])
    text = lambda name: driver.execute_script("return document.getElementById(arguments[0]).textContent", name)  # noqa: E731
    assert text("date") == DATES[-1]
    for week in range(4):
        driver.execute_script(GO, week)
        assert text("date") == DATES[week]
        shapes = {name: classes.split() for name, classes, _ in driver.execute_script(SHAPES)}
        ground = [name for name in SEEN if name[0] in "AC"]
        assert sorted(shapes) == ground
        for name in ground:
            assert shapes[name][1] == STATES[name][week].replace(" ", "-")
            assert ("kept" in shapes[name]) == (SEEN[name][week] in "ou")
    assert "A3 Wall, Ground floor: removed, was built" in text("changes")
    for week, words in (
        (0, "A1 Wall, Ground floor: first seen to stand"),
        (1, "A3 Wall, Ground floor: built, was not"),
    ):
        driver.execute_script(GO, week)
        assert words in text("changes") and ("built" in text("changes").replace("not built", "")) == (week > 0)
    driver.execute_script(GO, 3)
    driver.execute_script("document.querySelectorAll('#storeys button')[1].click()")
    assert {name for name, *_ in driver.execute_script(SHAPES)} == {"B1", "B2", "B3", "B4"}
    driver.execute_script(
        "[...document.querySelectorAll('#rows button')].find((one) => one.textContent === 'B2').click()"
    )
    assert "by 29 mm from 2026-03-16 to 2026-03-23" in text("chosen")
    guids = {one["name"]: one["guid"] for one in report(3)["elements"]}
    assert guids["B2"] in text("chosen") and all(guid in text("rows") for guid in guids.values())
    fills = {name: fill for name, _, fill in driver.execute_script(SHAPES)}
    driver.execute_script(
        "const m = document.getElementById('mode'); m.value = 'first'; m.dispatchEvent(new Event('change'))"
    )
    first = {name: fill for name, _, fill in driver.execute_script(SHAPES)}
    assert fills["B1"] != fills["B2"] and first["B1"] == first["B2"] == "rgb(56, 185, 119)"
    check_quiet(driver)


@pytest.mark.parametrize("dark", [False, True])
def test_phones_and_hostile_names(driver, tmp_path, dark):
    contents = [report(week) for week in range(2)]
    for content in contents:
        for one in content["elements"]:
            one["name"] = one["storey"] = EVIL
    scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", PHONE)
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": scheme})
    try:
        opened(driver, tmp_path, contents)
        assert driver.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
        assert driver.execute_script("return window.hacked === undefined")
        back = driver.execute_script("return getComputedStyle(document.body).backgroundColor")
        assert back == ("rgb(21, 24, 28)" if dark else "rgb(255, 255, 255)")
        check_quiet(driver)
    finally:
        driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
