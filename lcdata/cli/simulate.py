"""lcdata simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from lcdata.cli.common import JsonFlag, guarded, names, print_json, progress_bar
from lcdata.errors import SimulationError

EXAMPLE = "lcdata simulate recordings --scenario gym --poses 5 --pairs 2 --seed 1 --format mcap"


@guarded
def simulate(
    out: Annotated[Path, typer.Argument(help="Folder to write into.", show_default=False)],
    scenario: Annotated[
        str, typer.Option(help="parking_lot, gym, yard, road, or several with commas.")
    ] = "gym",
    poses: Annotated[int, typer.Option(min=1, help="Arm poses (dwells).")] = 5,
    pairs: Annotated[int, typer.Option(min=1, help="LiDAR-camera pairs a pose.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same recording.")] = 0,
    format: Annotated[str, typer.Option(help="ros1, mcap or sqlite3.")] = "mcap",
    lidar: Annotated[str, typer.Option(help="os1_128, os1_64, avia or pandar_64.")] = "os1_128",
    columns: Annotated[
        int | None,
        typer.Option(help="Columns of a spinning LiDAR: 512, 1024 or 2048; default: its usual."),
    ] = None,
    azimuth_window: Annotated[
        float | None,
        typer.Option(help="LiDAR field of view ahead in deg; default: all around."),
    ] = None,
    livox_message: Annotated[
        str, typer.Option(help="What an avia's driver publishes: custom or pointcloud2.")
    ] = "custom",
    camera: Annotated[
        str, typer.Option(help="zed2i, fisheye, atan, omni or equirectangular.")
    ] = "zed2i",
    moving: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            show_default=False,
            help="No arm: a hand moves LiDAR and camera together for so many seconds.",
        ),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="Hand-measured rig to simulate; default: a built-in one.")
    ] = None,
    motion_hz: Annotated[
        float, typer.Option(min=0, max=15, help="Images a second while the arm moves.")
    ] = 0.0,
    clock_offset: Annotated[
        float, typer.Option(help="Seconds that the arm's clock is ahead of the others.")
    ] = 0.0,
    force: Annotated[bool, typer.Option("--force", help="Replace a recording.")] = False,
    as_json: JsonFlag = False,
) -> None:
    """Write a simulated recording, its rig.yaml and its truth.json."""
    from lcdata.simulation import simulate as write_recording
    from lcdata.simulation import simulate_hand_held

    if moving is not None and (rig or azimuth_window or motion_hz or clock_offset):
        raise SimulationError(
            "--moving is without an arm and with a rig of its own",
            "leave out --rig, --azimuth-window, --motion-hz and --clock-offset",
        )
    with progress_bar(quiet=as_json) as progress:
        both: dict[str, Any] = {
            "scenario": names(scenario),
            "seed": seed,
            "format": format,
            "lidar": lidar,
            "columns": columns,
            "livox_message": livox_message,
            "camera": camera,
            "force": force,
            "progress": progress,
        }
        if moving is not None:
            written = simulate_hand_held(out, seconds=moving, **both)
        else:
            written = write_recording(
                out,
                poses=poses,
                pairs=pairs,
                azimuth_window_deg=azimuth_window,
                rig=rig,
                motion_hz=motion_hz,
                clock_offset_s=clock_offset,
                **both,
            )
    if as_json:
        print_json({"recordings": written, "rig": out / "rig.yaml", "truth": out / "truth.json"})
    else:
        for path in written:
            print(f"{path} (simulated)")
