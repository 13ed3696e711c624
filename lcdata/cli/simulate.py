"""lcdata simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from lcdata.cli.common import JsonFlag, guarded, names, print_json, progress_bar

EXAMPLE = "lcdata simulate recordings --scenario gym --poses 5 --pairs 2 --seed 1 --format mcap"


@guarded
def simulate(
    out: Annotated[Path, typer.Argument(help="Folder to write into.", show_default=False)],
    scenario: Annotated[
        str, typer.Option(help="parking_lot, gym, yard, or several with commas.")
    ] = "gym",
    poses: Annotated[int, typer.Option(min=1, help="Arm poses (dwells).")] = 5,
    pairs: Annotated[int, typer.Option(min=1, help="LiDAR-camera pairs a pose.")] = 2,
    seed: Annotated[int, typer.Option(min=0, help="Same seed, same recording.")] = 0,
    format: Annotated[str, typer.Option(help="ros1, mcap or sqlite3.")] = "mcap",
    columns: Annotated[int, typer.Option(help="LiDAR columns: 512, 1024 or 2048.")] = 2048,
    azimuth_window: Annotated[
        float | None,
        typer.Option(help="LiDAR field of view ahead in deg; default: all around."),
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

    with progress_bar(quiet=as_json) as progress:
        written = write_recording(
            out,
            scenario=names(scenario),
            poses=poses,
            pairs=pairs,
            seed=seed,
            format=format,
            columns=columns,
            azimuth_window_deg=azimuth_window,
            rig=rig,
            motion_hz=motion_hz,
            clock_offset_s=clock_offset,
            force=force,
            progress=progress,
        )
    if as_json:
        print_json({"recordings": written, "rig": out / "rig.yaml", "truth": out / "truth.json"})
    else:
        for path in written:
            print(f"{path} (simulated)")
