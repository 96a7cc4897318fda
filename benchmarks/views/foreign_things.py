"""Things that no generator of ours draws, as meshes: boxes of any size, people, racks, turned things and plants.

Held out: nothing that is trained or tuned ever sees them, so that a benchmark tells what probabilities are worth on
foreign ground. V vertices, T triangles. Each stands on z = 0 around the origin; metres, z up.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from warp_scanner.scenes.building import Triangles
from warp_scanner.scenes.scenes import TABLE

AROUND = 20  # corners of what is round
GAP = 0.02  # [m] between a thing and the ceiling


class Thing(NamedTuple):
    """One thing."""

    kind: str  # key of KINDS
    vertices: np.ndarray  # (V, 3) float64 [m]
    faces: np.ndarray  # (T, 3) int64


def thing_of(rng: np.random.Generator, ceiling: float) -> Thing:
    """A thing of any kind that fits below a ceiling [m]."""
    kind = str(rng.choice(list(KINDS)))
    vertices, faces = KINDS[kind](rng, ceiling - GAP)
    return Thing(kind, vertices, faces)


def standing(thing: Thing, place: np.ndarray, yaw: float) -> Thing:
    """The thing turned by an angle [rad], and standing at a place (2,) [m] on the floor z = 0."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
    return thing._replace(vertices=thing.vertices @ turn.T + np.array([*place, 0.0]))


def with_things(triangles: Triangles, things: list[Thing]) -> Triangles:
    """The surfaces of a building with those of things, each an element of its own behind the building's."""
    count, first = len(triangles.semantic), len(triangles.vertices)
    vertices, faces, element = [triangles.vertices], [triangles.faces], [triangles.element]
    for number, thing in enumerate(things):
        vertices.append(thing.vertices.astype(np.float32))
        faces.append((thing.faces + first).astype(np.int32))
        element.append(np.full(len(thing.faces), count + number, np.int32))
        first += len(thing.vertices)
    semantic = np.concatenate([triangles.semantic, np.full(len(things), TABLE, np.uint8)])
    return Triangles(np.concatenate(vertices), np.concatenate(faces), np.concatenate(element), semantic)


def _box(rng: np.random.Generator, most: float) -> tuple[np.ndarray, np.ndarray]:
    """From a stool to a wardrobe up to the ceiling."""
    size = np.exp(rng.uniform(np.log((0.2, 0.2, 0.3)), np.log((2.2, 0.9, most))))
    return _block(np.array([0.0, 0.0, size[2] / 2]), size)


def _tall(rng: np.random.Generator, most: float) -> tuple[np.ndarray, np.ndarray]:
    """A cupboard as high as a door or higher, as wide as a pillar or a piece of a wall."""
    size = rng.uniform((0.3, 0.25, 1.8), (1.4, 0.7, most))
    return _block(np.array([0.0, 0.0, size[2] / 2]), size)


