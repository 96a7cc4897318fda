"""What a scan is compared with: a building of elements, or the points of an earlier scan.

M points, E elements. Positions are float64 in the world, and float32 offsets from the prior's origin; metres, z up.
"""

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from jaxmm.classes.telling_rays import Known
from jaxmm.files import sha256_of
from jaxmm.formats.cloud_frames import brought_upright, check_frame, is_before, without_pose
from jaxmm.formats.raw_scans import BLOCK
from jaxmm.formats.readers import READERS, PointScan, read_scans
from jaxmm.formats.units import Distance, thinned
from jaxmm.inputs import InputError
from jaxmm.learning.upright_shapes import is_round, rectangle_along
from jaxmm.objects.main_directions import QUARTER, uprights_of
from jaxmm.objects.usual_sizes import OwnElements
from jaxmm.objects.walls import KnownBuilding
from jaxmm.rays.range_noise import Settled, settled
from jaxmm.rays.scan_rays import PosedScan, drawn, overtaken
from jaxmm.verdicts.results import PriorFile
from warp_scanner.buildings.changes import Change, of_elements
from warp_scanner.buildings.files import read_building
from warp_scanner.buildings.ifc_zips import is_ifc
from warp_scanner.buildings.mesh_files import SUFFIXES
from warp_scanner.buildings.model_files import KNOWN, Model, has_surface
from warp_scanner.buildings.projects import read_model
from warp_scanner.clouds.voxels import thin_clouds
from warp_scanner.scenes.building import AS_IT_IS, Building, ReadOptions, element_bounds
from warp_scanner.scenes.remarks import remarks
from warp_scanner.scenes.scenes import PILLAR, WALL
from warp_scanner.sensors.scan import Rays
from warp_scanner.sensors.triangles import TriangleScene, cast_triangles, clearance, prepare

VOXEL = 0.1  # [m] to which a cloud is thinned
BESIDE = 0.02  # [m] beside a wall, to look from
SHORT, SLENDER = 1.6, 2.0  # [m], times its thickness: a wall no longer, and no shorter, may pass for a pillar
FACADE, PROXY = ("IfcCurtainWall", "IfcPlate", "IfcMember"), "IfcBuildingElementProxy"
LEAST_SHAFT = 0.05  # [m] of a column; less is a bolt between two parts of it
UPRIGHT = 2.0  # [m] height from which a proxy may be a wall or a column
MOST_BEHIND = 0.1  # share of its points behind others, beyond which a scan was not taken from where its file says
DEEP = 0.2  # times as deep as far away is what a camera sees; a plan high above zero is not, and lies before z, too
MOST_ASKED = 1_000_000  # points of a cloud, of which the middle is that of all
Y_UP = (".glb", ".gltf")  # by their standard
NEAR_ORIGIN = 500.0  # [m] up to which float32 holds the file's own coordinates


class Prior(NamedTuple):
    """A building model as surfaces with elements, or as a cloud without; one of the two."""

    origin: np.ndarray  # (3,) float64 [m] world position that all offsets count from
    notes: tuple[str, ...]  # how it was read, a line each
    building: Building | None = None
    scene: TriangleScene | None = None
    cloud: np.ndarray | None = None  # (M, 3) float32 [m] offsets, one a voxel
    stray: np.ndarray | None = None  # (M,) bool: of these, points that hang between surfaces; None: nobody knows
    known: KnownBuilding = KnownBuilding()  # of its walls and columns, the most frequent first; a cloud knows none
    file: PriorFile | None = None  # None where it came as arrays
    # Position (3,) and rotation (3, 3) [m], of a cloud whose file says a pose, and not whether its points are in the
    # sensor's frame.
    untold: tuple[np.ndarray, np.ndarray] | None = None
    frameless: bool = False  # a cloud of which neither the user nor its file tells the frame
    optical: bool = False  # then: it may be in that of optics, z forward
    # (E,) bool: in its place something else stands, and lower, as scans show: what ends there is no support.
    vacant: np.ndarray | None = None

    @property
    def has_elements(self) -> bool:
        """Whether it is a building."""
        return self.scene is not None


