"""Triangle meshes with procedural materials: the vocabulary that scenes are built from.

World and object frames are right-handed with z up; lengths in metres.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

PLAIN, BRICK, TILE, PLANK, CHECKER, RIB = range(6)
"""Patterns, see `lcdata.simulation.textures`."""


@dataclass(frozen=True)
class Material:
    """How a surface looks to the camera and to the LiDAR.

    Args:
        color: `"#rrggbb"` (sRGB) of bricks, tiles, planks, ...
        joint: Colour between them; the second colour of a checker.
        pattern: PLAIN, BRICK, TILE, PLANK, CHECKER or RIB.
        size: Width and height of one brick, tile, plank in metres.
        gap: Width of the joints in metres.
        noise: Relative amplitude of the mottling.
        grain: Size of its coarsest blotches in metres.
        near_infrared: Factor from the visible albedo to that at the LiDAR's 865 nm.
        gloss: 0 matt ... 1 mirror-like: loses LiDAR returns away from normal incidence.
        glow: Light of its own, relative to a white surface in full light.
        retro: What a rough surface or glass beads send straight back to a LiDAR at any incidence,
            as reflectivity.
        kind: What a surface is to a semantic mask, such as `lane` or `pole`; "" for nothing.
    """

    color: str
    joint: str = "#303030"
    pattern: int = PLAIN
    size: tuple[float, float] = (1.0, 1.0)
    gap: float = 0.01
    noise: float = 0.1
    grain: float = 0.5
    near_infrared: float = 1.0
    gloss: float = 0.0
    glow: float = 0.0
    retro: float = 0.0
    kind: str = ""


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles of one material.

    Args:
        corners: (T, 3, 3) corners of each triangle, metres.
        frames: (T, 3, 3) origin, u axis and v axis of each triangle's texture.
        material: Their material.
    """

    corners: Array
    frames: Array
    material: Material


Parts = list[Part]


def linear(color: str) -> tuple[float, float, float]:
    """Linear RGB of an sRGB `"#rrggbb"`."""
    r, g, b = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return r**2.2, g**2.2, b**2.2


def part(corners: ArrayLike, material: Material, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Part:
    """Triangles whose texture axes follow from their normals: u level, v up the surface."""
    corners = np.asarray(corners, float).reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    u = np.stack([-normals[:, 1], normals[:, 0], np.zeros(len(normals))], 1)
    level = np.linalg.norm(u, axis=1, keepdims=True)
    u = np.where(level > 0.05, u / np.maximum(level, 1e-12), [1.0, 0.0, 0.0])
    v = np.cross(normals, u)
    frames = np.stack([np.broadcast_to(np.asarray(origin, float), u.shape), u, v], 1)
    return Part(corners, frames, material)


def place(
    parts: Iterable[Part],
    xyz: Sequence[float] = (0.0, 0.0, 0.0),
    yaw: float = 0.0,
    pitch: float = 0.0,
    roll: float = 0.0,
) -> Parts:
    """Parts moved as one body: turned by roll, pitch, yaw (rad), then shifted to xyz (m)."""
    R = rotation(yaw, pitch, roll)
    t = np.asarray(xyz, float)
    moved = []
    for p in parts:
        frames = p.frames @ R.T
        frames[:, 0] += t
        moved.append(Part(p.corners @ R.T + t, frames, p.material))
    return moved


def rotation(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll)."""
    (cz, cy, cx), (sz, sy, sx) = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    return np.array(
        [
            [cz * cy, cz * sy * sx - sz * cx, cz * sy * cx + sz * sx],
            [sz * cy, sz * sy * sx + cz * cx, sz * sy * cx - cz * sx],
            [-sy, cy * sx, cy * cx],
        ]
    )


def quad(a: ArrayLike, b: ArrayLike, c: ArrayLike, d: ArrayLike, material: Material) -> Parts:
    """A flat quadrilateral a b c d."""
    a, b, c, d = (np.asarray(x, float) for x in (a, b, c, d))
    return [part([[a, b, c], [a, c, d]], material)]


def rectangle(x0: float, y0: float, x1: float, y1: float, z: float, material: Material) -> Parts:
    """A level rectangle, seen from above."""
    return quad([x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z], material)


def box(
    size: Sequence[float],
    material: Material,
    centre: Sequence[float] = (0.0, 0.0, 0.0),
    top: Material | None = None,
) -> Parts:
    """An upright box on `centre`, its bottom face's middle; `top` is another material there."""
    sx, sy, sz = size
    x, y, z = centre
    low, high = np.array([x - sx / 2, y - sy / 2, z]), np.array([x + sx / 2, y + sy / 2, z + sz])
    p = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])
    sides = [(0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6), (1, 0, 2, 3)]
    corners = [p[[f[0], f[1], f[2]]] for f in sides] + [p[[f[0], f[2], f[3]]] for f in sides]
    lid = [p[[4, 5, 7]], p[[4, 7, 6]]]
    if top is None:
        return [part([*corners, *lid], material, centre)]
    return [part(corners, material, centre), part(lid, top, centre)]


