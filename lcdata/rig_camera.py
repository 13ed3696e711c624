"""The rig's section on the camera: its parameters, or the file that a calibration left."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, ValidationInfo, model_validator

from lcdata.errors import GeometryError
from lcdata.geometry.camera import Camera
from lcdata.rig_links import Section


class CameraSection(Section):
    """Intrinsics; replaces CameraInfo.

    Instead of values, `file` names a Kalibr camchain (with `cam`, if not cam0) or a calib.json of
    direct_visual_lidar_calibration (with `width` and `height`, if its images are not beside it).
    Its values are taken over as the rig is read: a data set does not need the file again.
    """

    model: str = "pinhole"
    width: Annotated[int, Field(gt=0)]
    height: Annotated[int, Field(gt=0)]
    intrinsics: tuple[float, ...] = ()
    distortion: tuple[float, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _read_file(cls, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, str):
            value = {"file": value}
        if not isinstance(value, dict) or "file" not in value:
            return value
        given = dict(value)
        path = Path((info.context or {}).get("folder", "")) / str(given.pop("file"))
        cam = str(given.pop("cam", "cam0"))
        size = [given.pop(name) for name in ("width", "height") if name in given]
        if given:
            raise ValueError(f"give file or {' and '.join(given)}, not both")
        try:
            if path.suffix == ".json":
                camera = Camera.from_calib_json(path, (size[0], size[1]) if size[1:] else None)
            else:
                camera = Camera.from_kalibr(path, cam)
        except GeometryError as error:
            raise ValueError(str(error)) from error
        return {name: getattr(camera, name) for name in cls.model_fields}

    @model_validator(mode="after")
    def _is_a_camera(self) -> Self:
        try:
            self.camera()
        except GeometryError as error:
            raise ValueError(str(error)) from error
        return self

    def camera(self) -> Camera:
        """The camera model."""
        return Camera(self.model, self.width, self.height, self.intrinsics, self.distortion)
