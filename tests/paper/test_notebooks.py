"""The notebooks of paper/notebooks run from anywhere without an error, and what they tell is true.

Each runs once, on the smallest settings; a last cell of ours then states what must hold.
"""

import base64
import re
import sys
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "paper" / "notebooks").glob("*.ipynb"))
IMPORTED = {"jaxmm", "warp_scanner", "numpy", "matplotlib", *sys.stdlib_module_names}

TRUTHS = {
    "first_look": """
        np.testing.assert_allclose(share.sum(axis=1), 1.0, atol=1e-5)
        gone_truly = pairs.changed_dt[0, dt.pixel] & pairs.testable_dt[0, dt.pixel]
        assert gone_truly.sum() > 100 and (share[gone_truly].argmax(axis=1) == 0).mean() > 0.95  # rays went through
        assert len(removed) == 2 and told == {guid[int(number)] for number in removed}
        new_ones = [one for one in found.mismatches if one.mismatch_type == "added"]
        new = np.flatnonzero(pairs.box.change[0] == 1)
        assert len(new_ones) == len(new) == 2
        for one in new_ones:  # its middle lies in what was added, though not all of that is in view
            angle = np.radians(pairs.box.yaw[0, new])
            x, y = (one.center[:2] - pairs.box.center[0, new, :2]).T
            along = np.column_stack([x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)])
            assert (np.abs(along) <= pairs.box.size[0, new, :2] / 2).all(axis=1).sum() == 1
        assert {one.guid for one in found.elements if one.verdict == "removed"} == told
        for side, changed in zip(sides, truth, strict=True):
            assert side.probability[changed].mean() > 0.5 > 0.1 > side.probability[~changed].mean()
    """,
    "reproduce_a_row": """
        assert path.name == "smoke.toml" and config.data.test_rooms == len(rooms) == 5
        assert {method for _, method in results} == {"nn-raw", "rule", "nn", "evidence"}
        assert reported == {"roc_auc": 0.9923, "thesis_fpr_at_95": 0.0605, "precision_at_95": 0.5484,
                            "thesis_iou_at_95": 0.5326}
        for result in results.values():
            assert result["room_count"] == 5 and 0 <= result["scene_count"] <= 5
            for metric in ("roc_auc", "precision_at_95"):
                assert result[metric] is None or 0.0 <= result[metric] <= 1.0
        counted = [room for room in rooms if room["positives"]["true"] >= config.evaluate.least_positives]
        assert results["true", "evidence"]["scene_count"] == len(counted) > 1
        scored = [room["methods"]["evidence"]["metrics"]["true"]["roc_auc"] for room in counted]
        assert abs(results["true", "evidence"]["roc_auc"] - np.mean(scored)) < 1e-9
        assert results["true", "rule"]["roc_auc"] > results["true", "nn-raw"]["roc_auc"]
        assert len(arrays["points"]) == len(truth) and truth.sum() >= config.evaluate.least_positives
        assert not run.exists()  # nothing is left behind
    """,
    "new_object_or_sensor": """
        for name, sensor in sensors.items():
            rows, columns = sensor.shape
            assert dt[name].distance.shape == robot[name].distance.shape == (1, rows * columns)
            assert (dt[name].element[0] == COLUMN).any() and not (robot[name].element[0] == COLUMN).any()
            assert (dt[name].element[0] != CABINET).all() and (robot[name].element[0] == CABINET).any()
            # The face of the cabinet that looks at the sensor lies 3.25 m ahead.
            hit = (robot[name].element[0] == CABINET) & np.isfinite(robot[name].distance[0])
            ahead = robot[name].distance[0, hit] * sensor.directions()[hit, 0]
            assert abs(np.median(ahead) - 3.25) < 0.005
        at = {element: list(ids).index(element) for element in (COLUMN, CORNER, BEAM)}
        for found_by in verdicts.values():
            assert [found_by[at[one]].verdict for one in at] == ["removed", "occluded", "present"]
            assert all(found_by[at[CORNER]].rays[side] == 0 for side in (0, 1, 3))
        for element, row in at.items():  # scans add up, ray by ray
            both = np.array(verdicts["both"][row].rays)
            assert (both == sum(np.array(verdicts[name][row].rays) for name in sensors)).all()
        gone = [one for one in found.mismatches if one.mismatch_type == "removed"]
        assert [one.element for one in gone] == [f"element {COLUMN}"]
        assert np.allclose(gone[0].center, [1.0, 1.2, 0.0], atol=0.01) and np.isclose(gone[0].dimensions[2], 3.0)
        assert settings.sensor == camera and pairs.dt.distance.shape == (4, 240 * 160)
    """,
}
STARTED_IN = {"first_look": ".", "reproduce_a_row": "paper/notebooks", "new_object_or_sensor": "tests"}


