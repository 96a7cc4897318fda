"""All figures of a run by one command: what cannot be drawn is told in a line, and an image says which run it shows."""

import sys

import numpy as np
import pytest
from PIL import Image

from jaxmm import run_folder
from jaxmm.files import load_json, write_json, write_text
from jaxmm.inputs import InputError
from jaxmm.runs.stages import STAGE, STAGES
from paper.figures import __main__ as folder
from paper.figures import network, studies, table
from paper.figures.origin import mark, origin_of
from paper.figures.panels import command
from paper.report import RESULTS
from tests.cases.figure_run import small_config

SCRIPTS = folder.figure_scripts()
COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def run(tmp_path):
    """A run of the paper that has only begun."""
    path = tmp_path / "run"
    with run_folder.open_run(path, small_config(), staged=True):
        pass
    return path


def draw_all(run, out, *names):
    return folder.main([str(run), "--out", str(out), *(["--only", *names] if names else [])])


def test_all_figures_go_on_after_one_that_cannot_be_drawn(run, tmp_path, capsys):
    def missing(run, path):
        raise InputError(f"{run}: expected more")

    scripts = {"none": missing, "network": SCRIPTS["network"]}
    assert folder.draw_all(scripts.items(), run, tmp_path / "out") == 2
    said = capsys.readouterr()
    assert said.err == f"error: none: {run}: expected more\n"
    assert said.out == f"{tmp_path / 'out' / 'network.png'}\n"
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["network.png"]
    assert folder.draw_all([("network", SCRIPTS["network"])], run, tmp_path / "out") == 0


def test_a_run_that_has_only_begun_gives_one_line_a_figure(run, tmp_path, capsys):
    asked = [name for name in SCRIPTS if name not in ("network", "verdicts")]  # these need settings alone
    assert draw_all(run, tmp_path / "out", *asked) == 2
    said = capsys.readouterr()
    lines = said.err.splitlines()
    assert said.out == "" and not any((tmp_path / "out").iterdir())
    assert [line.split(":")[1].strip() for line in lines] == asked
    for line in lines:
        assert line.startswith("error: ") and str(run) in line and "expected" in line and "jaxmm reproduce" in line
        assert "delete" not in line


@pytest.mark.parametrize("kind", ["nowhere", "empty", "a file", "another run", "no settings"])
def test_what_is_no_run_of_the_paper_is_one_line_and_nothing_is_made(kind, tmp_path, capsys, monkeypatch):
    place = tmp_path / "place"
    if kind == "a file":
        place.write_text("mine")
    elif kind == "another run":
        config = small_config()
        with run_folder.open_run(place, type(config)(), staged=True):
            pass
        write_json(place / "table_1.json", load_json(RESULTS / "table_1.json"))
    elif kind != "nowhere":
        place.mkdir()
    if kind == "no settings":
        write_text(place / run_folder.CONFIG, "[paper\n")
    assert draw_all(place, tmp_path / "out") == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith(f"error: {place}") and said.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
    monkeypatch.setattr(sys, "argv", ["table", str(place), "--out", str(tmp_path / "table.png")])
    with pytest.raises(SystemExit) as end:
        command(table.__doc__, table.draw)
    assert end.value.code == 2 and capsys.readouterr().err == said.err
    assert not (tmp_path / "table.png").exists()


def test_one_script_by_itself_says_what_is_missing(run, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["voxels", str(run), "--out", str(tmp_path / "x.png")])
    with pytest.raises(SystemExit) as end:
        command("both scans", SCRIPTS["voxels"])
    said = capsys.readouterr().err
    assert end.value.code == 2 and not (tmp_path / "x.png").exists()
    assert said.startswith(f"error: {run}") and "example.npz" in said and said.count("\n") == 1


def test_unknown_figures_are_refused(run, tmp_path, capsys):
    with pytest.raises(SystemExit) as end:
        draw_all(run, tmp_path / "out", "heatmap")
    assert end.value.code == 2 and "heatmaps" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_file_in_the_place_of_the_folder_is_one_line(run, tmp_path, capsys):
    (tmp_path / "taken").write_text("mine")
    assert draw_all(run, tmp_path / "taken", "network") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "expected a folder" in line and (tmp_path / "taken").read_text() == "mine"


def text_of(path):
    with Image.open(path) as image:
        image.load()
        return image.text, np.asarray(image), image.info["dpi"]


def tell(run, commit, *dates):
    """Let a run say from which commit it is, and its stages when they were made."""
    write_json(run / run_folder.VERSIONS, load_json(run / run_folder.VERSIONS) | {"git_commit": commit})
    for number, date in enumerate(dates):
        (run / STAGES / f"stage{number}").mkdir(parents=True)
        write_json(run / STAGES / f"stage{number}" / STAGE, {} if date is None else {"date": date})


def test_images_say_from_which_run_they_are(run, tmp_path):
    tell(run, COMMIT, "2024-02-28", None, "2024-02-29")
    assert draw_all(run, tmp_path / "out", "network") == 0
    network.draw(run, tmp_path / "plain.png")
    told, pixels, dpi = text_of(tmp_path / "out" / "network.png")
    assert told == {"run_commit": COMMIT, "run_date": "2024-02-29"}
    assert text_of(tmp_path / "plain.png")[0] == {}
    np.testing.assert_array_equal(pixels, text_of(tmp_path / "plain.png")[1])
    assert dpi == text_of(tmp_path / "plain.png")[2]
    first = (tmp_path / "out" / "network.png").read_bytes()
    assert draw_all(run, tmp_path / "out", "network") == 0
    assert (tmp_path / "out" / "network.png").read_bytes() == first
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["network.png"]


def test_images_of_a_run_that_does_not_tell_say_nothing(run, tmp_path):
    tell(run, None, None)
    assert draw_all(run, tmp_path / "out", "network") == 0
    assert text_of(tmp_path / "out" / "network.png")[0] == {}


def test_kept_results_are_drawn_and_say_from_which_run_they_are(tmp_path, monkeypatch):
    path, run = tmp_path / "studies.png", load_json(RESULTS / "run.json")
    monkeypatch.setattr(sys, "argv", ["studies", str(RESULTS), "--out", str(path)])
    command(studies.__doc__, studies.draw)
    assert text_of(path)[0] == {"run_commit": run["versions"]["git_commit"], "run_date": run["date"]}


def test_a_scaled_image_can_be_marked_again_and_other_formats_are_left_alone(run, tmp_path):
    tell(run, COMMIT)
    Image.new("P", (4, 3)).save(tmp_path / "small.png")
    (tmp_path / "a.svg").write_text("<svg/>")
    for name in ("small.png", "a.svg"):
        mark(tmp_path / name, origin_of(run))
    with Image.open(tmp_path / "small.png") as image:
        assert (image.mode, image.size, image.text) == ("P", (4, 3), {"run_commit": COMMIT})
    assert (tmp_path / "a.svg").read_text() == "<svg/>"
