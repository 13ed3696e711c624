"""Per-ray loops of the renderer, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
UInt32 = NDArray[np.uint32]


@njit(cache=True)  # type: ignore[untyped-decorator]
def camera_rays(ahead: Float32, R: Float32, origin: Float32) -> Float32:
    """(N, 6) rays (origin, unit direction) of (N, 3) directions of any length."""
    rays = np.empty((len(ahead), 6), np.float32)
    for n in range(len(ahead)):
        x, y, z = ahead[n, 0], ahead[n, 1], ahead[n, 2]
        scale = np.float32(1.0) / np.sqrt(x * x + y * y + z * z)
        for k in range(3):
            rays[n, k] = origin[k]
            rays[n, 3 + k] = (R[k, 0] * x + R[k, 1] * y + R[k, 2] * z) * scale
    return rays


@njit(cache=True)  # type: ignore[untyped-decorator]
def facing(rays: Float32, triangle: UInt32, normals: Float32) -> tuple[Float32, Float32]:
    """(N, 3) normals turned towards the rays' origins, and (N,) cosines of incidence.

    Where a ray met nothing, the triangle is out of range and both are zero.
    """
    normal = np.zeros((len(rays), 3), np.float32)
    cosine = np.zeros(len(rays), np.float32)
    for n in range(len(rays)):
        t = triangle[n]
        if t >= len(normals):
            continue
        c = np.float32(0)
        for k in range(3):
            c += normals[t, k] * rays[n, 3 + k]
        sign = np.float32(-1.0) if c > 0 else np.float32(1.0)
        cosine[n] = abs(c)
        for k in range(3):
            normal[n, k] = sign * normals[t, k]
    return normal, cosine


@njit(cache=True)  # type: ignore[untyped-decorator]
def shadow_rays(
    points: Float32, normal: Float32, lamp: Float32, sun: bool
) -> tuple[Float32, NDArray[np.int64], Float32]:
    """Rays towards a lamp from the surfaces that face it.

    Args:
        points: (N, 3) on surfaces.
        normal: (N, 3) of the surfaces; zero for points to leave out.
        lamp: (3,) direction of the sun, or position of a lamp.
        sun: Which of the two.

    Returns:
        (K, 6) rays that end at the lamp, at a length of 1 (the sun is 500 m away); (K,) which
        points they belong to; (K,) how much light arrives if nothing stands between.
    """
    rays = np.empty((len(points), 6), np.float32)
    index = np.empty(len(points), np.int64)
    strength = np.empty(len(points), np.float32)
    count = 0
    for n in range(len(points)):
        length2, along = np.float32(0), np.float32(0)
        for k in range(3):
            start = points[n, k] + np.float32(2e-3) * normal[n, k]
            towards = lamp[k] if sun else lamp[k] - start
            rays[count, k], rays[count, 3 + k] = start, towards
            length2 += towards * towards
            along += towards * normal[n, k]
        if along <= 0:
            continue
        length = np.sqrt(length2)
        index[count] = n
        if sun:
            strength[count] = along / length
            for k in range(3):
                rays[count, 3 + k] *= np.float32(500.0) / length
        else:
            strength[count] = along / length * min(np.float32(4.0), np.float32(25.0) / length2)
        count += 1
    return rays[:count], index[:count], strength[:count]


@njit(cache=True)  # type: ignore[untyped-decorator]
def add_light(
    light: Float32,
    shadows: NDArray[np.uint8],
    bit: int,
    index: NDArray[np.int64],
    strength: Float32,
    blocked: NDArray[np.bool_],
    color: Float32,
) -> None:
    """Add a lamp's light where it arrives; set its bit where it is blocked."""
    for i in range(len(index)):
        n = index[i]
        if blocked[i]:
            shadows[n] |= np.uint8(1 << bit)
        else:
            for k in range(3):
                light[n, k] += strength[i] * color[k]


