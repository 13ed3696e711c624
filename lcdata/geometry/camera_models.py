"""The camera models: what parameters each takes, and what is wrong with given ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcdata.errors import GeometryError

if TYPE_CHECKING:
    from lcdata.geometry.camera import Camera

Array = NDArray[np.float64]


class Parameters(NamedTuple):
    """What a model's parameters are: names of the intrinsics, numbers of coefficients."""

    intrinsics: tuple[str, ...]
    distortion: tuple[int, ...]


FOCAL = ("fx", "fy", "cx", "cy")
MODELS = {
    "pinhole": Parameters(FOCAL, (0, 4, 5, 8, 12, 14)),
    "fisheye": Parameters(FOCAL, (0, 4)),
    "atan": Parameters(FOCAL, (0, 1)),
    "omni": Parameters(("xi", *FOCAL), (0, 4)),
    "equirectangular": Parameters(("width", "height"), (0,)),
}
"""The camera models."""


def check(camera: Camera) -> None:
    """Refuse an impossible camera.

    Raises:
        GeometryError: Unknown model, wrong number of parameters, impossible values.
    """
    model, intrinsics, distortion = camera.model, camera.intrinsics, camera.distortion
    if model not in MODELS:
        raise GeometryError(f"unknown camera model {model!r}", f"use one of {', '.join(MODELS)}")
    names, counts = MODELS[model]
    if len(intrinsics) != len(names):
        raise GeometryError(
            f"{model} camera with {len(intrinsics)} values as intrinsics", f"give {' '.join(names)}"
        )
    if len(distortion) not in counts:
        raise GeometryError(
            f"{model} camera with {len(distortion)} distortion coefficients",
            f"give {', '.join(map(str, counts))}",
        )
    if not np.isfinite([*intrinsics, *distortion]).all():
        raise GeometryError("camera parameters are not finite")
    size = f"{camera.width}x{camera.height}"
    focal = tuple(v for v, name in zip(intrinsics, names, strict=True) if name in ("fx", "fy"))
    if min(*focal, camera.width, camera.height) <= 0:
        raise GeometryError(
            f"camera with focal lengths {focal} px and size {size}", "all must be positive"
        )
    if model == "omni" and intrinsics[0] < 0:
        raise GeometryError(
            f"omni camera with xi {intrinsics[0]:g}", "xi is 0 or more and comes before fx"
        )
    if model == "atan" and not 0 <= sum(distortion) < np.pi:
        raise GeometryError(
            f"atan camera with a field of view of {distortion[0]:g}", "give radians, below pi"
        )
    if model == "equirectangular" and intrinsics != (camera.width, camera.height):
        raise GeometryError(
            f"equirectangular camera of {intrinsics[0]:g}x{intrinsics[1]:g} px with images of "
            f"{size}",
            "an image must be the whole panorama",
        )


def radial_profile(camera: Camera) -> tuple[Array, Array]:
    """What the lens's polynomial makes of distances from the axis.

    Returns:
        (N,) angles in radians (`fisheye`) or radii on the plane at depth 1 (others), and the (N,)
        radii that they are shown at, before the focal length.
    """
    k = np.zeros(14)
    k[: len(camera.distortion)] = camera.distortion
    if camera.model == "fisheye":
        r = np.linspace(0.0, np.pi, 2001)
        r2 = r * r
        return r, r * (1 + r2 * (k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3]))))
    # a cloud has points all around: those at 85 degrees must not come back into the image either
    r = np.append(np.linspace(0.0, 5.0, 2001), np.geomspace(5.0, 1000.0, 1001)[1:])
    if camera.model not in ("pinhole", "omni"):
        return r, r
    r2 = r * r
    distorted = (
        r
        * (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4])))
        / (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])))
    )
    return r, distorted
