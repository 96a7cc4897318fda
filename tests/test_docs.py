"""What the pages point to is there, their commands are understood, their settings are read, and their Python runs."""

import importlib.util
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import jaxmm
from jaxmm.classes.selection import CLASSES
from jaxmm.commands.cli import _glued, _parser
from jaxmm.config import Config, parse
from jaxmm.verdicts.settings import DetectSettings, load_settings
from warp_scanner.sensors.sensors import PRESETS, sensor_of

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (".", "docs", "paper", "benchmarks", "findings", "jaxmm/weights")
TEXTS = sorted(path for folder in FOLDERS for path in (ROOT / folder).glob("*.md"))
TOLD = [path for path in TEXTS if path.name != "CHANGELOG.md"]  # which names files as they were called then
SHARED = ("command_line.py", "views/building_views.py", "timing.py")  # benchmarks take options from these
named = pytest.mark.parametrize("path", TOLD, ids=lambda path: path.relative_to(ROOT).as_posix())


def blocks(path: Path, *languages: str) -> list[str]:
    """Code blocks of a page in one of some languages; "" is none."""
    found = re.findall(r"^( *)```(\w*)\n(.*?)^\1```", path.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [re.sub(rf"^{indent}", "", text, flags=re.MULTILINE) for indent, kind, text in found if kind in languages]


def commands(path: Path) -> list[list[str]]:
    """Words of the shell commands in the code blocks of a page."""
    lines = [line.split("  #")[0].strip() for text in blocks(path, "", "sh", "bash") for line in text.splitlines()]
    return [shlex.split(line) for line in lines if re.match(r"(jaxmm|make|python|bash) ", line)]


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_local_links_and_images_exist(path):
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if "://" in target:
            continue
        name, _, heading = target.partition("#")
        found = path.parent / name if name else path
        assert found.exists(), target
        if heading:
            titles = re.findall(r"^#+ (.+)$", found.read_text(encoding="utf-8"), re.MULTILINE)
            assert heading in {re.sub(r"[^a-z0-9 _-]", "", title.lower()).replace(" ", "-") for title in titles}, target


@named
def test_files_that_are_named_exist(path):
    folders = "jaxmm|warp_scanner|tests|benchmarks|paper|configs|docs|findings"
    names = re.findall(rf"`((?:{folders})/[\w/.-]+)`", path.read_text(encoding="utf-8"))
    for name in set(names) - {"jaxmm/formats/tri.py", "paper/figures/NAME.py"}:  # examples of what one would add
        assert (ROOT / name).exists(), name


@named
def test_no_placeholder_is_left(path):
    assert not re.search(r"\b(DEMO_[A-Z]+|TBD)\b|@@", path.read_text(encoding="utf-8"))


@named
def test_commands_are_understood(path):
    for words in commands(path):
        if words[0] == "jaxmm" and words[1:] != ["--version"]:
            _parser().parse_args(_glued(words[1:]))
        elif words[0] == "make":
            for target in [word for word in words[1:] if "=" not in word]:
                assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE), words
        elif words[:2] == ["python", "-m"]:
            spec = importlib.util.find_spec(words[2])
            assert spec is not None, words
        elif words[0] == "bash":
            assert "$" in words[1] or "NAME" in words[1] or (ROOT / words[1]).is_file(), words
        elif words[0] == "python" and words[1].endswith(".py"):
            assert (ROOT / words[1]).is_file(), words
        for word in words:
            assert not word.startswith("configs/") or (ROOT / word).is_file(), words


@named
def test_modules_and_targets_in_prose_exist(path):
    text = path.read_text(encoding="utf-8")
    modules = set(re.findall(r"`(?:python -m )?((?:benchmarks|paper)(?:\.\w+)+)", text))
    for module in modules - {"benchmarks.NAME"}:
        assert importlib.util.find_spec(module) is not None, module
    for target in re.findall(r"`make ([a-z-]+)", text):
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(), re.MULTILINE), target


