"""Road scenes for CRLF's experiments: simulated ones with exact masks, and real ones.

The paper's frames are not published. Its cameras are: KITTI's, of 1242x375 pixels, and one of
1920x1200; both are put on the simulated car, below a 64-beam LiDAR that reports reflectivity.
Real frames are read from a folder with `opencalib_crossing/` and `kitti_road/`, each with images,
clouds and `reference.json` (K, D, T_camera_lidar); a `mask.jpg` beside them is used.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import lcdata
from lcdata.errors import CalibrationError, LcdataError
from lcdata.features.mask_files import read_mask
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.pair import Pair

Mask = NDArray[np.bool_]

FORTH = Path("shared") / "data"
"""Where real frames are looked for, beside the checkout."""


@dataclass(frozen=True)
class Source:
    """Where frames come from.

    Args:
        name: As it is typed.
        title: As tables call it.
        paper: Data set of the paper that it is set beside.
        camera: Of the simulated car; None for real frames.
        folder: Name of the real frames' folder; "" for simulated ones.
    """

    name: str
    title: str
    paper: str
    camera: Camera | None = None
    folder: str = ""


SOURCES = (
    Source(
        "sim-kitti",
        "simulated, KITTI's camera",
        "KITTI",
        Camera("pinhole", 1241, 376, (718.9, 718.9, 607.2, 185.2)),
    ),
    Source(
        "sim-1200",
        "simulated, 1920x1200",
        "Ours",
        Camera(
            "pinhole", 1920, 1200, (2100.0, 2100.0, 931.0, 611.0), (-0.1, 0.05, 4e-4, -8e-4, 0.0)
        ),
    ),
    Source("kitti", "kitti_road", "KITTI", folder="kitti_road"),
    Source("crossing", "opencalib_crossing", "Ours", folder="opencalib_crossing"),
)


@dataclass(frozen=True, eq=False)
class Frame:
    """A pair and what is known of its image.

    Args:
        pair: With its true, or reference, extrinsic.
        lane: (H, W) mask of the lanes; of lanes and poles, if there is no mask of the poles.
        pole: (H, W) mask of the poles.
    """

    pair: Pair
    lane: Mask | None = None
    pole: Mask | None = None


def source_of(name: str) -> Source:
    """A source by its name.

    Raises:
        CalibrationError: There is none.
    """
    for source in SOURCES:
        if source.name == name:
            return source
    known = ", ".join(source.name for source in SOURCES)
    raise CalibrationError(f"unknown source {name!r}", f"choose from {known}")


def beside_the_checkout() -> Path:
    """Folder in which real frames would be."""
    return Path(lcdata.__file__).parents[2] / FORTH


def count(source: Source, runs: int, data: Path) -> int:
    """How many frames of a source there are: `runs` simulated ones, or those in the folder."""
    if source.camera is not None:
        return runs
    return len(_clouds(data / source.folder))


def frame(source: Source, number: int, seed: int, data: Path) -> Frame:
    """One frame.

    Args:
        source: Where from.
        number: Of the frame: another place of the simulated car, or the next file.
        seed: Of the simulated car and its road.
        data: Folder of the real frames' folders.

    Raises:
        CalibrationError: Real frames that cannot be read.
    """
    if source.camera is None:
        return _real(data / source.folder, number)
    from lcdata.simulation import render_pair, semantic_masks

    camera = source.camera
    pair = render_pair("road", pose_index=number, seed=seed, lidar="pandar_64", camera=camera)
    masks = semantic_masks("road", pose_index=number, seed=seed, camera=camera)
    return Frame(pair, masks.lane, masks.pole)


def _clouds(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.pcd"))


def _real(folder: Path, number: int) -> Frame:
    import cv2

    from lcdata.recording import fields
    from lcdata.recording.cloud_files import read_cloud

    path = _clouds(folder)[number]
    try:
        reference = json.loads((folder / "reference.json").read_text())
        stored = np.frombuffer(path.with_suffix(".png").read_bytes(), np.uint8)
        image = np.asarray(cv2.imdecode(stored, cv2.IMREAD_COLOR), np.uint8)[:, :, ::-1].copy()
        lens = tuple(reference["D"]) if any(reference["D"]) else ()
        size = image.shape[1], image.shape[0]
        camera = Camera("pinhole", *size, tuple(reference["K"]), lens)
        T = se3.check_transform(reference["T_camera_lidar"])
        records = read_cloud(path).records
    except (OSError, ValueError, KeyError, TypeError, LcdataError) as error:
        raise CalibrationError(
            f"{folder}: frame {path.stem} cannot be read ({error})",
            "it needs NAME.pcd, NAME.png and reference.json with K, D and T_camera_lidar",
        ) from error
    name = fields.intensity_name(records.dtype)
    pair = Pair(
        image,
        fields.points(records),
        None if name is None else records[name].astype(np.float32),
        camera,
        pair_id=f"{folder.name}/{path.stem}",
        T_camera_lidar=T,
    )
    if not (folder / "mask.jpg").exists():
        return Frame(pair)
    return Frame(pair, read_mask(folder / "mask.jpg", image.shape[:2]) > 0)
