"""Time a point of every camera model: projected, and with its derivative.

    python benchmarks/camera_models.py

prints nanoseconds a point on one core, of 262,144 points in front of the camera: compiled (in a
loop that adds everything up) and as whole arrays. The best of nine runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from lcdata.geometry.camera import Camera
from lcdata.geometry.camera_kernels import project_point, project_point_jacobian

POINTS, RUNS = 262_144, 9
FOCAL = (530.0, 531.0, 640.2, 355.5)
BROWN = (-0.05, 0.02, 0.001, -0.0005, 0.003)
CAMERAS = {
    "pinhole": Camera("pinhole", 1280, 720, FOCAL),
    "plumb_bob": Camera("pinhole", 1280, 720, FOCAL, BROWN),
    "rational": Camera("pinhole", 1280, 720, FOCAL, (*BROWN, 0.1, -0.03, 0.005)),
    "fisheye": Camera("fisheye", 1280, 960, FOCAL, (0.02, -0.01, 0.003, -0.0004)),
    "atan": Camera("atan", 1280, 720, FOCAL, (0.93,)),
    "omni": Camera("omni", 1280, 1024, (1.2, *FOCAL), (-0.1, 0.05, 0.001, -0.0005)),
    "equirectangular": Camera("equirectangular", 1920, 960),
}


@njit
def _project(model, p, points):  # type: ignore[no-untyped-def]
    total = 0.0
    for x, y, z in points:
        u, v, ok = project_point(model, p, x, y, z)
        if ok:
            total += u + v
    return total


@njit
def _project_jacobian(model, p, points):  # type: ignore[no-untyped-def]
    total = 0.0
    for x, y, z in points:
        u, v, ux, uy, uz, vx, vy, vz, ok = project_point_jacobian(model, p, x, y, z)
        if ok:
            total += u + v + ux + uy + uz + vx + vy + vz
    return total


def best(function: Callable[..., Any], *arguments: Any) -> float:
    """Nanoseconds a point."""
    function(*arguments)
    seconds = []
    for _ in range(RUNS):
        start = time.perf_counter()
        function(*arguments)
        seconds.append(time.perf_counter() - start)
    return min(seconds) / POINTS * 1e9


def main() -> None:
    """Print the table."""
    points = np.random.default_rng(0).uniform([-4, -3, 3], [4, 3, 9], (POINTS, 3))
    print(f"{'':15s}  compiled  with J   arrays  with J   (ns a point)")
    for name, camera in CAMERAS.items():
        model, p = camera.formula
        columns = (
            best(_project, model, p, points),
            best(_project_jacobian, model, p, points),
            best(camera.project, points),
            best(camera.project_jacobian, points),
        )
        print(f"{name:15s} {columns[0]:9.1f} {columns[1]:7.1f} {columns[2]:8.0f} {columns[3]:7.0f}")


if __name__ == "__main__":
    main()
