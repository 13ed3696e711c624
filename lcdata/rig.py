"""rig.yaml: what was measured by hand, and how a recording is to be read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
import yaml
from numpy.typing import NDArray
from pydantic import (
    BeforeValidator,
    Field,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from lcdata import yaml_file
from lcdata.errors import ArmError, RigError
from lcdata.geometry.camera import Camera
from lcdata.rig_camera import CameraSection
from lcdata.rig_integration import Integration
from lcdata.rig_joint_log import JointLog
from lcdata.rig_links import LINKS, Link, LinksCovariance, NotNegative, Section

if TYPE_CHECKING:
    from lcdata.arm import Arm

Array = NDArray[np.float64]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

RIG_FILE = "rig.yaml"

ESTIMATE = "estimate"
"""`clock_offset_s` of a rig that leaves it to the images of each recording."""

LARGEST_CLOCK_OFFSET_S = 10.0
"""Clocks that are farther apart are not synchronised at all: `stamps: bag` is for them."""


JOINT_OFFSET_STD_DEG = 0.75
"""Of an arm's joints with nominal kinematics: zero points off by so much scatter 318 readings of a
real Gen3 lite in a socket by the 6.1 mm that were measured; those that could be fitted were 0.4 to
1.3 deg. Data sheets give repeatability, which says nothing of this."""


def _text(value: Any) -> Any:
    """YAML reads a serial number of digits as a number."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


class Topics(Section):
    """Topic names; `auto` takes the only topic of the right type."""

    lidar: str = "auto"
    image: str = "auto"
    camera_info: str = "auto"
    joint_states: str = "auto"


class ArmSection(Section):
    """The arm that carries the camera."""

    model: str = "gen3_lite"
    base_frame: str = "base_link"
    effector_frame: str = "end_effector_link"
    serial: Annotated[str, BeforeValidator(_text)] | None = None
    joint_offsets: str | None = None
    joint_offset_std_deg: NotNegative = JOINT_OFFSET_STD_DEG
    encoder_std_deg: NotNegative = 0.02


class Pairing(Section):
    """Which image belongs to a scan."""

    tolerance_ms: Positive = 50.0


class Dwells(Section):
    """When the arm stands still."""

    max_velocity_deg_s: Positive = 0.5
    min_duration_s: Positive = 0.5
    settle_s: NotNegative = 0.2


def _clock(value: Any) -> Any:
    if value in (None, ESTIMATE):
        return value
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not abs(value) <= LARGEST_CLOCK_OFFSET_S:
        raise ValueError(
            "give the arm's clock minus the camera's in seconds (less than "
            f"{LARGEST_CLOCK_OFFSET_S:g}), or {ESTIMATE}"
        )
    return value


ClockOffsetS = Annotated[float | Literal["estimate"] | None, BeforeValidator(_clock)]


class PointTime(Section):
    """The cloud's per-point time, where the rule that finds it chooses wrongly."""

    field: str = "auto"
    unit: Literal["auto", "s", "ms", "us", "ns"] = "auto"


