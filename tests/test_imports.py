"""The arrows of the architecture: who may know whom, and no circles."""

import ast
import graphlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SIMULATOR = {"warp", "warp_scanner"}
PEERS = {"torch", "open3d", "embreex", "py4dgeo", "bcf"}
FORBIDDEN = {"warp_scanner": {"jax", "flax", "optax", "jaxmm", "benchmarks", "paper"} | PEERS}
FORBIDDEN["jaxmm"] = SIMULATOR | {"benchmarks", "paper"} | PEERS
# The only files of jaxmm that know the scanner.
JOINTS = {
    f"jaxmm/{name}.py": SIMULATOR
    for name in """
        pipeline localisation gathering sides sighting cloud_sighting simulator cli priors scan_rays room_scans
        building_sighting hindsight next_view mismatches cli_detect cloud_comparison detection detect_files ifc_update
        raw_scans remaining scan_files scan_las scan_noise building_clouds paper_scenes runs local_engine
        object_training hanging outdoors contradictions building_levels
    """.split()
}


def imports_of(path: Path) -> set[str]:
    """Dotted names imported anywhere in a file; `from a import b` counts as both a and a.b."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: import by the full name"
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names


@pytest.mark.parametrize("package", FORBIDDEN)
def test_arrows_point_one_way(package):
    paths = sorted((ROOT / package).rglob("*.py"))
    assert paths
    for path in paths:
        forbidden = FORBIDDEN[package] - JOINTS.get(path.relative_to(ROOT).as_posix(), set())
        assert forbidden.isdisjoint(name.split(".")[0] for name in imports_of(path)), path


@pytest.mark.parametrize("package", FORBIDDEN)
def test_no_module_imports_in_a_circle(package):
    paths = (path.relative_to(ROOT) for path in (ROOT / package).rglob("*.py"))
    modules = {".".join(path.with_suffix("").parts).removesuffix(".__init__"): ROOT / path for path in paths}
    graph = {name: imports_of(path) & modules.keys() - {name} for name, path in modules.items()}
    order = tuple(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError naming the circle
    assert set(order) == modules.keys()