def beam(
    start: ArrayLike, end: ArrayLike, width: float, material: Material, height: float = 0.0
) -> Parts:
    """A square-section bar between two points; `height` if its section is not square."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = end - start
    length = float(np.linalg.norm(axis))
    axis = axis / length
    side = np.cross([0.0, 0.0, 1.0], axis) if abs(axis[2]) < 0.99 else np.array([0.0, 1.0, 0.0])
    side = side / np.linalg.norm(side)
    R = np.column_stack([axis, side, np.cross(axis, side)])
    bar = box((length, width, height or width), material, (length / 2, 0, -(height or width) / 2))
    return [
        Part(p.corners @ R.T + start, p.frames @ R.T + [start, 0 * start, 0 * start], material)
        for p in bar
    ]


def prism(polygon: ArrayLike, y0: float, y1: float, material: Material) -> Parts:
    """A convex polygon (n, 2) of x, z, drawn out from y0 to y1."""
    xz = np.asarray(polygon, float)
    near = np.column_stack([xz[:, 0], np.full(len(xz), y0), xz[:, 1]])
    far = near + np.array([0.0, y1 - y0, 0.0])
    corners = []
    for i in range(len(xz)):
        j = (i + 1) % len(xz)
        corners += [[near[i], near[j], far[j]], [near[i], far[j], far[i]]]
    for i in range(1, len(xz) - 1):
        corners += [[near[0], near[i], near[i + 1]], [far[0], far[i + 1], far[i]]]
    return [part(corners, material)]


def cylinder(
    start: ArrayLike,
    end: ArrayLike,
    radius: float,
    material: Material,
    end_radius: float | None = None,
    sides: int = 20,
) -> Parts:
    """A capped cylinder between two points, or a cone's frustum."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.cross(axis, [0.0, 1.0, 0.0] if abs(axis[1]) < 0.9 else [1.0, 0.0, 0.0])
    side = side / np.linalg.norm(side)
    angle = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    ring = np.outer(np.cos(angle), side) + np.outer(np.sin(angle), np.cross(axis, side))
    a, b = start + radius * ring, end + (radius if end_radius is None else end_radius) * ring
    a2, b2 = np.roll(a, -1, 0), np.roll(b, -1, 0)
    s, e = np.broadcast_to(start, a.shape), np.broadcast_to(end, a.shape)
    corners = [[a, a2, b2], [a, b2, b], [s, a2, a], [e, b, b2]]
    return [part(np.concatenate([np.stack(c, 1) for c in corners]), material, start)]


def sphere(
    centre: ArrayLike,
    radii: ArrayLike,
    material: Material,
    rows: int = 10,
    roughness: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Parts:
    """An ellipsoid; `roughness` moves its vertices in and out by that share (a bush, a rock)."""
    columns = 2 * rows
    theta = np.linspace(0, np.pi, rows + 1)[:, None]
    phi = np.linspace(0, 2 * np.pi, columns, endpoint=False)[None]
    unit = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi], -1
    )
    if roughness and rng is not None:
        unit[1:-1] *= 1 + roughness * rng.uniform(-1, 1, (rows - 1, columns, 1))
    p = np.asarray(centre, float) + np.asarray(radii, float) * unit
    a, b = p[:-1], p[1:]
    a2, b2 = np.roll(a, -1, 1), np.roll(b, -1, 1)
    corners = np.concatenate(
        [np.stack([a, b, b2], 2).reshape(-1, 3, 3), np.stack([a, b2, a2], 2).reshape(-1, 3, 3)]
    )
    return [part(corners, material, centre)]


def leaves(
    centre: ArrayLike,
    radii: ArrayLike,
    count: int,
    size: float,
    material: Material,
    rng: np.random.Generator,
) -> Parts:
    """Small random triangles that fill an ellipsoid, denser towards its skin."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    distance = rng.uniform(0.1, 1.0, (count, 1)) ** (1 / 3)
    middle = np.asarray(centre, float) + direction * distance * np.asarray(radii, float)
    edges = rng.normal(scale=size, size=(count, 2, 3))
    return [part(np.stack([middle, middle + edges[:, 0], middle + edges[:, 1]], 1), material)]


def wall(
    width: float,
    height: float,
    material: Material,
    openings: Sequence[tuple[float, float, float, float]] = (),
    depth: float = 0.12,
    pane: Material | None = None,
    frame: Material | None = None,
) -> Parts:
    """A wall in the plane y = 0 from x = 0 to `width`, seen from -y, with recessed openings.

    Args:
        width: Metres along x.
        height: Metres along z.
        material: Of the wall and the reveals.
        openings: x0, z0, x1, z1 of each window or door.
        depth: How far panes lie behind the wall, metres.
        pane: Material in the openings; the wall's own if None.
        frame: Material of a 6 cm frame around and a bar across each pane; none if None.
    """
    xs = sorted({0.0, width, *(o[0] for o in openings), *(o[2] for o in openings)})
    zs = sorted({0.0, height, *(o[1] for o in openings), *(o[3] for o in openings)})
    corners: list[Any] = []
    for x0, x1 in pairwise(xs):
        for z0, z1 in pairwise(zs):
            x, z = (x0 + x1) / 2, (z0 + z1) / 2
            if not any(o[0] < x < o[2] and o[1] < z < o[3] for o in openings):
                a, b, c, d = [x0, 0, z0], [x1, 0, z0], [x1, 0, z1], [x0, 0, z1]
                corners += [[a, b, c], [a, c, d]]
    parts = [part(corners, material)]
    for x0, z0, x1, z1 in openings:
        front = np.array([[x0, 0, z0], [x1, 0, z0], [x1, 0, z1], [x0, 0, z1]])
        back = front + np.array([0, depth, 0])
        for i in range(4):
            j = (i + 1) % 4
            parts += quad(front[i], front[j], back[j], back[i], material)
        parts += quad(back[0], back[1], back[2], back[3], pane or material)
        if frame is not None:
            y, w = depth - 0.02, 0.06
            for x in (x0 + w / 2, (x0 + x1) / 2, x1 - w / 2):
                parts += box((w, 0.04, z1 - z0), frame, (x, y, z0))
            for z in (z0, z1 - w):
                parts += box((x1 - x0, 0.04, w), frame, ((x0 + x1) / 2, y, z))
    return parts
