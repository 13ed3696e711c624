"""lcdata import: published pairs become a data set. One command a format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from lcdata.cli.common import JsonFlag, counted, end_with, guarded, names, print_json, progress_bar

if TYPE_CHECKING:
    from lcdata.dataset.importers import Importer

app = typer.Typer(
    name="import",
    help="Make a data set of published pairs: KITTI, nuScenes, OpenCalib, any folder.",
    no_args_is_help=True,
    add_completion=False,
)

Out = Annotated[Path, typer.Option("--out", "-o", help="Folder of the data set.")]
Only = Annotated[str, typer.Option(help="Recordings to take by name, with commas; default: all.")]
Every = Annotated[int, typer.Option(min=1, help="Every so manieth pair of a recording.")]
Limit = Annotated[
    int | None, typer.Option(min=1, help="At most so many pairs of a scenario; default: all.")
]
SigmaRotation = Annotated[
    float | None,
    typer.Option(min=0, help="Standard deviation of the reference about each axis, deg."),
]
SigmaTranslation = Annotated[
    float | None,
    typer.Option(min=0, help="Standard deviation of the reference along each axis, m."),
]
Covariance = Annotated[
    Path | None,
    typer.Option(help="JSON with the 6x6 covariance of the reference (m, rad; camera frame)."),
]
Force = Annotated[bool, typer.Option("--force", help="Replace a data set of other pairs.")]
DEFAULT_OUT = Path("dataset")


def _source(help_text: str) -> Any:
    return typer.Argument(help=help_text, show_default=False)


@app.command("kitti-raw", epilog="Example:  lcdata import kitti-raw kitti/2011_09_26 -o kitti")
@guarded
def kitti_raw(
    source: Annotated[
        Path, _source("A drive (2011_09_26_drive_0001_sync), a date, or a folder of dates.")
    ],
    out: Out = DEFAULT_OUT,
    camera: Annotated[str, typer.Option(help="image_00 to image_03.")] = "image_02",
    only: Only = "",
    every: Every = 1,
    limit: Limit = None,
    sigma_rotation: SigmaRotation = None,
    sigma_translation: SigmaTranslation = None,
    covariance: Covariance = None,
    force: Force = False,
    as_json: JsonFlag = False,
) -> None:
    """Import drives of KITTI's raw data, synchronised or extracted."""
    from lcdata.dataset.importers import KittiRaw

    known = _covariance(sigma_rotation, sigma_translation, covariance)
    _run(KittiRaw(source, camera), out, (only, every, limit), known, force, as_json)


@app.command("kitti-odometry", epilog="Example:  lcdata import kitti-odometry dataset -o kitti")
@guarded
def kitti_odometry(
    source: Annotated[Path, _source("The folder with sequences/00, or one sequence.")],
    out: Out = DEFAULT_OUT,
    camera: Annotated[str, typer.Option(help="image_0 to image_3.")] = "image_2",
    only: Only = "",
    every: Every = 1,
    limit: Limit = None,
    sigma_rotation: SigmaRotation = None,
    sigma_translation: SigmaTranslation = None,
    covariance: Covariance = None,
    force: Force = False,
    as_json: JsonFlag = False,
) -> None:
    """Import sequences of KITTI's odometry benchmark."""
    from lcdata.dataset.importers import KittiOdometry

    known = _covariance(sigma_rotation, sigma_translation, covariance)
    _run(KittiOdometry(source, camera), out, (only, every, limit), known, force, as_json)


@app.command("nuscenes", epilog="Example:  lcdata import nuscenes v1.0-mini_data -o nuscenes")
@guarded
def nuscenes(
    source: Annotated[Path, _source("The folder with v1.0-mini (or the like) and samples.")],
    out: Out = DEFAULT_OUT,
    camera: Annotated[str, typer.Option(help="Channel of the camera.")] = "CAM_FRONT",
    version: Annotated[str, typer.Option(help="Folder of tables, if there are several.")] = "",
    only: Only = "",
    every: Every = 1,
    limit: Limit = None,
    sigma_rotation: SigmaRotation = None,
    sigma_translation: SigmaTranslation = None,
    covariance: Covariance = None,
    force: Force = False,
    as_json: JsonFlag = False,
) -> None:
    """Import key frames of nuScenes, LIDAR_TOP moved to the camera's time."""
    from lcdata.dataset.importers import NuScenes

    known = _covariance(sigma_rotation, sigma_translation, covariance)
    _run(NuScenes(source, camera, version), out, (only, every, limit), known, force, as_json)