@named
def test_options_in_prose_are_options_of_a_command(path):
    """Of `jaxmm`, or of a script: those that a page names stand in their sources."""
    known = {word for parser in _parsers().values() for word in re.findall(r"--[a-z-]+", parser.format_help())}
    scripts = {
        word for file in _scripts() for word in re.findall(r'"(--[a-z0-9-]+)"', file.read_text(encoding="utf-8"))
    }
    for option in re.findall(
        r"(?<![\w-])(--[a-z][a-z-]+)", re.sub(r"```.*?```", "", path.read_text(), flags=re.DOTALL)
    ):
        assert option in known | scripts | {"--version"}, option


def test_options_of_scripts_are_theirs():
    shared = "".join((ROOT / "benchmarks" / name).read_text() for name in SHARED)
    for path in TOLD:
        for words in commands(path):
            if words[0] == "python":
                sources = shared + _source(words).read_text(encoding="utf-8")
                for word in [word for word in words if word.startswith("--")]:
                    assert f'"{word}"' in sources, (path.name, words)


def _source(words: list[str]) -> Path:
    """The file that `python FILE` or `python -m MODULE` runs."""
    if words[1] != "-m":
        return ROOT / words[1]
    place = ROOT / Path(*words[2].split("."))
    return place / "__main__.py" if place.is_dir() else place.with_suffix(".py")


def _scripts():
    return [path for folder in ("benchmarks", "paper", "tests") for path in (ROOT / folder).rglob("*.py")]


def test_the_results_in_the_readme_are_those_of_the_benchmarks():
    measured = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8").split("Preset `varied`:")[1]
    rows = re.findall(r"^\| (\w+ \w+), (\w+) \| (\d+/\d+) \|(.*)\|$", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert len(rows) == 8
    for change, condition, rooms, scores in rows:
        row = next(line for line in measured.splitlines() if line.startswith(f"| {change} {condition} | {rooms} |"))
        assert [cell.strip() for cell in scores.split("|")] == [cell.strip() for cell in row.split("|")[4:7]], row


def test_what_the_pages_name_for_scripts_and_sensors_is_there():
    page = (ROOT / "docs" / "inputs-and-outputs.md").read_text(encoding="utf-8")
    told = page.split("## Names for scripts")[1].split("```")[0]
    assert set(re.findall(r"`(\w+)`", told)) == set(jaxmm.__all__)
    presets = re.search(r"Presets: (.*?)\.\s", page, re.DOTALL)[1]
    assert set(re.findall(r"`([\w-]+)`", presets)) == {name for name in PRESETS if not name.endswith("-real")}


def test_every_page_is_one_click_from_the_readme_which_is_short():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(readme.splitlines()) <= 200
    for page in (ROOT / "docs").glob("*.md"):
        assert f"](docs/{page.name})" in readme, page.name


@named
def test_settings_are_read(path, tmp_path):
    for text in blocks(path, "toml"):
        table = tomllib.loads(text)
        if "kind" in table:
            assert sensor_of(table, path.name).range_limits == tuple(table["range_limits"])
        elif "classes" in table:
            (tmp_path / "settings.toml").write_text(text)
            read = load_settings(tmp_path / "settings.toml")
            assert read != DetectSettings() and read.classes == tuple(table["classes"])
        else:
            read = parse(text, path.name)
            assert read != Config() and {
                name for name in table if getattr(read, name) != getattr(Config(), name)
            } == set(table)


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    pytest.importorskip("ifcopenshell")
    pytest.importorskip("pye57")
    from tests.cases.house import write_house

    folder = tmp_path_factory.mktemp("house")
    write_house(folder)
    return folder


@pytest.mark.parametrize("page", ["README.md", "docs/inputs-and-outputs.md", "docs/scanner.md"])
def test_python_of_a_page_runs(page, house):
    code = "\n".join(blocks(ROOT / page, "python"))
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=house, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    if page == "README.md":
        assert "A pillar has been removed at [4.5 1. 1.5] with dimensions [0.4 0.4 3.]." in done.stdout
        assert (house / "found" / "report.html").is_file()


def test_the_help_names_every_element_class():
    assert f"of {','.join(CLASSES)}; or any of IFC" in re.sub(r"\s+", " ", _parsers()["detect"].format_help())


def _parsers(parser=None):
    """Every command by name; the steps of a command by theirs."""
    found = {}
    for action in (parser or _parser())._subparsers._group_actions:
        for name, own in action.choices.items():
            found |= {name: own} | (_parsers(own) if own._subparsers else {})
    return found
