"""What the texts point to is there, and no gap was left to fill."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
TEXTS = sorted([*ROOT.glob("*.md"), *(ROOT / "paper").glob("*.md"), *(ROOT / "benchmarks").glob("*.md")])


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_local_links_and_images_exist(path):
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text()):
        if "://" not in target and not target.startswith("#"):
            assert (path.parent / target).exists(), target


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_placeholder_is_left(path):
    assert not re.search(r"\b(DEMO_[A-Z]+|TBD)\b", path.read_text())


def test_commands_and_configs_of_the_readme_exist():
    text = (ROOT / "README.md").read_text()
    for config in re.findall(r"configs/\w+\.toml", text):
        assert (ROOT / config).is_file(), config
    makefile = (ROOT / "Makefile").read_text()
    for target in re.findall(r"make ([a-z-]+)", text):
        if target not in ("demo", "test") and f"`make {target}`" not in text:
            continue
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