@app.command("opencalib", epilog="Example:  lcdata import opencalib auto_calib/data -o crossing")
@guarded
def opencalib(
    source: Annotated[Path, _source("A folder of OpenCalib or Calib-Anything, or of several.")],
    out: Out = DEFAULT_OUT,
    only: Only = "",
    every: Every = 1,
    limit: Limit = None,
    sigma_rotation: SigmaRotation = None,
    sigma_translation: SigmaTranslation = None,
    covariance: Covariance = None,
    force: Force = False,
    as_json: JsonFlag = False,
) -> None:
    """Import pairs of OpenCalib (SensorsCalibration) and Calib-Anything, with their masks."""
    from lcdata.dataset.importers import OpenCalib

    known = _covariance(sigma_rotation, sigma_translation, covariance)
    _run(OpenCalib(source), out, (only, every, limit), known, force, as_json)


@app.command("folder", epilog="Example:  lcdata import folder ../shared/data/kitti_road -o kitti")
@guarded
def folder(
    source: Annotated[
        Path, _source("Images, clouds, one JSON with K, D, T_camera_lidar; or folders of such.")
    ],
    out: Out = DEFAULT_OUT,
    calibration: Annotated[
        Path | None, typer.Option(help="The JSON file; default: reference.json in SOURCE.")
    ] = None,
    by_order: Annotated[
        bool, typer.Option("--by-order", help="Pair by order, not by equal names.")
    ] = False,
    images: Annotated[
        str, typer.Option(help="Folder of the images in SOURCE, if there are several.")
    ] = "",
    clouds: Annotated[
        str, typer.Option(help="Folder of the clouds in SOURCE, if there are several.")
    ] = "",
    only: Only = "",
    every: Every = 1,
    limit: Limit = None,
    sigma_rotation: SigmaRotation = None,
    sigma_translation: SigmaTranslation = None,
    covariance: Covariance = None,
    force: Force = False,
    as_json: JsonFlag = False,
) -> None:
    """Import images (PNG, JPEG) and clouds (PCD, PLY, BIN, NPY) of any folder."""
    from lcdata.dataset.importers import Folder

    known = _covariance(sigma_rotation, sigma_translation, covariance)
    importer = Folder(source, calibration, by_order, images, clouds)
    _run(importer, out, (only, every, limit), known, force, as_json)


def _covariance(rotation_deg: float | None, translation_m: float | None, file: Path | None) -> Any:
    """6x6 covariance that the options say; None for unknown."""
    if file is not None and (rotation_deg, translation_m) == (None, None):
        from lcdata.dataset.importers.calibration import covariance_of, read_json

        content = read_json(file)
        values: Any = content.get("covariance") if isinstance(content, dict) else content
        return covariance_of(values, f"{file}: covariance")
    if file is not None:
        raise typer.BadParameter("give --covariance, or --sigma-rotation and --sigma-translation")
    if (rotation_deg is None) != (translation_m is None):
        raise typer.BadParameter("give both --sigma-rotation and --sigma-translation, or neither")
    if rotation_deg is None or translation_m is None:
        return None
    import numpy as np

    return np.diag([translation_m**2] * 3 + [np.deg2rad(rotation_deg) ** 2] * 3)


def _run(
    importer: Importer,
    out: Path,
    choice: tuple[str, int, int | None],
    covariance: Any,
    force: bool,
    as_json: bool,
) -> None:
    """Import and say what was."""
    from lcdata.dataset.importers import Choice, import_dataset

    only, every, limit = choice
    with progress_bar(quiet=as_json) as progress:
        made = import_dataset(
            importer,
            out,
            choice=Choice(tuple(names(only)), every, limit),
            covariance=covariance,
            force=force,
            progress=progress,
        )
    if as_json:
        print_json(
            {
                "dataset": out,
                "format": importer.format,
                "pairs": made.pairs,
                "poses": made.poses,
                "scenarios": list(made.dataset.scenarios),
                "masks": sum(source["masks"] for source in made.dataset.info.sources),
                "warnings": made.warnings,
                "failures": made.failures,
            }
        )
    else:
        print(f"{out}: {counted(made.pairs, 'pair')} of {counted(made.poses, 'extrinsic')}")
    for warning in made.warnings:
        typer.echo(f"lcdata: note: {warning}", err=True)
    end_with(made.failures)