def read_prior(path: Path | str | Model, options: ReadOptions = AS_IT_IS) -> Prior:
    """The prior in a file: IFC, a mesh, or a point cloud, by the ending; a PLY file without faces is a cloud.

    Args:
        path: its file, or the files of a model.
        options: how to read it; of a cloud, its unit, which axis is up, and the frame that its points are in.

    Raises:
        InputError: one line that names the file and what is wrong with it.
    """
    if isinstance(path, Model) and len(path.files) > 1:
        return _prior_of_model(path, options)
    path = path.files[0].path if isinstance(path, Model) else Path(path)
    if not path.is_file():
        raise InputError(f"{path}: expected a prior, found {'a folder' if path.is_dir() else 'nothing there'}")
    kind = kind_of(path)
    if kind != "cloud":
        try:
            building = read_building(path, options)
        except (ValueError, ImportError) as error:
            raise InputError(str(error)) from error
        file = PriorFile(path.name, kind, building.unit, building.project, sha256_of(path))
        return prior_of_building(building)._replace(file=file)
    read = read_scans(path)
    check_frame(path, read, options.frame)
    scans = [brought_upright(scan, options.frame, bool(options.y_up)) for scan in read]
    notes = tuple(f"{path.name}: {note}" for scan in scans for note in scan.remarks)
    notes += without_pose(path, read, options.frame)
    points = scans[0].points if len(scans) == 1 else np.concatenate([scan.points for scan in scans])
    prior = prior_of_cloud(points if options.unit == 1.0 else points * options.unit, notes)
    stray = _stray(prior, scans, options.unit)
    (first, *others), untold, optical = scans, None, False
    frameless = not others and options.frame is None and first.frame is None and not first.in_world
    if frameless:
        if first.position is not None:
            untold = first.position * options.unit, first.rotation
        elif options.y_up is None:
            optical = _may_be_optical(first.points, options.unit)
    file = PriorFile(path.name, kind, options.unit, None, sha256_of(path))
    return prior._replace(stray=stray, file=file, untold=untold, frameless=frameless, optical=optical)


def _may_be_optical(points: np.ndarray, unit: float) -> bool:
    """Whether points (N, 3), in a unit [m], lie before the z axis as what a camera at zero sees.

    That is near and far, and little of it hidden behind the rest.
    """
    thin = thinned(points)
    before_x, before_z = is_before(thin)
    if before_x or not before_z:
        return False
    low, middle, high = np.percentile(thin[:, 2], [2, 50, 98])
    return bool(high - low > DEEP * middle and overtaken(drawn(points, np.zeros(3)) * unit, np.zeros(3)) <= MOST_BEHIND)


def _prior_of_model(model: Model, options: ReadOptions) -> Prior:
    """The building that several files describe together."""
    try:
        building = read_model(model, options)
    except (ValueError, ImportError) as error:
        raise InputError(str(error)) from error
    kind = "ifc" if model.has_ifc else "mesh"
    file = PriorFile(model.name, kind, building.unit, building.project, digest_of(model), building.sources)
    return prior_of_building(building)._replace(file=file)


def digest_of(model: Model) -> str:
    """The SHA-256 of the file, or of the names and digests of all, in hexadecimal: equal files give the same."""
    if len(model.files) == 1:
        return sha256_of(model.files[0].path)
    told = sorted(f"{file.name} {sha256_of(file.path)}\n" for file in model.files)
    return hashlib.sha256("".join(told).encode()).hexdigest()


def _stray(prior: Prior, scans: list[PointScan], unit: float) -> np.ndarray:
    """(M,) bool: points of a cloud that hang between surfaces, or trail behind edges, as its scans tell one by one.

    Only those are asked whose points lie in the frame of their sensor: what else a file says of a place need not hold
    for all of its points.
    """
    hang, stand = [], []
    for scan in scans:
        place = np.zeros(3) if scan.position is None else scan.position
        offsets = (drawn(scan.points, place) - place) * unit
        one = PosedScan(offsets.astype(np.float32), np.zeros(3), np.eye(3) if scan.rotation is None else scan.rotation)
        found = Settled(one, 0.0, 0.0)
        if scan.in_world and overtaken(one.points, one.position) <= MOST_BEHIND:
            found = settled(one)
        for points, where in ((found.left_out, hang), (found.scan.points, stand)):
            where.append(points + (place * unit - prior.origin))
    hang, stand = np.concatenate(hang), np.concatenate(stand)
    stray = np.zeros(len(prior.cloud), bool)
    if len(hang):
        stray = cKDTree(hang).query(prior.cloud, distance_upper_bound=VOXEL)[0] <= VOXEL
        stray[stray] = cKDTree(stand).query(prior.cloud[stray])[0] > VOXEL
    return stray