def _person(rng: np.random.Generator, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Two capsules for legs, one for the body, two for arms, a ball for the head."""
    height, broad = min(rng.uniform(1.5, 1.95), most), rng.uniform(0.14, 0.2)
    hip, neck, head = 0.48 * height, 0.84 * height, 0.07 * height
    stride, reach = rng.uniform(0.0, 0.25), rng.uniform(0.0, 0.4)
    parts = [_capsule(np.array([way * stride, way * 0.1, 0.0]), hip + 0.1, 0.08) for way in (-1.0, 1.0)]
    parts.append(_capsule(np.array([0.0, 0.0, hip - 0.1]), neck - hip + 0.1, broad))
    parts += [
        _capsule(np.array([reach * (way > 0), way * (broad + 0.05), hip]), neck - hip - 0.05, 0.05)
        for way in (-1.0, 1.0)
    ]
    parts.append(_capsule(np.array([0.0, 0.0, height - 2 * head]), 2 * head, head))
    return _joined(parts)


def _rack(rng: np.random.Generator, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Four posts and some boards, with boxes on them."""
    width, depth, height = rng.uniform((0.5, 0.25, 0.9), (1.8, 0.5, min(2.6, most)))
    post, levels = 0.04, np.linspace(0.1, height - 0.02, int(rng.integers(3, 7)))
    middle = np.array([width, depth]) / 2 - post / 2
    parts = [
        _block(np.array([x * middle[0], y * middle[1], height / 2]), np.array([post, post, height]))
        for x in (-1.0, 1.0)
        for y in (-1.0, 1.0)
    ]
    parts += [_block(np.array([0.0, 0.0, z]), np.array([width, depth, 0.025])) for z in levels]
    for low, high in itertools.pairwise(levels):
        if rng.random() < 0.6:
            size = np.array([*rng.uniform(0.3, 0.9, 2) * (width, depth), rng.uniform(0.3, 0.9) * (high - low)])
            parts.append(_block(np.array([0.0, 0.0, low + size[2] / 2]), size))
    return _joined(parts)


def _turned(rng: np.random.Generator, most: float) -> tuple[np.ndarray, np.ndarray]:
    """A barrel, a lamp, a vase: any outline, turned around its axis."""
    height = rng.uniform(0.4, min(2.3, most))
    return _lathe(np.linspace(0.0, height, 7), rng.uniform(0.04, 0.4) * rng.uniform(0.3, 1.0, 7))


def _plant(rng: np.random.Generator, most: float) -> tuple[np.ndarray, np.ndarray]:
    """A pot, a stem, and a crown with bumps."""
    pot, height, crown = rng.uniform(0.12, 0.25), rng.uniform(0.8, min(2.2, most)), rng.uniform(0.2, 0.5)
    levels = np.linspace(0.3 * height, height, 9)
    outline = crown * np.sqrt(np.clip(1.0 - np.linspace(-0.98, 0.98, 9) ** 2, 0.0, 1.0))
    leaves = _lathe(levels, outline)
    bumps = 1.0 + 0.25 * rng.standard_normal(len(leaves[0]))
    leaves[0][:, :2] *= np.clip(bumps, 0.5, 1.5)[:, None]
    return _joined([_lathe(np.array([0.0, 0.3]), np.array([0.8 * pot, pot])), leaves])


KINDS: dict[str, Callable[[np.random.Generator, float], tuple[np.ndarray, np.ndarray]]] = {
    "box": _box, "tall box": _tall, "person": _person, "rack": _rack, "turned": _turned, "plant": _plant,
}  # fmt: skip


def _block(center: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corner = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return center + corner * size, np.array(faces)


def _capsule(foot: np.ndarray, height: float, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """An upright cylinder with round ends; `foot` (3,) is its lowest point, `height` that of the whole."""
    turn = np.linspace(0.0, np.pi / 2, 5)
    low, round_ = radius * (1.0 - np.cos(turn)), radius * np.sin(turn)
    levels = np.concatenate([low, height - low[::-1]])
    vertices, faces = _lathe(levels, np.concatenate([round_, round_[::-1]]))
    return vertices + foot, faces


def _lathe(levels: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An outline turned around the z axis, closed at both ends."""
    angle, rings = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False), len(levels)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    sides = np.column_stack([(radius[:, None, None] * ring).reshape(-1, 2), np.repeat(levels, AROUND)])
    ends = np.array([[0.0, 0.0, levels[0]], [0.0, 0.0, levels[-1]]])
    here, low, top = np.arange(AROUND), rings * AROUND, rings * AROUND + 1
    beside, faces = np.roll(here, -1), []
    for first in range(0, (rings - 1) * AROUND, AROUND):
        above = first + AROUND
        faces += [np.column_stack([first + here, first + beside, above + beside])]
        faces += [np.column_stack([first + here, above + beside, above + here])]
    faces += [np.column_stack([beside, here, np.full(AROUND, low)])]
    last = (rings - 1) * AROUND
    faces += [np.column_stack([last + here, last + beside, np.full(AROUND, top)])]
    return np.concatenate([sides, ends]), np.concatenate(faces)


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    first = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return (
        np.concatenate([vertices for vertices, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, first, strict=False)]),
    )
