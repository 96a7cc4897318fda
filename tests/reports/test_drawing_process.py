"""Drawing beside gives what drawing in place gives, tells what goes wrong, and leaves no process behind."""

import subprocess
import sys

import pytest

from jaxmm.reports import drawing_process
from tests.test_imports import ROOT

# In a process of its own: this one may hold JAX, and threads.
BESIDE = """
import os, sys
from pathlib import Path
from jaxmm.reports import drawing_process

def drawn(name):
    def draw(folder, detection):
        if detection == f"{name} fails":
            raise OSError(28, "No space left on device", str(folder))
        if detection == f"{name} dies":
            os._exit(3)
        (folder / name).write_text(f"{os.getpid()} {detection}")
    return draw

def topics(folder, detection, project, version):
    (folder / "topics").write_text(f"{os.getpid()} {project} {version}")

drawing_process._plan, drawing_process._panoramas = drawn("plan"), drawn("panoramas")
drawing_process._topics = topics
folder = Path(sys.argv[1])
with drawing_process.drawing_beside():
    try:
        with drawing_process.drawing(folder, sys.argv[2]) as write_topics:
            if sys.argv[2] == "interrupted":
                raise OSError(4, "Interrupted")
            write_topics("house", version="2.1")
    except OSError as error:
        print("error", error.errno, error.strerror)
    else:
        number, *words = (folder / "plan").read_text().split()
        by, *more = (folder / "topics").read_text().split()
        other, *_ = (folder / "panoramas").read_text().split()
        print(len({number, other, str(os.getpid())}) == 3 and by == number, *words, *more)
with drawing_process.drawing_beside():
    pass
with drawing_process.drawing(folder, "in place"):
    pass
by = {(folder / name).read_text().split()[0] for name in ("plan", "panoramas")}
print(by == {str(os.getpid())}, drawing_process._waiting)
print(os.path.exists(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
      and Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text())
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere everything is drawn in place")
@pytest.mark.parametrize(
    "asked, expected",
    [
        ("detection", "True detection house 2.1"),
        ("plan fails", "error 28 No space left on device"),
        ("panoramas fails", "error 28 No space left on device"),
        ("interrupted", "error 4 Interrupted"),
        ("plan dies", "error None the process that draws was ended"),
        ("panoramas dies", "error None the process that draws was ended"),
    ],
)
def test_what_is_drawn_beside_is_there_and_what_fails_is_told(tmp_path, asked, expected):
    done = subprocess.run(
        [sys.executable, "-c", BESIDE, str(tmp_path), asked], cwd=ROOT, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    first, second, children = done.stdout.splitlines() + [""] * (3 - len(done.stdout.splitlines()))
    assert first == expected and second == "True []"
    assert children.strip() in ("", "False")


def test_with_other_threads_about_everything_is_drawn_in_place(tmp_path, monkeypatch):
    monkeypatch.setattr(drawing_process, "_can_split", lambda: False)
    drawn = []
    for name in ("_plan", "_panoramas", "_topics"):
        monkeypatch.setattr(drawing_process, name, lambda *words: drawn.append(words))
    with drawing_process.drawing_beside():
        with drawing_process.drawing(tmp_path, "detection") as write_topics:
            assert drawn == 2 * [(tmp_path, "detection")]
            write_topics("house")
            assert drawn[2:] == [(tmp_path, "detection", "house")]
