"""The formulas of the camera models: pixel and its derivative by the point.

Plain arithmetic without branches, so that one text serves whole arrays in NumPy and, compiled by
`camera_kernels`, single points in loops. Each takes the camera's `parameters` and the point
(x right, y down, z forward, metres) and returns u, v (pixels) and the six derivatives du/dx,
du/dy, du/dz, dv/dx, dv/dy, dv/dz (pixels a metre); which points it is true of, `can_project` says.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]
Value: TypeAlias = Any
"""A float, or an array of them."""
Projected: TypeAlias = tuple[Value, Value, Value, Value, Value, Value, Value, Value]

PINHOLE, BROWN, TILTED, FISHEYE, ATAN, OMNI, EQUIRECTANGULAR = range(7)
"""Ids of the models; a pinhole's is that of the least it needs."""

FOCAL, XI, LENS, LIMIT, TILT, COUNT = 0, 4, 5, 17, 18, 27
"""Where the parameters lie: fx fy cx cy (or width, height); xi (or 2 tan(w / 2) of `atan`); 12
coefficients of the lens in OpenCV's order; how far from the axis its polynomial is monotonous
(the cosine of the angle for `fisheye`); the 3x3 tilt."""

NEAR = 1e-6
"""Points of a pinhole lie at least this far in front of it, metres."""
_TINY = 1e-24
"""Keeps the axis, where x = y = 0, from dividing by zero; far below the last digit elsewhere."""


def model_id(camera: Camera) -> int:
    """Which formula projects a camera's points."""
    if camera.model == "fisheye":
        return FISHEYE
    if camera.model == "omni":
        return OMNI
    if camera.model == "equirectangular":
        return EQUIRECTANGULAR
    if camera.model == "atan" and any(camera.distortion):
        return ATAN
    if any(camera.distortion[12:]):
        return TILTED
    return BROWN if any(camera.distortion) else PINHOLE


def parameters(camera: Camera) -> Array:
    """(COUNT,) numbers that the formulas and the compiled kernels take."""
    result = np.zeros(COUNT)
    focal = camera.intrinsics
    if camera.model == "omni":
        result[XI], focal = focal[0], focal[1:]
    result[FOCAL : len(focal)] = focal
    lens = camera.distortion[:12]
    result[LENS : LENS + len(lens)] = lens
    if camera.model == "atan":
        result[XI] = 2.0 * np.tan(0.5 * result[LENS])
    limit = camera.distortion_limit
    result[LIMIT] = np.cos(min(limit, np.pi)) if camera.model == "fisheye" else limit
    result[TILT:] = _tilt(*(camera.distortion[12:] or (0.0, 0.0))).ravel()
    return result


def _tilt(about_x: float, about_y: float) -> Array:
    """The homography of a tilted sensor, angles in radians (OpenCV's `tauX` and `tauY`)."""
    cx, sx, cy, sy = np.cos(about_x), np.sin(about_x), np.cos(about_y), np.sin(about_y)
    R = np.array([[cy, 0, -sy], [0, 1, 0], [sy, 0, cy]]) @ [[1, 0, 0], [0, cx, sx], [0, -sx, cx]]
    onto = np.array([[R[2, 2], 0, -R[0, 2]], [0, R[2, 2], -R[1, 2]], [0, 0, 1]])
    return np.asarray(onto @ R)


def can_project(model: int, p: Array, x: Value, y: Value, z: Value) -> Value:
    """Whether the camera sees in a point's direction, inside its image or beside it.

    In front, for a pinhole and `atan`; up to where the picture would fold back for the others
    and for distorted ones.
    """
    if model in (PINHOLE, ATAN):
        return (z > NEAR) & (np.abs(x + y) < np.inf)
    square = x * x + y * y
    limit = p[LIMIT]
    distance = np.sqrt(square + z * z)
    if model == FISHEYE:
        return z > limit * distance  # their cosines
    if model == EQUIRECTANGULAR:
        return distance > NEAR
    if model == OMNI:
        xi = p[XI]
        depth = z + xi * distance
        lowest = -distance / xi if xi > 1.0 else -xi * distance
        return (z > lowest + NEAR * distance) & (square <= limit * limit * depth * depth)
    return (z > NEAR) & (square <= limit * limit * z * z)


