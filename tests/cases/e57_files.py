"""E57 files as any program might write them, column by column."""

from pathlib import Path

import numpy as np


def write_e57(path: Path, scans: list[tuple[dict[str, np.ndarray], tuple | None]], started: float = 0.0) -> None:
    """Write a file of scans: columns by name, and the pose (position, quaternion w, x, y, z) or None, of each.

    `started` is when, in GPS seconds; 0: the file does not say.
    """
    import pye57
    from pye57 import libe57

    with pye57.E57(str(path), mode="w") as file:
        image = file.image_file

        def structure(names, values):
            node = libe57.StructureNode(image)
            for name, value in zip(names, values, strict=True):
                node.set(name, libe57.FloatNode(image, float(value)))
            return node

        for columns, pose in scans:
            scan, kinds = libe57.StructureNode(image), libe57.StructureNode(image)
            file.data3d.append(scan)
            if started:
                time = libe57.StructureNode(image)
                time.set("dateTimeValue", libe57.FloatNode(image, started))
                scan.set("acquisitionStart", time)
            if pose is not None:
                node = libe57.StructureNode(image)
                scan.set("pose", node)
                node.set("rotation", structure("wxyz", pose[1]))
                node.set("translation", structure("xyz", pose[0]))
            buffers = libe57.VectorSourceDestBuffer()
            for name, column in columns.items():
                whole = column.dtype.kind == "i"
                kinds.set(name, libe57.IntegerNode(image, 0, 0, 2) if whole else libe57.FloatNode(image, 0.0))
                buffers.append(libe57.SourceDestBuffer(image, name, column, len(column), True, True))
            points = libe57.CompressedVectorNode(image, kinds, libe57.VectorNode(image, True))
            scan.set("points", points)
            writer = points.writer(buffers)
            if len(column):
                writer.write(len(column))
            writer.close()
