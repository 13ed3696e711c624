"""Any folder with images, clouds, and one JSON file with K, D and T_camera_lidar."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from lcdata.dataset.importers import files
from lcdata.dataset.importers.calibration import (
    camera_of,
    check_keys,
    covariance_of,
    intrinsics_of,
    numbers,
    read_json,
    rigid,
)
from lcdata.dataset.importers.pairs_in_folder import items_of, pair_up
from lcdata.dataset.importers.published import Published
from lcdata.errors import SourceError
from lcdata.geometry.camera import Camera
from lcdata.geometry.camera_models import MODELS

REFERENCE = ("reference.json", "calibration.json", "calib.json")
"""Names of the file, best first."""

KEYS = ("K", "D", "T_camera_lidar", "camera_model", "width", "height", "covariance")


@dataclass(frozen=True)
class Folder:
    """Pairs of one camera and one extrinsic, or folders of such pairs, a scenario each.

    Args:
        source: The folder: images and clouds in it, or in a folder each below it; or folders with
            a `reference.json` each.
        calibration: The JSON file; by default `reference.json` in the folder, or the only one.
        by_order: Pair images and clouds by order instead of by name.
        images: Folder of the images, relative to `source`, if it is not to be found.
        clouds: Folder of the clouds, relative to `source`, if it is not to be found.
    """

    source: Path
    calibration: Path | None = None
    by_order: bool = False
    images: str = ""
    clouds: str = ""
    format: ClassVar[str] = "folder"

    def recordings(self) -> dict[str, Callable[[], Published]]:
        """See `published.Importer`."""
        if self.calibration is None and not files.files_in(self.source, (".json",)):
            found = sorted(path.parent for path in self.source.glob(f"*/{REFERENCE[0]}"))
            if found:
                return {folder.name: replace(self, source=folder)._pairs for folder in found}
        return {scenario_of(self.source): self._pairs}

    def _pairs(self) -> Published:
        path = self.calibration or self._reference()
        content = check_keys(path, read_json(path), KEYS)
        images = self._files("images", self.images, files.IMAGES)
        clouds = self._files("clouds", self.clouds, files.CLOUDS)
        named = pair_up(images, clouds, self.source, by_order=self.by_order)
        camera = read_camera(path, content, images)
        if "T_camera_lidar" not in content:
            raise SourceError(
                f"{path}: no T_camera_lidar",
                "give 4x4 that maps LiDAR points to camera points (metres)",
            )
        T_camera_lidar = rigid(content["T_camera_lidar"], f"{path}: T_camera_lidar")
        covariance = None
        if content.get("covariance") is not None:
            covariance = covariance_of(content["covariance"], f"{path}: covariance")
        items, warnings = items_of(named, self.source, T_camera_lidar, covariance)
        return Published(
            name=scenario_of(self.source),
            camera=camera,
            items=items,
            image="images",
            lidar="clouds",
            calibration=(path,),
            warnings=tuple(warnings),
        )

    def _reference(self) -> Path:
        found = files.files_in(self.source, (".json",))
        named = [self.source / name for name in REFERENCE if self.source / name in found]
        if named or len(found) == 1:
            return (named or found)[0]
        there = f"{len(found)} JSON files, none of them {REFERENCE[0]}" if found else "no JSON file"
        raise SourceError(
            f"{self.source}: {there}",
            "write K, D and T_camera_lidar into reference.json there, or name one with "
            "--calibration",
        )

    def _files(self, kind: str, given: str, suffixes: Sequence[str]) -> list[Path]:
        """Images or clouds: of the folder itself, or of the only folder below that has some."""
        if given:
            found = files.without_masks(files.files_in(self.source / given, suffixes))
            if not found:
                listed = ", ".join(suffixes)
                raise SourceError(f"{self.source / given}: no {kind} in it", f"they are {listed}")
            return found
        if found := files.without_masks(files.files_in(self.source, suffixes)):
            return found
        below = {
            folder: inside
            for folder in sorted(self.source.iterdir())
            if folder.is_dir() and folder.name != files.MASKS and folder.name[0] != "."
            if (inside := files.files_in(folder, suffixes))
        }
        if len(below) > 1:
            names = ", ".join(folder.name for folder in below)
            raise SourceError(
                f"{self.source}: {kind} in several folders: {names}", f"choose one with --{kind}"
            )
        return next(iter(below.values()), [])


def read_camera(path: Path, content: dict[str, Any], images: Sequence[Path]) -> Camera:
    """The camera of a JSON file.

    Args:
        path: The file, for errors.
        content: Its `camera_model` (pinhole), `K` (fx fy cx cy, or 3x3; what the model has), `D`,
            and `width` and `height`, without which they are those of the images.
        images: The images.

    Raises:
        SourceError: A key that is missing or wrong.
    """
    model = str(content.get("camera_model", "pinhole"))
    if model not in MODELS:
        raise SourceError(f"{path}: unknown camera_model {model!r}", f"use {', '.join(MODELS)}")
    names = MODELS[model].intrinsics
    if "K" not in content and model != "equirectangular":
        raise SourceError(f"{path}: no K", f"give {' '.join(names)}")
    intrinsics: Sequence[float] = ()
    if model == "omni" or (model == "equirectangular" and "K" in content):
        values = numbers(content["K"], f"{path}: K")
        if values.shape != (len(names),):
            shape = "x".join(map(str, values.shape)) or "1"
            raise SourceError(f"{path}: K has {shape} values", f"give {' '.join(names)}")
        intrinsics = values.tolist()
    elif model != "equirectangular":
        intrinsics = intrinsics_of(content["K"], f"{path}: K")
    distortion = numbers(content.get("D") or (), f"{path}: D")
    if distortion.ndim != 1 and min(distortion.shape, default=0) != 1:
        raise SourceError(f"{path}: D has {distortion.shape} values", "give one row")
    given = [content.get(key) for key in ("width", "height")]
    if any(given):
        if not all(isinstance(v, int) and v > 0 for v in given):
            raise SourceError(f"{path}: width and height are {given}", "give both, in pixels")
        size = int(given[0] or 0), int(given[1] or 0)
    else:
        size = files.common_size(images, path.parent)
    return camera_of(
        f"{path}: K", size, intrinsics, np.ravel(distortion).tolist(), model, size_given=any(given)
    )


def scenario_of(source: Path) -> str:
    """Name of a folder's scenario: the folder's own."""
    return source.name if source.name not in ("", "..") else source.resolve().name
