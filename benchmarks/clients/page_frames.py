"""How long a frame of the report's 3D view takes in a browser without a graphics card, beside an earlier build.

    python -m benchmarks.clients.page_frames [--against DIR|REVISION] [--points 300000] [--elements 3000] [--json FILE]

A made-up detection of so many points and elements is written as report.html by each build. Headless Chromium opens the
pages in turns and turns the camera as a mouse would, one step for each frame. A frame lasts from one step to the next,
when all that the page asked for is drawn; while the camera moves, less is drawn where a machine is slow. At rest, the
whole picture is drawn once. The middle one should take no more than 100 ms. Takes two minutes; needs chromium,
chromedriver and selenium.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from shutil import which
from typing import Any, NamedTuple

import numpy as np
import psutil

from benchmarks.command_line import CommandLine
from benchmarks.commands import checkout
from benchmarks.timing import write_report

LIMIT = 100.0  # [ms] that a frame should take at most; a slow machine ends no run of all benchmarks
SECONDS = 600  # that all frames of a page may take
MADE = Path(__file__).parents[1] / "views" / "made_page.py"
ROUNDS, FRAMES, LED = 2, 24, 12  # frames of each round, behind those in which the page finds its pace
FULL = {"points": 300_000, "elements": 3000, "rounds": ROUNDS}
SMOKE = {"points": 3000, "elements": 30, "rounds": 1}
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
ARGUMENTS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
    "--enable-unsafe-swiftshader", "--window-size=1280,943",
)  # fmt: skip
# Turns by a mouse that is held; reading one pixel waits until all is drawn.
TURN = """
const [count, done] = arguments, canvas = document.getElementById("canvas"), gl = canvas.getContext("webgl2");
const pixel = new Uint8Array(4), times = [], told = { pointerId: 1, isPrimary: true, button: 0, buttons: 1 };
canvas.setPointerCapture = () => {};
let x = 300, at = performance.now();
const send = (kind) => {
  canvas.dispatchEvent(new PointerEvent(kind, { ...told, clientX: x, clientY: 300, bubbles: true }));
};
send("pointerdown");
const step = () => {
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  const now = performance.now();
  times.push(now - at);
  at = now;
  if (times.length === count) { send("pointerup"); return done(times); }
  x += 4;
  send("pointermove");
  window.requestAnimationFrame(step);
};
window.requestAnimationFrame(step);
"""
# The whole picture, of a camera at rest, as when a layer is shown anew.
WHOLE = """
const done = arguments[0], gl = document.getElementById("canvas").getContext("webgl2"), pixel = new Uint8Array(4);
const at = performance.now();
window.jaxmm.layers.robot = true;
window.requestAnimationFrame(() => {
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
  done(performance.now() - at);
});
"""


def main() -> int:
    parser = CommandLine(__doc__, FULL, SMOKE)
    parser.add_json()
    parser.add_argument("--points", type=int, help="points of both sides")
    parser.add_argument("--elements", type=int, help="elements with a verdict")
    parser.add_argument("--rounds", type=int, help="times that each page is opened")
    parser.add_argument("--against", metavar="DIR|REVISION", help="another build, to measure beside this one")
    options = parser.parse_args()
    browser = next((found for name in BROWSERS if (found := which(name))), None)
    if browser is None or which("chromedriver") is None:
        print("frames are not measured: chromium and chromedriver are not installed", file=sys.stderr)
        return 2
    here = Path(__file__).resolve().parents[2]
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        trees = {"this build": here} | ({options.against: checkout(options.against, work)} if options.against else {})
        pages = {name: page_of(tree, work, options.points, options.elements) for name, tree in trees.items()}
        rows = measured(pages, browser, options.rounds)
    if options.json:
        write_report(options.json, rows, "selenium")
    return 0


def page_of(tree: Path, work: Path, points: int, elements: int) -> Path:
    """The page that the build in a tree writes."""
    page = work / f"{tree.name}.html"
    words = [sys.executable, MADE, page, str(points), str(elements)]
    subprocess.run(words, env=os.environ | {"PYTHONPATH": str(tree)}, check=True, stdout=subprocess.DEVNULL)
    return page


def measured(pages: dict[str, Path], browser: str, rounds: int) -> list[dict[str, Any]]:
    """A row for each build [ms]: the middle frame, what nine of ten are within, the slowest, the whole picture."""
    found: dict[str, list[Turned]] = {name: [] for name in pages}
    for _ in range(rounds):
        for name, page in pages.items():
            found[name].append(frames(page, browser))
    rows = []
    print("| build | middle frame [ms] | 9 of 10 within | slowest | computing for a frame | at rest, whole |")
    print("|---|---|---|---|---|---|")
    for name, some in found.items():
        middle, most, worst = np.percentile([one.frames for one in some], [50, 90, 100]).tolist()
        computed, whole = (float(np.median(values)) for values in zip(*(one[1:] for one in some), strict=True))
        print(f"| {name} | {middle:.0f} | {most:.0f} | {worst:.0f} | {computed:.0f} | {whole:.0f} |", flush=True)
        rows.append({
            "case": name, "ours": round(middle, 1), "peer": LIMIT, "peer_name": "limit", "unit": "ms",
            "ratio": round(LIMIT / max(middle, 1e-9), 2), "most": most, "worst": worst, "computed": computed,
            "whole": whole,
        })  # fmt: skip
    return rows


class Turned(NamedTuple):
    """What a page took while its camera turned, and then [ms]."""

    frames: list[float]  # each of FRAMES
    computed: float  # of all cores, in all of the browser's processes, for a frame
    whole: float  # the picture at rest


def _computed(driver: int) -> float:
    """[s] that a driver's browser has computed so far."""
    times = [one.cpu_times() for one in psutil.Process(driver).children(recursive=True)]
    return float(sum(one.user + one.system for one in times))


def frames(page: Path, browser: str) -> Turned:
    """A page in a browser of its own, whose camera turns."""
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service
    from selenium.webdriver.support.ui import WebDriverWait

    with tempfile.TemporaryDirectory() as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = browser
        for argument in (*ARGUMENTS, f"--user-data-dir={profile}"):
            options.add_argument(argument)
        driver = webdriver.Chrome(options=options, service=Service(which("chromedriver")))
        try:
            driver.set_script_timeout(SECONDS)
            driver.command_executor.client_config.timeout = SECONDS
            driver.get(page.as_uri())
            ready = "return Boolean(window.jaxmm && window.jaxmm.ready && window.jaxmm.still)"
            WebDriverWait(driver, 120).until(lambda one: one.execute_script(ready))
            before = _computed(driver.service.process.pid)
            turned = driver.execute_async_script(TURN, LED + FRAMES)
            computed = 1000.0 * (_computed(driver.service.process.pid) - before) / len(turned)
            WebDriverWait(driver, SECONDS).until(lambda one: one.execute_script(ready))
            return Turned(turned[LED:], computed, driver.execute_async_script(WHOLE))
        finally:
            driver.quit()


if __name__ == "__main__":
    sys.exit(main())
