"""The links of a rig: transforms measured by hand, and how well they are known."""

from __future__ import annotations

from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from lcdata.errors import GeometryError
from lcdata.geometry import se3

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]

LINKS = 12
"""Errors of two links: translation (m) and rotation (rad) of each."""

ROUNDING = 1e-6
"""By how much a written correlation may be asymmetric, or its smallest eigenvalue negative."""


def _three(value: Any) -> Any:
    """One number stands for three equal ones."""
    return (value,) * 3 if isinstance(value, int | float) else value


Std3 = Annotated[tuple[NotNegative, NotNegative, NotNegative], BeforeValidator(_three)]


class Section(BaseModel):
    """A part of the rig: unknown keys are errors, values do not change."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class Link(Section):
    """A transform measured by hand, with standard deviations.

    Give either `matrix`, or `translation_m` with one of `rotation_xyzw` and `rotation_rpy_deg`
    (as in URDF: about the fixed x, then y, then z axis). The standard deviations belong to a
    left perturbation: for `T_a_b` they are along and about the axes of frame a.
    """

    matrix: tuple[tuple[float, ...], ...] | None = None
    translation_m: Vector3 | None = None
    rotation_xyzw: tuple[float, float, float, float] | None = None
    rotation_rpy_deg: Vector3 | None = None
    translation_std_m: Std3 | None = None
    rotation_std_deg: Std3 | None = None

    @model_validator(mode="before")
    @classmethod
    def _bare_matrix(cls, value: Any) -> Any:
        return {"matrix": value} if isinstance(value, list) else value

    @model_validator(mode="after")
    def _one_form(self) -> Self:
        rotations = [r for r in (self.rotation_xyzw, self.rotation_rpy_deg) if r is not None]
        if self.matrix is not None:
            if rotations or self.translation_m is not None:
                raise ValueError("give matrix, or translation_m and a rotation, not both")
        elif self.translation_m is None or len(rotations) != 1:
            raise ValueError(
                "give matrix, or translation_m with one of rotation_xyzw, rotation_rpy_deg"
            )
        if (self.translation_std_m is None) != (self.rotation_std_deg is None):
            raise ValueError("give both translation_std_m and rotation_std_deg, or neither")
        try:
            _ = self.T
        except GeometryError as error:
            raise ValueError(str(error)) from error
        return self

    @property
    def T(self) -> Array:
        """The 4x4 transform."""
        from scipy.spatial.transform import Rotation

        if self.matrix is not None:
            return se3.check_transform([list(row) for row in self.matrix])
        if self.rotation_xyzw is not None:
            return se3.from_xyz_xyzw([*(self.translation_m or ()), *self.rotation_xyzw])
        T = np.eye(4)
        angles = np.array(self.rotation_rpy_deg, float)
        T[:3, :3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
        T[:3, 3] = self.translation_m
        return se3.check_transform(T)

    @property
    def covariance(self) -> Array:
        """6x6 covariance, translation (m) then rotation (rad); NaN where no std was given."""
        if self.translation_std_m is None or self.rotation_std_deg is None:
            return np.full((6, 6), np.nan)
        std = [*self.translation_std_m, *np.deg2rad(self.rotation_std_deg)]
        return np.diag(np.square(std))


Rows = tuple[tuple[Finite, ...], ...]


def _is_a_covariance(rows: Rows) -> Rows:
    """Square, of both links or more, symmetric, positive semidefinite.

    Units differ, so symmetry and eigenvalues are those of the correlations.
    """
    size = len(rows)
    if size < LINKS or any(len(row) != size for row in rows):
        shape = f"{size} rows of {', '.join(map(str, sorted({len(row) for row in rows})))}"
        raise ValueError(
            f"{shape} numbers; give 12x12 (T_camera_effector, then T_base_lidar), or one row and "
            "column more for each joint offset"
        )
    C = np.array(rows)
    std = np.sqrt(np.maximum(np.diag(C), 0.0))
    scale = np.where(std > 0, std, 1.0)
    correlations = C / np.outer(scale, scale)
    if np.abs(correlations - correlations.T).max() > ROUNDING:
        i, k = np.unravel_index(np.abs(correlations - correlations.T).argmax(), C.shape)
        raise ValueError(
            f"not symmetric: {C[i, k]:.6g} in row {i + 1}, column {k + 1}, and {C[k, i]:.6g} in "
            f"row {k + 1}, column {i + 1}"
        )
    smallest = float(np.linalg.eigvalsh((correlations + correlations.T) / 2)[0])
    if smallest < -ROUNDING:
        raise ValueError(
            f"not a covariance: its correlations have the eigenvalue {smallest:.3g}, they must "
            "have none below 0"
        )
    return rows


LinksCovariance = Annotated[Rows, AfterValidator(_is_a_covariance)]
"""Covariance of both links' errors together, then of the joint offsets (rad) where given."""
