"""Detections that are hard to show, and a browser that shows their pages."""

import json
import time
from io import BytesIO
from pathlib import Path
from shutil import which

import numpy as np
import pytest

from jaxmm.reports.page import write_page
from jaxmm.verdicts.results import Detection, Drawing, Mismatch, PriorFile
from jaxmm.verdicts.verdicts import OCCLUDED

EVIL = '</script><script>window.hacked=1</script><img src=x onerror="window.hacked=1">"\'<!--é☃\u2028{{data}}'
BROWSER = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := which(name))), None)
DRIVER = which("chromedriver")
ORIGIN = np.array([155000.25, 463000.5, 12.0])


def hostile(told: Detection) -> Detection:
    """A true case far from the origin, in two scans, with all kinds of mismatches and names that try to run."""
    drawing = told.drawing
    round_one, turned_one = ORIGIN + np.array([1.0, 1.0, 0.0]), ORIGIN + np.array([3.0, 4.0, 0.0])
    mismatches = (
        *(one._replace(center=one.center + ORIGIN) for one in told.mismatches),
        Mismatch("pillar", "added", round_one, np.array([0.6, 0.6, 3.0]), 0.0, 0.8, None, 1, 0.9, "round"),
        Mismatch("wall", "added", turned_one, np.array([2.0, 0.2, 3.0]), 30.0, 0.7),
    )
    first = told.scans[0]._replace(pose=shifted(told.scans[0].pose))
    second = first._replace(file=EVIL, pose=shifted((3.0, 1.0, -0.5, 120.0, -5.0)), notes=(EVIL,))
    element = told.elements[1]._replace(
        guid=EVIL, ifc_class=EVIL, name=EVIL, storey=EVIL, verdict=OCCLUDED,
        next_view=shifted((0.0, 2.0, -0.5, 45.0, 0.0)),
    )  # fmt: skip
    drawing = drawing._replace(
        origin=ORIGIN, guid=tuple(EVIL if name == told.elements[1].guid else name for name in drawing.guid),
        robot_scan=(np.arange(len(drawing.robot)) % 2).astype(np.int32),
        fields_of_view=(drawing.fields_of_view[0], np.zeros((0, 3), np.float32)),
    )  # fmt: skip
    return told._replace(
        mismatches=mismatches, elements=(told.elements[0], element, *told.elements[2:]), scans=(first, second),
        drawing=drawing, notes=(EVIL,), settings={EVIL: EVIL}, registration={EVIL: [EVIL]},
        prior=PriorFile(EVIL, "ifc", 1.0, EVIL),
    )  # fmt: skip


def shifted(pose):
    return (*(float(value) for value in ORIGIN + pose[:3]), *pose[3:])


def as_cloud(detection: Detection, prior: int, scans: int) -> Detection:
    """The same with a cloud of so many points as prior, without mismatches and without points of the robot."""
    old = detection.drawing
    drawing = Drawing(
        old.origin, old.robot[:0], old.robot_probability[:0], old.robot_evidence[:0], old.robot_scan[:0],
        old.prior[:prior], old.prior_probability[:prior], old.prior_evidence[:prior], np.full(prior, -1, np.int32),
        (), None, None, None, tuple(np.zeros((0, 3), np.float32) for _ in range(scans)),
    )  # fmt: skip
    return detection._replace(mismatches=(), elements=(), scans=detection.scans[:scans], drawing=drawing)


def open_browser(folder: Path):
    """A headless Chromium that records its console and every request; skips where there is none."""
    if BROWSER is None or DRIVER is None:
        missing = "chromium" if BROWSER is None else "chromedriver"
        pytest.skip(f"the page is not tested in a browser: found no {missing}")
    selenium = pytest.importorskip("selenium.webdriver", reason="the page is not tested in a browser: no selenium")
    from selenium.webdriver.chrome.service import Service

    options = selenium.ChromeOptions()
    options.binary_location = BROWSER
    for argument in (
        "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
        "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
        "--force-prefers-reduced-motion",
        "--enable-unsafe-swiftshader", "--window-size=1280,943", f"--user-data-dir={folder}",
    ):  # fmt: skip
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    return selenium.Chrome(options=options, service=Service(DRIVER))


