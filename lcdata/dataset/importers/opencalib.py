"""What OpenCalib (PJLab-ADG/SensorsCalibration) and Calib-Anything publish their pairs in.

Three layouts, each with a camera and an extrinsic of its own; folders of them are searched:

- images and clouds with `*-intrinsic.json` and `*-to-*-extrinsic.json`: auto_calib, manual_calib;
- images, clouds and masks/ with `calib.txt`, lines K (or P2), D, T (or Tr): Calib-Anything, first
  release;
- a JSON file with cam_K, cam_dist and T_lidar_to_cam, which names the folders of images, clouds and
  masks: Calib-Anything, second release.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset.importers import files
from lcdata.dataset.importers.calibration import (
    camera_of,
    intrinsics_of,
    numbers,
    read_json,
    rigid,
    split_projection,
)
from lcdata.dataset.importers.folder import scenario_of
from lcdata.dataset.importers.kitti_calib import read_calibration
from lcdata.dataset.importers.pairs_in_folder import items_of, pair_up
from lcdata.dataset.importers.published import Published
from lcdata.errors import SourceError

Array = NDArray[np.float64]

REMEDY = "see the layouts of lidar2camera in OpenCalib"


@dataclass(frozen=True)
class OpenCalib:
    """Pairs below a folder, in any of the layouts.

    Args:
        source: The folder, with a calibration in it or in folders below.
    """

    source: Path
    format: ClassVar[str] = "opencalib"

    def recordings(self) -> dict[str, Callable[[], Published]]:
        """See `published.Importer`."""
        found: dict[str, Callable[[], Published]] = {}
        for name, pairs in self._walk(self.source):
            if name in found:
                raise SourceError(
                    f"{self.source}: two calibrations would be scenario {name!r}",
                    "rename a folder, or import them one by one",
                )
            found[name] = pairs
        if not found:
            raise SourceError(
                f"{self.source}: no calibration of OpenCalib in it or below",
                "it is *-intrinsic.json and *-extrinsic.json, calib.txt, or a JSON file with cam_K "
                "and T_lidar_to_cam",
            )
        return found

    def _walk(self, folder: Path) -> Iterator[tuple[str, Callable[[], Published]]]:
        for path, names, _ in os.walk(folder):
            names[:] = sorted(n for n in names if n[0] != "." and n != files.MASKS)
            here = Path(path)
            below = here.relative_to(folder).parts
            name = "_".join(below) if below else scenario_of(folder)
            described = files.files_in(here, (".json",))
            if any(file.name.endswith("-extrinsic.json") for file in described):
                yield name, partial(_sensor_files, here, name)
            elif (here / "calib.txt").is_file():
                yield name, partial(_calib_txt, here, name)
            else:
                configured = [file for file in described if _is_configuration(file)]
                for file in configured:
                    own = name if len(configured) == 1 else f"{name}_{file.stem}"
                    yield own, partial(_configuration, file, own)


def _sensor_files(folder: Path, name: str) -> Published:
    """`*-intrinsic.json` and `*-to-*-extrinsic.json` of OpenCalib's tools."""
    described = files.files_in(folder, (".json",))
    extrinsics = [file for file in described if file.name.endswith("-extrinsic.json")]
    intrinsics = [file for file in described if file.name.endswith("-intrinsic.json")]
    if len(extrinsics) != 1 or len(intrinsics) != 1:
        raise SourceError(
            f"{folder}: {len(intrinsics)} *-intrinsic.json and {len(extrinsics)} *-extrinsic.json",
            "it must be one each: put every camera's into a folder of its own",
        )
    of_camera, of_pair = (_sensor(file) for file in (intrinsics[0], extrinsics[0]))
    target, sensor = of_pair.get("target_sensor_name"), of_camera.get("sensor_name")
    if target and sensor and target != sensor:
        raise SourceError(
            f"{extrinsics[0]}: its target_sensor_name is {target!r}, the camera is {sensor!r}",
            "the extrinsic must map the LiDAR's points to this camera",
        )
    parameters = of_camera["param"]
    T = rigid(_data(of_pair["param"], "sensor_calib", extrinsics[0]), f"{extrinsics[0]}: data")
    K = intrinsics_of(_data(parameters, "cam_K", intrinsics[0]), f"{intrinsics[0]}: cam_K")
    D = np.ravel(_data(parameters, "cam_dist", intrinsics[0], optional=True))
    size = tuple(parameters.get(key) for key in ("img_dist_w", "img_dist_h"))
    named, images = _beside(folder)
    given = all(isinstance(value, int) and value > 0 for value in size)
    camera = camera_of(
        f"{intrinsics[0]}: cam_K",
        (int(size[0] or 0), int(size[1] or 0)) if given else files.common_size(images, folder),
        K,
        D.tolist(),
        size_given=given,
    )
    items, warnings = items_of(named, folder, T)
    lidar = str(of_pair.get("sensor_name") or "lidar")
    return Published(
        name,
        camera,
        items,
        image=str(sensor or "camera"),
        lidar=lidar,
        calibration=(intrinsics[0], extrinsics[0]),
        warnings=tuple(warnings),
    )


