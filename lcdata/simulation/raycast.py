"""Ray casting against a scene of `lcdata.simulation.mesh` parts, by Open3D's Embree."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcdata.open3d_loader import open3d
from lcdata.simulation import kernels, textures
from lcdata.simulation.mesh import Material, Part

Float32 = NDArray[np.float32]

_NOTHING = 0xFFFFFFFF


@dataclass(frozen=True, eq=False)
class Hits:
    """What a bundle of N rays met.

    Args:
        distance: (N,) metres along the ray; infinity where it met nothing.
        triangle: (N,) triangle number; 0 where it met nothing.
        normal: (N, 3) unit normal that faces the ray's origin; zero where it met nothing.
        cosine: (N,) of the angle of incidence, 0 ... 1; 0 where it met nothing.
    """

    distance: Float32
    triangle: NDArray[np.uint32]
    normal: Float32
    cosine: Float32

    @property
    def hit(self) -> NDArray[np.bool_]:
        """(N,) whether a ray met anything."""
        return np.asarray(np.isfinite(self.distance))


class RayCaster:
    """A scene that rays can be cast into.

    Args:
        parts: The scene.
    """

    def __init__(self, parts: Iterable[Part]) -> None:
        parts = list(parts)
        corners = np.concatenate([p.corners for p in parts]).astype(np.float32)
        kinds: dict[Material, int] = {}
        index = [kinds.setdefault(p.material, len(kinds)) for p in parts]
        self.materials = tuple(kinds)
        self.material = np.repeat(index, [len(p.corners) for p in parts]).astype(np.int32)
        self._frames = np.concatenate([p.frames for p in parts]).astype(np.float32)
        self._table = textures.table(self.materials)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        self._normals = (normals / np.maximum(length, 1e-12)).astype(np.float32)
        o3d = open3d()
        self._tensor: Any = o3d.core.Tensor
        self._scene: Any = o3d.t.geometry.RaycastingScene()
        triangles = np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3)
        self._scene.add_triangles(self._tensor(corners.reshape(-1, 3)), self._tensor(triangles))

    def cast(self, rays: Float32) -> Hits:
        """First hits of (N, 6) rays: origin (m) and unit direction."""
        result = self._scene.cast_rays(self._tensor(rays))
        triangle = result["primitive_ids"].numpy()
        normal, cosine = kernels.facing(rays, triangle, self._normals)
        triangle[triangle == _NOTHING] = 0
        return Hits(result["t_hit"].numpy(), triangle, normal, cosine)

    def blocked(self, rays: Float32) -> NDArray[np.bool_]:
        """(N,) whether something stands on (N, 6) rays before they reach length 1."""
        blocked: NDArray[np.bool_] = self._scene.test_occlusions(
            self._tensor(rays), 0.0, 1.0
        ).numpy()
        return blocked

    def albedo(self, points: Float32, triangle: NDArray[np.uint32], footprint: Float32) -> Float32:
        """(N, 3) linear RGB of hit points, see `textures.albedo`."""
        return np.asarray(
            textures.albedo(points, triangle, footprint, self._frames, self.material, self._table)
        )

    def property_of(self, name: str) -> Float32:
        """(T,) a number of each triangle's material, such as `near_infrared`."""
        return np.array([getattr(m, name) for m in self.materials], np.float32)[self.material]

    def of_kind(self, kind: str, hits: Hits) -> NDArray[np.bool_]:
        """(N,) whether rays met a material of a kind, see `Material.kind`."""
        wanted = np.array([m.kind == kind for m in self.materials])
        return np.asarray(hits.hit & wanted[self.material[hits.triangle]])