class Rig(Section):
    """Everything about a recording that the recording does not say itself."""

    ground_truth: Literal["arm", "static"] = "arm"
    note: str = ""
    simulated: bool = False
    topics: Topics = Topics()
    camera: CameraSection | None = None
    joint_log: JointLog = None
    arm: ArmSection = ArmSection()
    T_camera_effector: Link | None = None
    T_base_lidar: Link | None = None
    T_camera_lidar: Link | None = None
    links_covariance: LinksCovariance | None = None
    links_refined_from: tuple[str, ...] | None = None
    clock_offset_s: ClockOffsetS = None
    clock_offset_std_s: NotNegative = 0.0
    pairing: Pairing = Pairing()
    dwells: Dwells = Dwells()
    stamps: Literal["header", "bag"] = "header"
    point_time: PointTime = PointTime()
    integration: Integration = None

    _path: Path | None = PrivateAttr(default=None)

    @model_validator(mode="after")
    def _links_of_the_mode(self) -> Self:
        hand_measured = {
            "T_camera_effector": self.T_camera_effector,
            "T_base_lidar": self.T_base_lidar,
        }
        if self.ground_truth == "arm":
            missing = [name for name, link in hand_measured.items() if link is None]
            if missing:
                raise ValueError(
                    f"ground_truth: arm needs {' and '.join(missing)}; a recording without an arm "
                    "needs ground_truth: static"
                )
            if self.T_camera_lidar is not None:
                raise ValueError("T_camera_lidar goes with ground_truth: static")
        else:
            given = [name for name, link in hand_measured.items() if link is not None]
            if given:
                raise ValueError(f"{' and '.join(given)} go with ground_truth: arm")
        merged = self.integration is not None and self.integration.mode == "dynamic"
        if merged and self.ground_truth == "arm":
            raise ValueError(
                "integration: dynamic is for a LiDAR that moves; it goes with ground_truth: static "
                "(with an arm the LiDAR stands still: integration: static)"
            )
        if self.links_covariance is not None:
            if self.ground_truth != "arm":
                raise ValueError("links_covariance goes with ground_truth: arm")
            for name, link in hand_measured.items():
                if link is not None and link.translation_std_m is not None:
                    raise ValueError(
                        f"links_covariance and standard deviations of {name}: give one of them"
                    )
        return self

    @property
    def folder(self) -> Path | None:
        """Folder of the file it was read from, which its relative paths start from."""
        return self._path.parent if self._path else None

    def covariance_of_links(self) -> Array:
        """What is known of both links together.

        Returns:
            (12, 12) of T_camera_effector, then T_base_lidar, each translation (m) then rotation
            (rad), left perturbations; (12 + n, 12 + n) with the joint offsets (rad) after them
            where `links_covariance` has them. NaN where nothing is known.

        Raises:
            RigError: The rig has no such links.
        """
        if self.T_camera_effector is None or self.T_base_lidar is None:
            raise RigError("the rig has no T_camera_effector and T_base_lidar", "add both")
        if self.links_covariance is not None:
            given = np.array(self.links_covariance)
            return np.asarray((given + given.T) / 2)
        result = np.zeros((LINKS, LINKS))
        result[:6, :6] = self.T_camera_effector.covariance
        result[6:, 6:] = self.T_base_lidar.covariance
        return result

    def camera_model(self) -> Camera | None:
        """The camera given here; None if CameraInfo is to be used."""
        return self.camera.camera() if self.camera else None

    def load_arm(self) -> Arm:
        """The arm model with its joint offsets.

        Raises:
            ArmError: Unknown model or frame, unreadable offsets, offsets of another arm; it names
                the rig file and the key.
        """
        from lcdata.arm import Arm, find_urdf

        arm = self.arm
        with self.naming_arm("model"):
            urdf = find_urdf(arm.model, self.folder)
        with self.naming_arm("base_frame", "effector_frame"):
            loaded = Arm(urdf, arm.base_frame, arm.effector_frame, serial=arm.serial or "")
        if arm.joint_offsets is None:
            return loaded
        with self.naming_arm("joint_offsets"):
            return loaded.with_offsets_of((self.folder or Path()) / arm.joint_offsets)

    @contextmanager
    def naming_arm(self, *keys: str) -> Iterator[None]:
        """Name the rig file and the key of `arm` in an error: the one whose value it has."""
        try:
            yield
        except ArmError as error:
            found = [key for key in keys if repr(getattr(self.arm, key)) in error.message]
            key = ".".join(["arm", *(keys if len(keys) == 1 else found[:1])])
            where = f"{self._path or 'rig'}: {key}"
            raise ArmError(f"{where}: {error.message}", error.remedy) from error

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as JSON and YAML take them; `from_dict` reads them back."""
        return self.model_dump(mode="json", exclude_none=True)

    def to_yaml(self) -> str:
        """The rig as a rig file."""
        return yaml.safe_dump(self.to_dict(), sort_keys=False, default_flow_style=None)

    @classmethod
    def from_dict(cls, content: Any, source: str = "rig") -> Rig:
        """Rig of plain values.

        Raises:
            RigError: Naming key, value and what is allowed.
        """
        return _validated(content, source, None)


def find_rig(recordings: Path) -> Path | None:
    """The rig file of a recording or a folder of recordings: inside it, or beside it."""
    for folder in (recordings, recordings.resolve().parent):
        if (folder / RIG_FILE).is_file():
            return folder / RIG_FILE
    return None


def load_rig(path: Path) -> Rig:
    """Read a rig file.

    Raises:
        RigError: Naming file, line, key, value and what is allowed.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise RigError(
            f"no rig file {path}", "`lcdata info RECORDING` prints one to start from"
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no text file"
        raise RigError(f"{path}: cannot be read ({reason})", "check the file") from error
    try:
        content, root = yaml_file.parse(text)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f":{mark.line + 1}" if mark else ""
        raise RigError(f"{path}{line}: not YAML ({getattr(error, 'problem', error)})") from error
    for key, first, second in yaml_file.duplicates(root):
        raise RigError(f"{path}:{second}: {key} is given twice, first in line {first}", "keep one")
    rig = _validated({} if content is None else content, str(path), root)
    rig._path = path.resolve()
    return rig


def _validated(content: Any, source: str, root: yaml.Node | None) -> Rig:
    if not isinstance(content, dict):
        raise RigError(
            f"{source}: holds {type(content).__name__}, not keys with values",
            "write at least `ground_truth: static`",
        )
    try:
        return Rig.model_validate(content, context={"folder": Path(source).parent})
    except ValidationError as error:
        raise RigError(yaml_file.describe(error, source, root, Rig)) from error
