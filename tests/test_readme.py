"""What the texts point to is there, and no gap was left to fill."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (".", "paper", "benchmarks", "jaxmm", "jaxmm/weights")
TEXTS = sorted(path for folder in FOLDERS for path in (ROOT / folder).glob("*.md"))


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_local_links_and_images_exist(path):
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text()):
        if "://" in target:
            continue
        name, _, heading = target.partition("#")
        found = path.parent / name if name else path
        assert found.exists(), target
        if heading:
            titles = re.findall(r"^#+ (.+)$", found.read_text(), re.MULTILINE)
            assert heading in {re.sub(r"[^a-z0-9 -]", "", title.lower()).replace(" ", "-") for title in titles}, target


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_placeholder_is_left(path):
    assert not re.search(r"\b(DEMO_[A-Z]+|TBD)\b|@@", path.read_text())


def test_commands_and_configs_of_the_readme_exist():
    text = (ROOT / "README.md").read_text()
    for config in re.findall(r"configs/\w+\.toml", text):
        assert (ROOT / config).is_file(), config
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"make ([a-z-]+)", text):
        if target not in ("demo", "test") and f"`make {target}`" not in text:
            continue
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
