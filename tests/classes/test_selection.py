"""Who is asked for: by our names, by classes of IFC with their kinds, or everybody."""

import numpy as np
import pytest

from jaxmm.classes.selection import ALL, CLASSES, check_classes, chosen, is_of
from warp_scanner.scenes.building import Elements
from warp_scanner.scenes.scenes import CEILING, DOOR, FLOOR, OTHER, PILLAR, WALL

CLASS = (
    "IfcWallStandardCase", "IfcColumn", "IfcDoor", "IfcSlab", "IfcSlab", "IfcPipeSegment", "IfcDuctSegment", "IfcBeam",
    "IfcFurniture", "IfcBuildingElementProxy", "",
)  # fmt: skip
SEMANTIC = (WALL, PILLAR, DOOR, FLOOR, CEILING, OTHER, OTHER, OTHER, OTHER, OTHER, WALL)
ELEMENTS = Elements(
    tuple("abcdefghijk"), CLASS, ("",) * 11, np.zeros(11, np.int32), np.array(SEMANTIC, np.uint8),
    ("",) * 11, ((),) * 11,
)  # fmt: skip


def rows(*names):
    check_classes(names)
    return np.flatnonzero(chosen(names, ELEMENTS)).tolist()


@pytest.mark.parametrize(
    "names, expected",
    [
        pytest.param(["wall"], [0, 10], id="ours, a mesh's, too"),
        pytest.param(["IfcWall"], [0], id="a kind of it"),
        pytest.param(["slab"], [3], id="floors"),
        pytest.param(["IfcSlab"], [3, 4], id="a roof's slab is one"),
        pytest.param(["IfcFlowSegment"], [5, 6], id="pipes and ducts"),
        pytest.param(["IfcPipeSegment"], [5], id="pipes alone"),
        pytest.param(["ifcbeam"], [7], id="in any case"),
        pytest.param(["IfcFurnishingElement"], [8], id="furniture"),
        pytest.param(["IfcBuildingElement"], [0, 1, 2, 3, 4, 7, 9], id="of IFC2X3 and IFC4, by another name in 4X3"),
        pytest.param(["IfcElement"], list(range(10)), id="all of IFC"),
        pytest.param([ALL], list(range(11)), id="all"),
        pytest.param(["column", "IfcBeam"], [1, 7], id="both kinds of names"),
        pytest.param([], [], id="nobody"),
    ],
)
def test_classes_choose_elements(names, expected):
    assert rows(*names) == expected


@pytest.mark.parametrize("name", ["beam", "IfcFoo", "IfcTask", "Ifc", "", "walls", "IfcLabel", "ALL"])
def test_a_name_of_no_class_is_refused(name):
    with pytest.raises(ValueError, match=f"got {name}"):
        check_classes(["wall", name])


def test_ours_are_no_classes_of_ifc():
    assert all(not is_of([name], one) for name in CLASSES for one in CLASS)
