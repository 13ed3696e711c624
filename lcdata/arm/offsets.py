"""The per-serial file of an arm's joint offsets: whose they are, and how well they are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from lcdata import yaml_file
from lcdata.errors import ArmError

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class JointOffsets:
    """Content of a joint offsets file.

    Args:
        path: The file.
        offsets: Radians added to the encoder's reading, by joint name.
        covariance: Variances and covariances in rad^2 by pairs of joint names; empty if the file
            does not say how well its offsets are known.
        serial: Serial number of the arm; empty if the file does not say.
        model: Name of the arm's model (the URDF's stem); empty if the file does not say.
        model_sha256: Checksum of the URDF that the offsets were fitted with; may be empty.
    """

    path: Path
    offsets: dict[str, float]
    covariance: dict[tuple[str, str], float]
    serial: str = ""
    model: str = ""
    model_sha256: str = ""

    def check(self, model: str, sha256: str, serial: str = "") -> None:
        """Refuse the offsets of another arm.

        Args:
            model: Stem of the URDF in use.
            sha256: Its checksum.
            serial: Serial number of the arm in use; empty if it is not known.

        Raises:
            ArmError: Naming what differs.
        """
        if self.model and self.model != model:
            raise ArmError(
                f"{self.path}: joint offsets of a {self.model}, the arm is a {model}",
                "name the offsets of this arm",
            )
        if self.model_sha256 and self.model_sha256 != sha256:
            raise ArmError(
                f"{self.path}: joint offsets fitted with a URDF of sha256 "
                f"{self.model_sha256[:12]}, the {model} in use has {sha256[:12]}",
                "use that URDF, or `lcdata arm calibrate` with this one",
            )
        if serial and self.serial and self.serial != serial:
            raise ArmError(
                f"{self.path}: joint offsets of the arm with serial {self.serial}, the rig's "
                f"arm.serial is {serial}",
                "name the offsets of this arm",
            )

    def covariance_of(self, joint_names: Sequence[str]) -> Array | None:
        """(n, n) in rad^2; NaN on the diagonal of joints it does not know; None without any."""
        if not self.covariance:
            return None
        result = np.zeros((len(joint_names),) * 2)
        np.fill_diagonal(result, np.nan)
        for i, a in enumerate(joint_names):
            for k, b in enumerate(joint_names):
                result[i, k] = self.covariance.get((a, b), result[i, k])
        return result


def read_offsets_file(path: Path) -> JointOffsets:
    """Read a per-serial YAML (`offsets_deg: {joint_1: 0.12, ...}`).

    Optional keys: `offsets_std_deg` by joint, `offsets_covariance_deg2` (rows in the order of
    `offsets_deg`; wins over the former), `serial`, `model`, `model_sha256`.

    Raises:
        ArmError: Not readable, or not of this form.
    """
    try:
        content, root = yaml_file.parse(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise ArmError(f"{path}: cannot read joint offsets ({reason})") from error
    for key, first, second in yaml_file.duplicates(root):
        raise ArmError(f"{path}:{second}: {key} is given twice, first in line {first}", "keep one")
    if not isinstance(content, dict) or not isinstance(content.get("offsets_deg"), dict):
        raise ArmError(
            f"{path}: no key offsets_deg", "write offsets_deg: {joint_1: 0.12, ...} in degrees"
        )
    offsets = _degrees(path, "offset", content["offsets_deg"])
    return JointOffsets(
        path,
        offsets,
        _covariance(path, content, list(offsets)),
        *(str(content.get(key) or "") for key in ("serial", "model", "model_sha256")),
    )


def _covariance(
    path: Path, content: Mapping[str, Any], names: list[str]
) -> dict[tuple[str, str], float]:
    if (rows := content.get("offsets_covariance_deg2")) is not None:
        try:
            matrix = np.array(rows, float) * np.deg2rad(1.0) ** 2
        except (TypeError, ValueError) as error:
            raise ArmError(f"{path}: offsets_covariance_deg2 is no matrix") from error
        n = len(names)
        if (
            matrix.shape != (n, n)
            or not np.isfinite(matrix).all()
            or not np.allclose(matrix, matrix.T, rtol=1e-6)
            or np.linalg.eigvalsh(matrix).min() < -1e-6 * np.abs(matrix).max()
        ):
            raise ArmError(
                f"{path}: offsets_covariance_deg2 of shape {matrix.shape} is no covariance of "
                f"{n} offsets",
                "give symmetric rows in the order of offsets_deg",
            )
        return {
            (a, b): float(matrix[i, k]) for i, a in enumerate(names) for k, b in enumerate(names)
        }
    given = content.get("offsets_std_deg")
    if given is None:
        return {}
    if not isinstance(given, dict):
        raise ArmError(f"{path}: offsets_std_deg is {given!r}", "give {joint_1: 0.05, ...}")
    std = _degrees(path, "standard deviation", given)
    for name, value in std.items():
        if value < 0 or name not in names:
            raise ArmError(
                f"{path}: standard deviation of {name} is {given[name]!r}",
                f"give 0 or more degrees for {', '.join(names)}",
            )
    return {(name, name): value**2 for name, value in std.items()}


def _degrees(path: Path, what: str, values: Mapping[Any, Any]) -> dict[str, float]:
    """Radians of degrees by joint name."""
    for name, value in values.items():
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise ArmError(f"{path}: {what} of {name} is {value!r}", "give degrees")
    return {str(name): float(np.deg2rad(value)) for name, value in values.items()}
