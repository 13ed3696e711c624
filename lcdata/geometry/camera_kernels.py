"""The camera models compiled, for loops that do more with a point than project it.

Imported where such a loop is: compiling takes seconds, once a machine. A loop takes
`model_id(camera)` and `parameters(camera)` and calls, a point,

    u, v, ok = project_point(model, parameters, x, y, z)
    u, v, ux, uy, uz, vx, vy, vz, ok = project_point_jacobian(model, parameters, x, y, z)

with x, y, z in the camera frame (metres); ux is du/dx. `ok` says that the camera sees in that
direction, not that the pixel lies in the image; u and v are NaN, the derivatives 0, where not.
Whoever edits the formulas must delete numba's caches (`__pycache__/*.nbi`): they notice a change of
the file of a loop only, not of what it calls.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numpy.typing import NDArray

from lcdata.geometry import camera_formulas as formulas
from lcdata.geometry.camera_formulas import (
    ATAN,
    BROWN,
    EQUIRECTANGULAR,
    FISHEYE,
    OMNI,
    PINHOLE,
    model_id,
    parameters,
)

__all__ = ["model_id", "parameters", "project_point", "project_point_jacobian"]

Array = NDArray[np.float64]

for _formula in (
    *formulas.FORMULAS.values(),
    formulas.can_project,
    formulas.distort,
    formulas.radial,
):
    register_jitable(error_model="numpy", forceinline=True)(_formula)


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)  # type: ignore[untyped-decorator]
def project_point_jacobian(model: int, p: Array, x: float, y: float, z: float) -> Any:
    """u, v, ux, uy, uz, vx, vy, vz, ok of one point; see the module."""
    if not formulas.can_project(model, p, x, y, z):
        return np.nan, np.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False
    if model == PINHOLE:
        u, v, ux, uy, uz, vx, vy, vz = formulas.pinhole(p, x, y, z)
    elif model == BROWN:
        u, v, ux, uy, uz, vx, vy, vz = formulas.brown(p, x, y, z)
    elif model == FISHEYE:
        u, v, ux, uy, uz, vx, vy, vz = formulas.fisheye(p, x, y, z)
    elif model == ATAN:
        u, v, ux, uy, uz, vx, vy, vz = formulas.atan(p, x, y, z)
    elif model == OMNI:
        u, v, ux, uy, uz, vx, vy, vz = formulas.omni(p, x, y, z)
    elif model == EQUIRECTANGULAR:
        u, v, ux, uy, uz, vx, vy, vz = formulas.equirectangular(p, x, y, z)
    else:
        u, v, ux, uy, uz, vx, vy, vz = formulas.tilted(p, x, y, z)
    return u, v, ux, uy, uz, vx, vy, vz, True


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)  # type: ignore[untyped-decorator]
def project_point(model: int, p: Array, x: float, y: float, z: float) -> Any:
    """u, v, ok of one point; the compiler leaves out the derivatives, which nobody asks for."""
    result = project_point_jacobian(model, p, x, y, z)
    return result[0], result[1], result[8]
