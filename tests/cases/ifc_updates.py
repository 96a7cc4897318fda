"""What the tests of updated building models share: changes to write, and checks that hold for every update."""

import math
import re
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from jaxmm.ifc.marks import COMMON_SETS, OWN_SET
from jaxmm.ifc.undo import revert
from jaxmm.ifc.update import write_update
from jaxmm.verdicts.results import Detection, ElementVerdict, Mismatch, ScanRecord

ifcopenshell = pytest.importorskip("ifcopenshell")

from ifcopenshell import geom, validate  # noqa: E402
from ifcopenshell.util import element as elements_of  # noqa: E402

WHEN = datetime(2026, 3, 4, 5, 6, 7, tzinfo=UTC)
SCANS = (ScanRecord("first scan.ply", 9, (0.0,) * 5, "given", None, {}, {}),
         ScanRecord("zweiter_Blick_é.e57", 9, (0.0,) * 5, "file", None, {}, {}))  # fmt: skip


def found(*mismatches: Mismatch, elements: tuple[ElementVerdict, ...] = ()) -> Detection:
    return Detection(mismatches, elements, SCANS, {}, {}, {}, (), None)


def removed(element, probability=0.93) -> Mismatch:
    guid = element if element is None or isinstance(element, str) else element.GlobalId
    return Mismatch("wall", "removed", np.zeros(3), np.ones(3), 0.0, probability, guid, None, 0.5)


def verdict(element, name: str) -> ElementVerdict:
    return ElementVerdict(element.GlobalId, element.is_a(), "", "", name, 0.02, 5, (0, 1, 90, 2))


ADDED_WALL = Mismatch("wall", "added", np.array([1.25, 2.5, 1.6]), np.array([0.12, 3.0, 2.9]), 30.0, 0.81)
ADDED_COLUMN = Mismatch(
    "pillar", "added", np.array([3.2, -2.5, 4.9]), np.array([0.4, 0.4, 2.7]), 12.0, 0.7, None, None, 0.25, "round"
)


def update(prior: Path, detection: Detection, out: Path, **options):
    """Write, check what holds for every update, and give the summary with the new model."""
    before = prior.read_bytes()
    summary = write_update(prior, detection, out, when=WHEN, **options)
    assert prior.read_bytes() == before
    assert {path.name for path in out.iterdir()} == {"updated.ifc", "undo.json"}
    text = summary.path.read_bytes()
    check_references(text)
    revert(summary.path, out / "back.ifc")
    assert (out / "back.ifc").read_bytes() == before  # so all of it: GlobalIds, attributes, sets, geometry
    (out / "back.ifc").unlink()
    return summary, ifcopenshell.open(str(summary.path))


def check_references(text: bytes) -> None:
    """Every entity that the text refers to stands in it, once."""
    data = re.sub(rb"'(?:[^']|'')*'|/\*.*?\*/", b"", text[text.index(b"DATA;") :], flags=re.DOTALL)
    defined = Counter(re.findall(rb"(#\d+)\s*=", data))
    assert set(defined.values()) == {1}
    assert set(re.findall(rb"#\d+", data)) == defined.keys()


def own_set(model, guid) -> dict:
    return elements_of.get_psets(model.by_guid(guid)).get(OWN_SET, {})


def status(model, guid):
    """What a reader of the standard's property sets gets."""
    element = model.by_guid(guid)
    name = next(name for kind, name in COMMON_SETS.items() if element.is_a(kind))
    return elements_of.get_psets(element, should_inherit=False).get(name, {}).get("Status")


def world_points(model, guid) -> np.ndarray:
    """(n, 3) [m] corners of one element, as ifcopenshell's geometry kernel makes them."""
    settings = geom.settings()
    settings.set("use-world-coords", True)
    shape = geom.create_shape(settings, model.by_guid(guid))
    return np.array(shape.geometry.verts).reshape(-1, 3)


def check_place(points: np.ndarray, one: Mismatch, tolerance=1e-3) -> None:
    """The points are the corners of the mismatch's box, or lie on the rims of its cylinder."""
    angle = math.radians(one.rotation)
    own = (points - one.center) @ np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                                            [0, 0, 1]])  # fmt: skip
    half = one.dimensions / 2.0
    assert np.abs(np.abs(own[:, 2]) - half[2]).max() < tolerance
    if one.shape == "round":
        assert np.abs(np.hypot(own[:, 0], own[:, 1]) - half[0]).max() < tolerance
        assert len(np.unique(np.round(np.arctan2(own[:, 1], own[:, 0]), 3))) > 7
    else:
        assert np.abs(np.abs(own[:, :2]) - half[:2]).max() < tolerance
        assert len(np.unique(np.sign(own), axis=0)) == 8


def surfaces(building) -> dict[str, np.ndarray]:
    """World positions (n, 3) [m] of each element's triangles."""
    world = building.origin + building.triangles.vertices.astype(np.float64)
    corners, element = world[building.triangles.faces], building.triangles.element
    return {guid: corners[element == row].reshape(-1, 3) for row, guid in enumerate(building.elements.guid)}


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """[m] Greatest distance of a corner to the nearest of the other; the order may differ from run to run."""
    return max(cKDTree(one).query(other)[0].max(), cKDTree(other).query(one)[0].max())


def errors(path: Path) -> Counter:
    logger = validate.json_logger()
    validate.validate(ifcopenshell.open(str(path)), logger)
    return Counter((str(one["message"]), str(one.get("attribute"))) for one in logger.statements)
