"""Matrices as placements of an IFC model. Lengths in the file's unit."""

from typing import Any

import numpy as np

from jaxmm.ifc.draft import Draft

LENGTH_DECIMALS = 9  # placements come from matrices, whose noise lies far below
_DIRECTION_DECIMALS = 15


def new_axes(draft: Draft, matrix: np.ndarray) -> Any:
    """An IfcAxis2Placement3D of a (4, 4) rotation and shift."""
    return draft.create(
        "IfcAxis2Placement3D",
        draft.create("IfcCartesianPoint", rounded(matrix[:3, 3], LENGTH_DECIMALS)),
        draft.create("IfcDirection", rounded(matrix[:3, 2], _DIRECTION_DECIMALS)),
        draft.create("IfcDirection", rounded(matrix[:3, 0], _DIRECTION_DECIMALS)),
    )


def rounded(values: np.ndarray, decimals: int = LENGTH_DECIMALS) -> list[float]:
    """Numbers as a file has them: plain, and no -0.0."""
    return [float(value) + 0.0 for value in np.round(values, decimals)]