@pytest.fixture(autouse=True)
def _apart(tmp_path, monkeypatch):
    """Kernels find this source tree, the smallest settings, and folders of their own for what they write."""
    monkeypatch.setenv("JAXMM_CONFIG", str(ROOT / "configs" / "smoke.toml"))
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("JUPYTER_CONFIG_DIR", str(tmp_path / "config"))


def read(name: str):
    return nbformat.read(ROOT / "paper" / "notebooks" / f"{name}.ipynb", as_version=4)


def pictures_of(notebook) -> list[bytes]:
    """The PNG files among the outputs."""
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    return [base64.b64decode(output.data["image/png"]) for output in outputs if "image/png" in output.get("data", {})]


@pytest.mark.long
@pytest.mark.parametrize("name", TRUTHS)
def test_a_notebook_runs_and_tells_the_truth(name):
    pytest.importorskip("ifcopenshell")
    notebook = read(name)
    truths = "\n".join(line[8:] for line in TRUTHS[name].strip("\n").splitlines())
    notebook.cells.append(nbformat.v4.new_code_cell(truths))
    folder = {"metadata": {"path": str(ROOT / STARTED_IN[name])}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=folder).execute()  # raises on any error
    codes = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in codes] == list(range(1, len(codes) + 1))
    shown = read(name)
    assert len(pictures_of(notebook)) == sum("plt.show()" in cell.source for cell in shown.cells)
    for picture in pictures_of(notebook):
        assert len(picture) > 5_000  # more than empty axes
    rich = [
        output.data["text/html"] for cell in codes for output in cell.outputs if "text/html" in output.get("data", {})
    ]
    wanted = sum(cell.source.splitlines()[-1] == "found" for cell in shown.cells if cell.cell_type == "code")
    assert len(rich) == wanted
    for html in rich:
        assert "data:image/png;base64," in html and "1 pillar removed" in html


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_what_is_committed_is_clean(path):
    assert path.stem in TRUTHS
    text, notebook = path.read_text(encoding="utf-8"), read(path.stem)
    nbformat.validate(notebook)
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert notebook.metadata.kernelspec.name == "python3"
    assert not re.search(r"/(work|home|root|tmp|Users|usr)/|[A-Z]:\\\\|https?://", text)
    assert text == nbformat.writes(notebook) + "\n" * text.endswith("\n")
    for cell in notebook.cells:
        assert not cell.metadata
        if cell.cell_type == "code":
            assert not cell.outputs and cell.execution_count is None
            assert not re.search(r"^\s*[!%]", cell.source, re.MULTILINE), cell.source
            assert max(map(len, cell.source.splitlines())) <= 120
            modules = re.findall(r"^(?:from|import) (\w+)", cell.source, re.MULTILINE)
            assert set(modules) <= IMPORTED, modules
    assert notebook.cells[0].cell_type == "markdown" and notebook.cells[0].source.startswith("# ")


def test_every_notebook_has_its_truths():
    assert {path.stem for path in NOTEBOOKS} == set(TRUTHS) == set(STARTED_IN)