def without_stray(prior: Prior) -> Prior:
    """A cloud without what hangs in it, and a note of that; any other prior as it is.

    The trail of mixed ranges behind a column, of which no other scan sees anything, would be a wall that is gone.
    """
    if prior.stray is None or not prior.stray.any():
        return prior
    note = f"{prior.stray.mean():.1%} of the prior's points, between surfaces or behind edges, were left out"
    return prior._replace(cloud=prior.cloud[~prior.stray], stray=None, notes=(*prior.notes, note))


def kind_of(path: Path) -> str:
    """What a file is read as, by its ending: "ifc", "mesh" or "cloud"; a PLY file without faces is a cloud.

    Raises:
        InputError: an ending that no reader knows.
    """
    suffix = path.suffix.lower()
    if is_ifc(path):
        return "ifc"
    if suffix in SUFFIXES and has_surface(path):
        return "mesh"
    if suffix not in READERS:
        known = ", ".join(sorted({*KNOWN, *READERS}))
        raise InputError(f"{path}: expected a prior ending in one of {known}, got {suffix or 'no ending'}")
    return "cloud"


def prior_of_building(building: Building) -> Prior:
    """A building that was read, ready for rays."""
    scene = prepare(building.triangles)
    return Prior(building.origin, tuple(remarks(building)), building, scene, known=_known(building, scene))


def unasked(building: Building, asked: np.ndarray) -> list[str]:
    """That nobody tells of curtain walls, or of what may be a wall or a column by another name, where there is any.

    Args:
        building: the model.
        asked: (E,) bool, elements that get a verdict.
    """
    classes = np.asarray(building.elements.ifc_class, str)
    low, high = element_bounds(building.triangles)
    upright = ~asked & (classes == PROXY) & (high[:, 2] - low[:, 2] >= UPRIGHT)
    found = {
        f"of the classes {', '.join(FACADE)}": int((~asked & np.isin(classes, FACADE)).sum()),
        f"of the class {PROXY} and {UPRIGHT:g} m high or higher": int(upright.sum()),
    }
    return [
        f"note: 1 element is {what}: rays meet it, but it gets no verdict"
        if count == 1
        else f"note: {count} elements are {what}: rays meet them, but they get no verdict"
        for what, count in found.items()
        if count
    ]


def known_of(prior: Prior) -> Known:
    """What is known of the elements of a building, for `telling_rays`."""
    building, scene = prior.building, prior.scene
    if len(scene.triangles.faces) != len(building.triangles.faces):
        scene = prepare(building.triangles)  # of which the prior's lacks some
    facades = {(one.file, guid) for one in building.wholes if one.ifc_class == FACADE[0] for guid in one.parts}
    table = building.elements
    in_facade = np.array([key in facades for key in zip(table.file, table.guid, strict=True)], bool)
    return Known(scene, building.elements.ifc_class, building.clear, in_facade)


