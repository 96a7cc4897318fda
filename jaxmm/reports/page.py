"""report.html: one file that shows a detection in 3D and in tables, from disk and without any network.

The parts stand in viewer/: a document, a style, and the pieces of one script. The document allows that very script and
no other, by its hash, and nothing may be loaded: names out of foreign files are shown as text, whatever they hold.
"""

import base64
import hashlib
import html
import re
from importlib import resources
from pathlib import Path

from jaxmm.files import write_text
from jaxmm.reports.markdown import printable, prior_in_words
from jaxmm.reports.page_data import LIMITS, Limits, as_script, page_data
from jaxmm.reports.plain_files import sentences_of
from jaxmm.verdicts.results import Detection

SCRIPTS = (
    "deviations.js", "data.js", "colours.js", "camera.js", "shaders.js", "canvas.js", "surface.js", "marks.js",
    "painter.js", "picking.js", "viewpoints.js", "words.js", "panels.js", "table.js", "controls.js", "labels.js",
    "viewer.js",
)  # fmt: skip


def write_page(path: Path, detection: Detection) -> None:
    """Write the page, whole or not at all.

    Raises:
        OSError: it cannot be written; the path stays as it was.
    """
    write_text(path, page_text(detection))


def page_text(detection: Detection, limits: Limits = LIMITS) -> str:
    """The page as HTML; `limits` bound what its 3D view holds."""
    style, script = _part("page.css"), "\n".join(["(() => {", '"use strict";', *map(_part, SCRIPTS), "})();"])
    allowed = f"script-src {allowed_hash(script)}; style-src {allowed_hash(style)}"
    values = {
        "policy": f"default-src 'none'; img-src data:; {allowed}",
        "title": html.escape(f"jaxmm: {detection.summary()}"),
        "summary": html.escape(detection.summary()),
        "prior": html.escape(printable(f"Compared with: {prior_in_words(detection.prior)}" if detection.prior else "")),
        "doubts": "\n".join(
            f'<p class="doubt">In doubt: {html.escape(printable(one))}</p>' for one in detection.doubts
        ),
        "sentences": "\n".join(f"<li>{html.escape(line)}</li>" for line in sentences_of(detection)),
        "style": style,
        "data": as_script(page_data(detection, limits)),
        "script": script,
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: values[found[1]], _part("page.html"))


def _part(name: str) -> str:
    return (resources.files("jaxmm.reports") / "viewer" / name).read_text(encoding="utf-8")


def allowed_hash(text: str) -> str:
    """What a content security policy calls the one text that it allows."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