def pinhole(p: Array, x: Value, y: Value, z: Value) -> Projected:
    """The ideal camera: u = fx x / z + cx, v = fy y / z + cy."""
    i = 1.0 / z
    fx, fy = p[0] * i, p[1] * i
    a, b = fx * x, fy * y
    zero = 0.0 * i
    return a + p[2], b + p[3], fx, zero, -a * i, zero, fy, -b * i


def brown(p: Array, x: Value, y: Value, z: Value) -> Projected:
    """A pinhole with radial, tangential and thin-prism distortion, as OpenCV has it."""
    i = 1.0 / z
    a, b = x * i, y * i
    u, v, ua, ub, va, vb = distort(p, a, b)
    fx, fy = p[0] * i, p[1] * i
    return (
        p[0] * u + p[2],
        p[1] * v + p[3],
        fx * ua,
        fx * ub,
        -fx * (ua * a + ub * b),
        fy * va,
        fy * vb,
        -fy * (va * a + vb * b),
    )


def tilted(p: Array, x: Value, y: Value, z: Value) -> Projected:
    """`brown` on a tilted sensor."""
    i = 1.0 / z
    a, b = x * i, y * i
    u, v, ua, ub, va, vb = distort(p, a, b)
    h = TILT
    w = 1.0 / (p[h + 6] * u + p[h + 7] * v + p[h + 8])
    s = (p[h] * u + p[h + 1] * v + p[h + 2]) * w
    t = (p[h + 3] * u + p[h + 4] * v + p[h + 5]) * w
    su, sv = (p[h] - s * p[h + 6]) * w, (p[h + 1] - s * p[h + 7]) * w
    tu, tv = (p[h + 3] - t * p[h + 6]) * w, (p[h + 4] - t * p[h + 7]) * w
    sa, sb, ta, tb = su * ua + sv * va, su * ub + sv * vb, tu * ua + tv * va, tu * ub + tv * vb
    fx, fy = p[0] * i, p[1] * i
    return (
        p[0] * s + p[2],
        p[1] * t + p[3],
        fx * sa,
        fx * sb,
        -fx * (sa * a + sb * b),
        fy * ta,
        fy * tb,
        -fy * (ta * a + tb * b),
    )


def fisheye(p: Array, x: Value, y: Value, z: Value) -> Projected:
    """Kannala-Brandt: the image radius is a polynomial of the angle from the axis.

    J. Kannala, S. Brandt: A generic camera model and calibration method for conventional,
    wide-angle, and fish-eye lenses, PAMI 2006, eq. 6, with OpenCV's scale (its first is 1).
    """
    square = x * x + y * y + _TINY
    r = np.sqrt(square)
    n = 1.0 / (square + z * z)
    angle = np.arctan2(r, z)
    t = angle * angle
    k1, k2, k3, k4 = p[LENS], p[LENS + 1], p[LENS + 2], p[LENS + 3]
    radius = angle * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
    slope = 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)))
    return radial(p, x, y, r, radius, slope * z * n, -slope * r * n)


def atan(p: Array, x: Value, y: Value, z: Value) -> Projected:
    """The field-of-view model.

    F. Devernay, O. Faugeras: Straight lines have to be straight, MVA 2001, eq. 13: the distorted
    radius is atan(2 r tan(w / 2)) / w.
    """
    w, t = p[LENS], p[XI]
    square = x * x + y * y + _TINY
    r = np.sqrt(square)
    n = t / (w * (z * z + t * t * square))
    return radial(p, x, y, r, np.arctan2(t * r, z) / w, z * n, -r * n)


def radial(
    p: Array, x: Value, y: Value, r: Value, radius: Value, by_r: Value, by_z: Value
) -> Projected:
    """Pixel of a point r from the axis that is shown `radius` from it, and the derivatives.

    `by_r`, `by_z` are the radius's derivatives by the point's distance from the axis and its z.
    """
    i = 1.0 / r
    scale = radius * i
    bend = (by_r - scale) * i * i
    a, b = p[0] * x, p[1] * y
    mixed = bend * x * y
    return (
        a * scale + p[2],
        b * scale + p[3],
        p[0] * (scale + bend * x * x),
        p[0] * mixed,
        a * by_z * i,
        p[1] * mixed,
        p[1] * (scale + bend * y * y),
        b * by_z * i,
    )


