"""The camera models compiled, for loops that do more with a point than project it.

Imported where such a loop is: compiling takes seconds, once a machine. A loop takes
`model_id(camera)` and `parameters(camera)` and calls, a point,

    u, v, ok = project_point(model, parameters, x, y, z)
    u, v, ux, uy, uz, vx, vy, vz, ok = project_point_jacobian(model, parameters, x, y, z)

with x, y, z in the camera frame (metres); ux is du/dx. `ok` says that the camera sees in that
direction, not that the pixel lies in the image; u and v are NaN, the derivatives 0, where not.

A loop that is in a hurry fills the first three rows of a block, a flat array of rows of `BLOCK`
numbers, with x, y and z and calls `project_block` or `project_block_jacobian`: the next two rows
become u and v, and the next six the derivatives; u is NaN where the camera does not see. For
pinholes, distorted or not, the compiler does several points at once: three times as fast.
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

__all__ = [
    "BLOCK",
    "BLOCK_ROWS",
    "FAST",
    "model_id",
    "parameters",
    "project_block",
    "project_block_jacobian",
    "project_point",
    "project_point_jacobian",
]

Array = NDArray[np.float64]

BLOCK = 256
"""Points of a block: its rows stay in the processor's nearest cache."""

BLOCK_ROWS = 11
"""Rows of a block: x, y, z, u, v, ux, uy, uz, vx, vy, vz."""

FAST = {"contract", "arcp", "reassoc", "nsz"}
"""What loops over points let the compiler do to sums and products: all but forget NaN."""

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


def _loops(model: int) -> tuple[Any, Any]:
    """`project_block` and `project_block_jacobian` of a model that is known when they compile."""
    formula = formulas.FORMULAS[model]

    @register_jitable(error_model="numpy", fastmath=FAST, forceinline=True)  # type: ignore[untyped-decorator]
    def pixels(p: Array, block: Array) -> None:
        for j in range(BLOCK):
            x, y, z = block[j], block[BLOCK + j], block[2 * BLOCK + j]
            u, v, _, _, _, _, _, _ = formula(p, x, y, z)
            ok = formulas.can_project(model, p, x, y, z)
            block[3 * BLOCK + j] = u if ok else np.nan
            block[4 * BLOCK + j] = v

    @register_jitable(error_model="numpy", fastmath=FAST, forceinline=True)  # type: ignore[untyped-decorator]
    def jacobian(p: Array, block: Array) -> None:
        for j in range(BLOCK):
            x, y, z = block[j], block[BLOCK + j], block[2 * BLOCK + j]
            u, v, ux, uy, uz, vx, vy, vz = formula(p, x, y, z)
            ok = formulas.can_project(model, p, x, y, z)
            block[3 * BLOCK + j] = u if ok else np.nan
            block[4 * BLOCK + j] = v
            block[5 * BLOCK + j], block[6 * BLOCK + j], block[7 * BLOCK + j] = ux, uy, uz
            block[8 * BLOCK + j], block[9 * BLOCK + j], block[10 * BLOCK + j] = vx, vy, vz

    return pixels, jacobian


_pinhole, _pinhole_jacobian = _loops(PINHOLE)
_brown, _brown_jacobian = _loops(BROWN)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)  # type: ignore[untyped-decorator]
def project_block(model: int, p: Array, block: Array) -> None:
    """Pixels of a block of points; see the module."""
    if model == PINHOLE:
        _pinhole(p, block)
    elif model == BROWN:
        _brown(p, block)
    else:
        for j in range(BLOCK):
            x, y, z = block[j], block[BLOCK + j], block[2 * BLOCK + j]
            block[3 * BLOCK + j], block[4 * BLOCK + j], _ = project_point(model, p, x, y, z)


@njit(cache=True, nogil=True, error_model="numpy", fastmath=FAST)  # type: ignore[untyped-decorator]
def project_block_jacobian(model: int, p: Array, block: Array) -> None:
    """Pixels and derivatives of a block of points; see the module."""
    if model == PINHOLE:
        _pinhole_jacobian(p, block)
    elif model == BROWN:
        _brown_jacobian(p, block)
    else:
        for j in range(BLOCK):
            x, y, z = block[j], block[BLOCK + j], block[2 * BLOCK + j]
            u, v, ux, uy, uz, vx, vy, vz, _ = project_point_jacobian(model, p, x, y, z)
            block[3 * BLOCK + j], block[4 * BLOCK + j] = u, v
            block[5 * BLOCK + j], block[6 * BLOCK + j], block[7 * BLOCK + j] = ux, uy, uz
            block[8 * BLOCK + j], block[9 * BLOCK + j], block[10 * BLOCK + j] = vx, vy, vz
