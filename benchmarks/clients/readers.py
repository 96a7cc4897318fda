"""Programs that read our files, each in a process of its own, for some end the process that they fail in.

    python -m benchmarks.clients.readers NAME FILE OUT.npz     what one reads, in arrays

Nothing here imports jaxmm: it runs in whatever environment has the program.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from shutil import which

import numpy as np

Read = tuple[np.ndarray, list[str]]  # points (N, 3) [m], names of fields


def open3d_io(path: Path) -> Read:
    """Open3D's older reader, which says nothing of fields."""
    import open3d

    return np.asarray(open3d.io.read_point_cloud(str(path)).points), []


def open3d_t_io(path: Path) -> Read:
    """Open3D's newer reader."""
    import open3d

    cloud = open3d.t.io.read_point_cloud(str(path))
    return cloud.point.positions.numpy(), [name for name in cloud.point if name != "positions"]


def meshlab(path: Path) -> Read:
    """MeshLab, by pymeshlab."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(path))
    return np.asarray(meshes.current_mesh().vertex_matrix()), []


def pye57(path: Path) -> Read:
    """pye57 with nothing but its defaults."""
    import pye57 as library

    read = library.E57(str(path)).read_scan(0, intensity=True)
    return np.column_stack([read[f"cartesian{axis}"] for axis in "XYZ"]), [
        name for name in read if not name.startswith("cartesian")
    ]


def e57(path: Path) -> Read:
    """The Rust library e57."""
    import e57 as library

    return np.asarray(library.read_points(str(path)).points), []


def laspy(path: Path) -> Read:
    """laspy, by another process than that which wrote."""
    import laspy as library

    read = library.read(path)
    return np.array(read.xyz), list(read.point_format.extra_dimension_names)


def trimesh(path: Path) -> Read:
    """trimesh."""
    import trimesh as library

    read = library.load(path)
    return np.asarray(read.vertices), [
        name for name in read.metadata["_ply_raw"]["vertex"]["properties"] if name not in ("x", "y", "z")
    ]


def cloudcompare(path: Path) -> Read:
    """CloudCompare without a window, which writes what it read as text."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "read.asc"
        words = ["-SILENT", "-AUTO_SAVE", "OFF", "-NO_TIMESTAMP", "-C_EXPORT_FMT", "ASC", "-PREC", "6", "-ADD_HEADER"]
        words += ["-O", "-GLOBAL_SHIFT", "AUTO", str(path), "-SAVE_CLOUDS", "FILE", str(out)]
        _run([_program("CloudCompare"), *words])
        if not out.exists():
            raise ValueError("this build cannot read the format")
        lines = out.read_text().splitlines()
    return np.array([line.split()[:3] for line in lines[1:]], float), lines[0].lstrip("/").split()[3:]


def pcl(path: Path) -> Read:
    """The Point Cloud Library's tools, as points of single precision, which its algorithms work on."""
    with tempfile.TemporaryDirectory() as folder:
        cloud = path
        if path.suffix == ".ply":
            cloud = Path(folder) / "read.pcd"
            _run([_program("pcl_ply2pcd"), "-format", "1", str(path), str(cloud)])
        same, out = Path(folder) / "same.pcd", Path(folder) / "plain.pcd"
        _run([_program("pcl_transform_point_cloud"), str(cloud), str(same), "-trans", "0,0,0"])
        _run([_program("pcl_convert_pcd_ascii_binary"), str(same), str(out), "1"])  # it packs by itself
        header, _, body = out.read_bytes().partition(b"DATA binary\n")
        told = {line.split()[0]: line.split()[1:] for line in header.decode("latin-1").splitlines()}
        kinds = [f"<{letter.lower()}{size}" for letter, size in zip(told["TYPE"], told["SIZE"], strict=True)]
        table = np.frombuffer(body, list(zip(told["FIELDS"], kinds, strict=True)), int(told["POINTS"][0]))
    return np.column_stack([table[axis].astype(float) for axis in "xyz"]), told["FIELDS"][3:]


def _program(name: str) -> str:
    found = which(name)
    if found is None:
        raise ImportError(f"no program {name}")
    return found


def _run(words: list[str]) -> None:
    subprocess.run(words, capture_output=True, timeout=120, env={**os.environ, "QT_QPA_PLATFORM": "offscreen"})


READERS: dict[str, tuple[Callable[[Path], Read], tuple[str, ...]]] = {
    "CloudCompare": (cloudcompare, (".ply", ".pcd", ".e57", ".las", ".laz", ".csv")),
    "PCL": (pcl, (".ply", ".pcd")),
    "Open3D io": (open3d_io, (".ply", ".pcd")),
    "Open3D t.io": (open3d_t_io, (".ply", ".pcd")),
    "MeshLab": (meshlab, (".ply",)),
    "trimesh": (trimesh, (".ply",)),
    "pye57": (pye57, (".e57",)),
    "e57 (Rust)": (e57, (".e57",)),
    "laspy": (laspy, (".las", ".laz")),
}


if __name__ == "__main__":
    name, path, out = sys.argv[1:]
    try:
        points, fields = READERS[name][0](Path(path))
    except ImportError as error:
        print(error, file=sys.stderr)
        raise SystemExit(3) from error
    np.savez(out, points=points, fields=np.array(fields, str))