def omni(p: Array, x: Value, y: Value, z: Value) -> Projected:
    """The unified model: onto the unit sphere, then a pinhole xi behind its centre, distorted.

    C. Mei, P. Rives: Single view point omnidirectional camera calibration from planar grids,
    ICRA 2007, section II.
    """
    xi = p[XI]
    distance = np.sqrt(x * x + y * y + z * z)
    i = 1.0 / (z + xi * distance)
    a, b = x * i, y * i
    u, v, ua, ub, va, vb = distort(p, a, b)
    # the derivatives of the depth z + xi |point|
    pull = xi / distance
    dx, dy, dz = pull * x, pull * y, 1.0 + pull * z
    us, vs = ua * a + ub * b, va * a + vb * b
    fx, fy = p[0] * i, p[1] * i
    return (
        p[0] * u + p[2],
        p[1] * v + p[3],
        fx * (ua - us * dx),
        fx * (ub - us * dy),
        -fx * us * dz,
        fy * (va - vs * dx),
        fy * (vb - vs * dy),
        -fy * vs * dz,
    )


def equirectangular(p: Array, x: Value, y: Value, z: Value) -> Projected:
    """A panorama: longitude across, latitude down; its middle looks forward.

    The image spans exactly the sphere: -0.5 ... width - 0.5 is -180 ... 180 deg.
    """
    across, down = p[0] / (2.0 * np.pi), p[1] / np.pi
    square = x * x + z * z + _TINY
    r = np.sqrt(square)
    u = p[0] * 0.5 + across * np.arctan2(x, z) - 0.5
    v = p[1] * 0.5 + down * np.arctan2(y, r) - 0.5
    u = u - p[0] * np.floor((u + 0.5) / p[0])  # +180 deg is -180 deg
    turn, rise = across / square, down / (square + y * y)
    lean = -rise * y / r
    return u, v, turn * z, 0.0 * r, -turn * x, lean * x, rise * r, lean * z


def distort(p: Array, a: Value, b: Value) -> tuple[Value, Value, Value, Value, Value, Value]:
    """Brown's distortion of a point (a, b) of the plane at depth 1.

    Returns:
        The distorted point u, v and du/da, du/db, dv/da, dv/db.
    """
    k = LENS
    p1, p2 = p[k + 2], p[k + 3]
    t = a * a + b * b
    num = 1.0 + t * (p[k] + t * (p[k + 1] + t * p[k + 4]))
    den = 1.0 / (1.0 + t * (p[k + 5] + t * (p[k + 6] + t * p[k + 7])))
    scale = num * den
    by_num = p[k] + t * (2.0 * p[k + 1] + t * 3.0 * p[k + 4])
    by_den = p[k + 5] + t * (2.0 * p[k + 6] + t * 3.0 * p[k + 7])
    slope = 2.0 * den * (by_num - scale * by_den)
    ab = a * b
    u = a * scale + 2.0 * p1 * ab + p2 * (t + 2.0 * a * a) + t * (p[k + 8] + t * p[k + 9])
    v = b * scale + p1 * (t + 2.0 * b * b) + 2.0 * p2 * ab + t * (p[k + 10] + t * p[k + 11])
    prism_u, prism_v = 2.0 * p[k + 8] + 4.0 * t * p[k + 9], 2.0 * p[k + 10] + 4.0 * t * p[k + 11]
    mixed = slope * ab + 2.0 * (p1 * a + p2 * b)
    return (
        u,
        v,
        scale + slope * a * a + 2.0 * p1 * b + 6.0 * p2 * a + prism_u * a,
        mixed + prism_u * b,
        mixed + prism_v * a,
        scale + slope * b * b + 6.0 * p1 * b + 2.0 * p2 * a + prism_v * b,
    )


FORMULAS = {
    PINHOLE: pinhole,
    BROWN: brown,
    TILTED: tilted,
    FISHEYE: fisheye,
    ATAN: atan,
    OMNI: omni,
    EQUIRECTANGULAR: equirectangular,
}