@njit(cache=True)  # type: ignore[untyped-decorator]
def ambient(normal: Float32, above: Float32, below: Float32) -> Float32:
    """(N, 3) light from all around on surfaces: from the sky above, from the ground below."""
    out = np.empty_like(normal)
    for n in range(len(normal)):
        up = np.float32(0.5) + np.float32(0.5) * normal[n, 2]
        for k in range(3):
            out[n, k] = up * above[k] + (np.float32(1.0) - up) * below[k]
    return out


@njit(cache=True)  # type: ignore[untyped-decorator]
def _sky(z: float, k: int, sky: Float32, horizon: Float32, below: Float32) -> float:
    if z <= 0:
        share = min(1.0, -3.0 * z)
        return float(share * below[k] + (1 - share) * horizon[k])
    share = z**0.6
    return float(share * sky[k] + (1 - share) * horizon[k])


@njit(cache=True)  # type: ignore[untyped-decorator]
def compose(
    rays: Float32,
    normal: Float32,
    cosine: Float32,
    albedo: Float32,
    light: Float32,
    glow: Float32,
    gloss: Float32,
    sky: Float32,
    horizon: Float32,
    below: Float32,
) -> Float32:
    """(N, 3) radiance: lit surfaces, the sky mirrored in glossy ones, sky where nothing was met.

    Args:
        rays: (N, 6).
        normal: (N, 3), zero where a ray met nothing.
        cosine: (N,) of incidence.
        albedo: (N, 3).
        light: (N, 3) that arrives.
        glow: (N,) light of their own.
        gloss: (N,) 0 matt ... 1 mirror.
        sky: (3,) at the zenith.
        horizon: (3,).
        below: (3,) below the horizon.
    """
    out = np.empty((len(rays), 3), np.float32)
    for n in range(len(rays)):
        z = rays[n, 5]
        if cosine[n] == 0:
            for k in range(3):
                out[n, k] = _sky(z, k, sky, horizon, below)
            continue
        mirror = gloss[n] * (0.08 + 0.6 * (1 - cosine[n]) ** 3)
        z_mirrored = z + 2 * cosine[n] * normal[n, 2]
        for k in range(3):
            value = albedo[n, k] * (light[n, k] + glow[n])
            if mirror > 0:
                value += mirror * (_sky(z_mirrored, k, sky, horizon, below) - value)
            out[n, k] = value
    return out


@njit(cache=True)  # type: ignore[untyped-decorator]
def silhouettes(
    picture: Float32,
    rays: Float32,
    distance: Float32,
    normal: Float32,
    kind: NDArray[np.int32],
    contrast: float,
) -> NDArray[np.bool_]:
    """Pixels on the border between two surfaces, or of a shadow, with visible contrast.

    Args:
        picture: (H, W, 3) radiance.
        rays: (H * W, 6).
        distance: (H * W,).
        normal: (H * W, 3).
        kind: (H * W,) material and shadows; 0 where a ray met nothing.
        contrast: Least difference of any channel after gamma.

    Returns:
        (H, W), two pixels wide.
    """
    height, width = picture.shape[:2]
    out = np.zeros((height, width), np.bool_)
    for i in range(height):
        for j in range(width):
            a = i * width + j
            for di, dj in ((0, 1), (1, 0)):
                if i + di >= height or j + dj >= width:
                    continue
                b = (i + di) * width + j + dj
                different = kind[a] != kind[b]
                if not different and kind[a] != 0:
                    turned, apart = np.float32(0), np.float32(0)
                    for k in range(3):
                        turned += normal[a, k] * normal[b, k]
                        gap = distance[b] * rays[b, 3 + k] - distance[a] * rays[a, 3 + k]
                        apart += normal[a, k] * gap
                    different = turned < 0.998 or abs(apart) > 0.01
                if not different:
                    continue
                visible = False
                for k in range(3):
                    p, q = min(picture[i, j, k], 4.0), min(picture[i + di, j + dj, k], 4.0)
                    visible |= abs(p**0.45 - q**0.45) > contrast
                if visible:
                    out[i, j] = True
                    out[i + di, j + dj] = True
    return out