class Page:
    """A page in the browser; on leaving, it must have said nothing on the console and asked nothing of a network."""

    def __init__(self, driver, path, detection):
        self.driver, self.path = driver, path
        write_page(path, detection)

    def __enter__(self):
        self.driver.get_log("performance"), self.driver.get_log("browser")
        self.driver.get(self.path.as_uri())
        self.settle()
        return self

    def __exit__(self, kind, *_):
        if kind is None:
            assert self.run("return window.jaxmm.errors") == []
            said = [one["message"] for one in self.driver.get_log("browser")]
            # Without a graphics card Chromium copies every picture to its screen by itself, and warns of its own doing.
            said = [message for message in said if "GPU stall due to ReadPixels" not in message]
            assert said == [], said
            asked = self.requests()
            assert asked == {self.path.as_uri()}, asked

    def requests(self) -> set[str]:
        """Addresses that the page asked for since the log was last read, those in the page itself left out."""
        events = (json.loads(one["message"])["message"] for one in self.driver.get_log("performance"))
        asked = {one["params"]["request"]["url"] for one in events if one["method"] == "Network.requestWillBeSent"}
        timed = set(self.run("return performance.getEntriesByType('resource').map((one) => one.name)"))
        # Chromium's own start page may still be loading: its pictures are none that another page can ask for.
        return {address for address in asked | timed if not address.startswith(("data:", "chrome://"))}

    def run(self, script, *arguments):
        return self.driver.execute_script(script, *arguments)

    def settle(self):
        """Wait until the page is ready and its camera stands still."""
        deadline = time.monotonic() + 120.0  # drawing without a graphics card, beside other tests
        while time.monotonic() < deadline:
            if self.run("return Boolean(window.jaxmm && window.jaxmm.ready && window.jaxmm.still)"):
                return
            time.sleep(0.05)
        raise AssertionError(f"the page does not get ready: {self.run('return window.jaxmm.errors')}")

    def picture(self) -> np.ndarray:
        """(height, width, 3) uint8: the canvas as the screen shows it, with labels and scale."""
        from PIL import Image

        self.settle()
        shot = self.driver.find_element("id", "stage").screenshot_as_png
        return np.asarray(Image.open(BytesIO(shot)).convert("RGB"))

    def click_at(self, place) -> None:
        """Press the mouse where a world position [m] is seen."""
        from selenium.webdriver.common.actions.action_builder import ActionBuilder

        x, y = self.run("return window.jaxmm.project(arguments[0])", [float(value) for value in place])
        assert self.run("return document.elementFromPoint(arguments[0], arguments[1]).id", x, y) == "canvas"
        mouse = ActionBuilder(self.driver)
        mouse.pointer_action.move_to_location(round(x), round(y)).click()
        mouse.perform()
        self.settle()

    def text(self, name) -> str:
        return self.run("return document.getElementById(arguments[0]).innerText", name)


def changed_share(before, after) -> float:
    """Share of the pixels that differ by more than the rounding of one picture into another."""
    return float(np.mean(np.any(np.abs(before.astype(int) - after) > 4, axis=-1)))


def points_on(detection: Detection, guid: str) -> np.ndarray:
    """World places on the surface of an element, at the height of a table."""
    drawing = detection.drawing
    row = drawing.guid.index(guid)
    corner = drawing.vertices[drawing.faces[drawing.face_element == row]].astype(float)
    low, high = corner.min(axis=(0, 1)), corner.max(axis=(0, 1))
    parts = np.random.default_rng(0).uniform(0.1, 0.9, (6, 3))
    return drawing.origin + low + parts * (high - low)
