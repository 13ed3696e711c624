"""Where planes of a scan end in front of something farther away, or of the sky, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcdata.features.compiled import compiled

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Labels = NDArray[np.int32]

FLAT_COSINE = 0.5
"""On a surface seen flatter than this, the outside must be farther across the surface too."""
LOOK_PIXELS = 3
"""Missing returns in a row that are sky and not dropouts."""
GRAZING_COSINE = 0.15
"""Where nothing came back beyond a surface seen flatter than this, its edge is the reach."""
LOWEST_SKY = np.radians(-2.0)
"""No return below the horizon is a dark or wet surface, not the open sky."""


@compiled
def edge_points(
    points: Floats,
    labels: Labels,
    inverse: Array,
    live_rings: NDArray[np.bool_],
    live_columns: NDArray[np.bool_],
    wide: NDArray[np.bool_],
    elevation: Array,
    column_step: float,
    turn: bool,
    farther: float,
) -> tuple[Labels, Array, Array]:
    """Rays half a beam outside each plane's last pixels, where the outside is farther.

    Returns:
        (K,) labels, (K, 3) unit rays, (K, 3) half the way from the inner beam to the outer one.
    """
    rings, columns = labels.shape
    owners = np.empty(rings * columns, np.int32)
    rays = np.empty((rings * columns, 3))
    halves = np.empty((rings * columns, 3))
    count = 0
    for i in range(rings):
        for j in range(columns):
            label = labels[i, j]
            if label < 0:
                continue
            for direction in range(4):
                di = 0 if direction < 2 else 5 - 2 * direction
                dj = 1 - 2 * direction if direction < 2 else 0
                if (
                    0 <= i + di < rings
                    and 0 <= j + dj < columns
                    and labels[i + di, j + dj] == label
                ):
                    continue
                ni, nj, seen = look(points, live_rings, live_columns, wide, turn, i, j, di, dj)
                if ni < 0 or labels[ni, nj] == label or count == len(owners):
                    continue
                a, p = inverse[label], points[i, j]
                rp = np.sqrt(np.float64(p[0]) * p[0] + p[1] * p[1] + p[2] * p[2])
                u0, u1, u2 = p[0] / rp, p[1] / rp, p[2] / rp
                norm = np.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
                cosine = (a[0] * u0 + a[1] * u1 + a[2] * u2) / norm
                if seen:
                    q = points[ni, nj]
                    rq = np.sqrt(np.float64(q[0]) * q[0] + q[1] * q[1] + q[2] * q[2])
                    w0, w1, w2 = q[0] / rq, q[1] / rq, q[2] / rq
                    facing = a[0] * w0 + a[1] * w1 + a[2] * w2
                    if facing <= 0.0 or rq < max(1.0 / facing, rp) + farther:
                        continue
                    # A surface seen flatly that only bends away is off its plane along the ray
                    # long before it is across.
                    if cosine < FLAT_COSINE and rq * facing - 1.0 < farther * norm:
                        continue
                    # A ring with a bias of its own, not an edge: the plane goes on behind it.
                    if di != 0 and resumes(labels, label, ni, nj, di):
                        continue
                else:
                    if cosine < GRAZING_COSINE or elevation[ni] < LOWEST_SKY:
                        continue
                    azimuth = np.arctan2(u1, u0) + dj * column_step
                    height = np.arctan2(u2, np.sqrt(u0 * u0 + u1 * u1))
                    height += elevation[ni] - elevation[i]
                    w0, w1 = np.cos(height) * np.cos(azimuth), np.cos(height) * np.sin(azimuth)
                    w2 = np.sin(height)
                m0, m1, m2 = 0.5 * (u0 + w0), 0.5 * (u1 + w1), 0.5 * (u2 + w2)
                norm = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
                owners[count] = label
                rays[count, 0], rays[count, 1], rays[count, 2] = m0 / norm, m1 / norm, m2 / norm
                halves[count, 0] = 0.5 * (w0 - u0)
                halves[count, 1] = 0.5 * (w1 - u1)
                halves[count, 2] = 0.5 * (w2 - u2)
                count += 1
    return owners[:count].copy(), rays[:count].copy(), halves[:count].copy()


@compiled
def resumes(labels: Labels, label: int, i: int, j: int, di: int) -> bool:
    """Whether a label comes back within the next pixels of a column."""
    for _ in range(LOOK_PIXELS):
        i += di
        if i < 0 or i >= len(labels):
            return False
        if labels[i, j] == label:
            return True
    return False


@compiled
def look(
    points: Floats,
    live_rings: NDArray[np.bool_],
    live_columns: NDArray[np.bool_],
    wide: NDArray[np.bool_],
    turn: bool,
    i: int,
    j: int,
    di: int,
    dj: int,
) -> tuple[int, int, bool]:
    """The next pixel in a direction and whether it has a return.

    The border of the scan, a crop or a dead ring, and a dropout (beyond which the edge could
    be anywhere) give -1.
    """
    rings, columns = points.shape[:2]
    ni, nj = i, j
    for step in range(LOOK_PIXELS):
        ni, nj = ni + di, nj + dj
        if di != 0 and 0 <= ni < rings and wide[min(ni, ni - di)]:
            return -1, -1, False
        if turn:
            nj = nj - columns if nj >= columns else (nj + columns if nj < 0 else nj)
        if ni < 0 or ni >= rings or nj < 0 or nj >= columns:
            return -1, -1, False
        if not (live_rings[ni] and live_columns[nj]):
            return -1, -1, False
        if points[ni, nj, 0] != 0.0 or points[ni, nj, 1] != 0.0 or points[ni, nj, 2] != 0.0:
            if step > 0:
                return -1, -1, False
            return ni, nj, True
    return ni - (LOOK_PIXELS - 1) * di, nj, False