def _calib_txt(folder: Path, name: str) -> Published:
    """`calib.txt` of Calib-Anything: lines K, D, T, or P2, Tr as of KITTI's odometry."""
    path = folder / "calib.txt"
    found = read_calibration(path, REMEDY)
    K = next((key for key in found if key == "K" or key.startswith("P")), "K")
    T = next((key for key in found if key in ("T", "Tr")), "T")
    for key in (K, T):
        if key not in found:
            raise SourceError(f"{path}: no {key} in it (there are {', '.join(found)})", REMEDY)
    intrinsics, T_camera_reference = _split(found[K], f"{path}: {K}")
    named, images = _beside(folder)
    camera = camera_of(
        f"{path}: {K}", files.common_size(images, folder), intrinsics, found.get("D", np.empty(0))
    )
    items, warnings = items_of(named, folder, T_camera_reference @ rigid(found[T], f"{path}: {T}"))
    return Published(name, camera, items, "camera", "lidar", (path,), tuple(warnings))


def _configuration(path: Path, name: str) -> Published:
    """A configuration of Calib-Anything."""
    content = read_json(path)
    intrinsics, T_camera_reference = _split(_data(content, "cam_K", path), f"{path}: cam_K")
    known = content.get("T_lidar_to_cam_gt")
    known = bool(isinstance(known, dict) and known.get("available"))
    key = "T_lidar_to_cam_gt" if known else "T_lidar_to_cam"
    T = T_camera_reference @ rigid(_data(content, key, path), f"{path}: {key}")
    D = np.ravel(_data(content, "cam_dist", path, optional=True))
    below = {}
    for role, default in (("img_folder", "images"), ("pc_folder", "pc"), ("mask_folder", "masks")):
        below[role] = path.parent / str(content.get(role, default))
    images = files.files_in(below["img_folder"], (str(content.get("img_format", ".png")).lower(),))
    clouds = files.files_in(below["pc_folder"], (str(content.get("pc_format", ".pcd")).lower(),))
    wanted = content.get("file_name")
    if isinstance(wanted, list) and wanted:
        of_image, of_cloud = files.by_stem(images), files.by_stem(clouds)
        named = [(str(n), of_image.get(str(n)), of_cloud.get(str(n))) for n in wanted]
        if missing := [n for n, image, cloud in named if image is None and cloud is None]:
            raise SourceError(
                f"{path}: neither image nor cloud of {', '.join(missing[:4])} in "
                f"{below['img_folder']} and {below['pc_folder']}",
                "correct file_name, img_folder and pc_folder",
            )
    else:
        named = pair_up(images, clouds, path.parent)
    camera = camera_of(
        f"{path}: cam_K", files.common_size(images, below["img_folder"]), intrinsics, D.tolist()
    )
    items, warnings = items_of(named, path.parent, T, masks=below["mask_folder"])
    if not known:
        warnings.append(
            f"{path}: no ground truth (T_lidar_to_cam_gt): the extrinsic is the one that its "
            "publisher starts from"
        )
    return Published(name, camera, items, "camera", "lidar", (path,), tuple(warnings))


def _split(K: Any, what: str) -> tuple[tuple[float, float, float, float], Array]:
    """Intrinsics, and 4x4 of what K has beside them: 3x3, or a projection matrix."""
    values = numbers(K, what)
    if values.size == 12:
        return split_projection(values, what)
    return intrinsics_of(values, what), np.eye(4)


def _beside(folder: Path) -> tuple[list[tuple[str, Path | None, Path | None]], list[Path]]:
    """Pairs of images and clouds in a folder, and the images."""
    images = files.without_masks(files.files_in(folder, files.IMAGES))
    return pair_up(images, files.files_in(folder, files.CLOUDS), folder), images


def _is_configuration(path: Path) -> bool:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and {"cam_K", "T_lidar_to_cam"} <= content.keys()


def _sensor(path: Path) -> dict[str, Any]:
    """The only entry of a sensor's file, with its `param`."""
    content = read_json(path)
    entries = list(content.values()) if isinstance(content, dict) else []
    if len(entries) != 1 or not isinstance(entries[0], dict):
        raise SourceError(f"{path}: holds no single sensor", REMEDY)
    if not isinstance(entries[0].get("param"), dict):
        raise SourceError(f"{path}: no param in it", REMEDY)
    return dict(entries[0])


def _data(section: Any, key: str, path: Path, *, optional: bool = False) -> Array:
    """Numbers of a matrix: {"rows": .., "cols": .., "data": [..]}."""
    matrix = section.get(key) if isinstance(section, dict) else None
    if matrix is None and optional:
        return np.empty(0)
    if not isinstance(matrix, dict) or "data" not in matrix:
        raise SourceError(f"{path}: no {key} with data in it", REMEDY)
    return numbers(matrix["data"], f"{path}: {key}")