def prior_of_cloud(points: np.ndarray, notes: tuple[str, ...] = ()) -> Prior:
    """Points (M, 3) float64 [m] as a prior; ValueError without any."""
    if not len(points):
        raise ValueError("expected the points of a prior, got none")
    far = max(points.max(), -points.min()) > NEAR_ORIGIN
    origin = np.rint(np.median(points[:: max(1, len(points) // MOST_ASKED)], axis=0)) if far else np.zeros(3)
    offsets = np.zeros(points.shape, np.float32)
    for start in range(0, len(points), BLOCK):  # in doubles they would be three times as large
        offsets[start : start + BLOCK] = points[start : start + BLOCK] - origin
    return Prior(origin, notes, cloud=offsets[thin_clouds([offsets], VOXEL)[0]])


def distance_from(prior: Prior) -> Distance:
    """To the prior's surface or points, from points (N, 3) [m] of the world; inf where nothing is within reach."""
    if prior.scene is None:
        tree = cKDTree(prior.cloud)
        return lambda points, reach: tree.query(points - prior.origin, distance_upper_bound=reach)[0]

    def to_surface(points: np.ndarray, reach: float) -> np.ndarray:
        found = clearance(prior.scene, points - prior.origin, reach)
        return np.where(found < np.float32(reach), found, np.inf)

    return to_surface


def _known(building: Building, scene: TriangleScene) -> KnownBuilding:
    """Thicknesses of the walls, sections of the columns, and what stands upright."""
    semantic = building.elements.semantic
    walls, columns = (of_elements(building, np.flatnonzero(semantic == kind)) for kind in (WALL, PILLAR))
    thickness = np.round([min(one.size[:2]) for one in walls], 3)
    rounded = [is_round(one.triangles.vertices) for one in columns]
    shafts = [shaft_size(one) for one in columns]
    sections = np.array([(*sorted(shaft), circle) for shaft, circle in zip(shafts, rounded, strict=True)])
    known = [(a, b, bool(circle)) for a, b, circle in _frequent(sections.reshape(-1, 3))]
    is_wall = (thickness > 0.03) & (thickness < 0.6)
    length = np.round([max(one.size[:2]) for one in walls], 3)
    kinds = (is_wall, is_wall & _are_inner(walls, scene))  # outer ones are thicker, and what is new stands inside
    usual = min((_usual(thickness[kind], length[kind]) for kind in kinds if kind.any()), default=0.0)
    is_short = is_wall & (length <= SHORT) & (length >= SLENDER * thickness)
    short = np.column_stack([thickness, length])[is_short]
    uprights = uprights_of(building.triangles.vertices, building.triangles.faces, building.triangles.element)
    return KnownBuilding(
        tuple(_frequent(thickness[is_wall])), usual, tuple(known),
        tuple(map(tuple, _frequent(short))), uprights, _own(walls, columns, rounded, shafts),
    )  # fmt: skip


def _are_inner(walls: list[Change], scene: TriangleScene) -> np.ndarray:
    """(n,) bool: walls from the middle of each of whose sides one looks, level and straight ahead, at something."""
    angle = np.radians([one.yaw + (90.0 if one.size[0] > one.size[1] else 0.0) for one in walls])
    across = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(walls))])
    center = np.array([one.center for one in walls]).reshape(-1, 3)
    off = across * np.array([min(one.size[:2]) / 2 + BESIDE for one in walls])[:, None]
    ways = [Rays(center + way * off, (way * across).astype(np.float32)[:, None]) for way in (-1.0, 1.0)]
    return np.all([np.isfinite(cast_triangles(scene, rays).distance[:, 0]) for rays in ways], axis=0)


def shaft_size(column: Change) -> np.ndarray:
    """Edges (2,) [m] along and across a column, halfway up: a capital or a base may be wider than its shaft."""
    corners = column.triangles.vertices[column.triangles.faces].astype(np.float64) - column.center
    start, end = (corners[:, order].reshape(-1, 3) for order in ([0, 1, 2], [1, 2, 0]))
    crosses = (start[:, 2] < 0.0) != (end[:, 2] < 0.0)
    start, end = start[crosses], end[crosses]
    if not len(start):
        return column.size[:2]
    cut = start + (end - start) * (start[:, 2] / (start[:, 2] - end[:, 2]))[:, None]
    yaw = np.radians(column.yaw)
    _, size = rectangle_along(cut[:, :2], np.array([np.cos(yaw), np.sin(yaw)]))
    return size if size.min() >= LEAST_SHAFT else column.size[:2]


def _own(walls: list[Change], columns: list[Change], rounded: list[bool], shafts: list[np.ndarray]) -> OwnElements:
    each, sizes = [*walls, *columns], [*(one.size[:2] for one in walls), *shafts]
    return OwnElements(
        np.arange(len(each)) < len(walls), np.array([False] * len(walls) + rounded, bool),
        np.array([one.center[:2] for one in each]).reshape(-1, 2),
        np.radians([one.yaw for one in each]) % QUARTER, np.array([max(one) for one in sizes]),
    )  # fmt: skip


def _usual(thickness: np.ndarray, length: np.ndarray) -> float:
    """The median thickness [m] of walls (n,), each counted by its length: long ones are met more often."""
    order = np.argsort(thickness)
    reached = np.cumsum(length[order])
    return round(float(thickness[order][np.searchsorted(reached, reached[-1] / 2)]), 3)


def _frequent(values: np.ndarray) -> list:
    """Sizes (n,) or (n, k) [m], the most frequent first: of those that round to the same centimetre the usual one."""
    if not len(values):
        return []
    values = np.round(values, 3)
    _, kind, count = np.unique(np.round(values, 2), axis=0, return_inverse=True, return_counts=True)
    found = []
    for one in np.argsort(-count, kind="stable"):
        exact, often = np.unique(values[kind.ravel() == one], axis=0, return_counts=True)
        found.append(exact[np.argmax(often)].tolist())
    return found
