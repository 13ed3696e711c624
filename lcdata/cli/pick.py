"""lcdata pick."""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from lcdata.cli.common import DatasetPath, JsonFlag, guarded, print_json
from lcdata.errors import CalibrationError

EXAMPLE = "lcdata pick dataset gym/pose_000/000"


@guarded
def pick(
    dataset: DatasetPath,
    pair: Annotated[
        str, typer.Argument(help="Which pair: <scenario>/pose_000/000.", show_default=False)
    ],
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port on this machine; 0: any free one.")
    ] = 0,
    no_browser: Annotated[
        bool, typer.Option("--no-browser", help="Print the address, open no browser.")
    ] = False,
    as_json: JsonFlag = False,
) -> None:
    """Pick matches of image and LiDAR by hand, in a browser: an initial guess from nothing.

    The page is for this machine only. `lcdata calibrate --init picks` starts from what it saves.
    """
    import webbrowser
    from threading import Thread

    from lcdata.dataset import Dataset
    from lcdata.pick import PickServer, Session

    session = Session(Dataset.open(dataset), pair)
    with PickServer(session, port) as server:
        typer.echo(f"{server.url}  (Ctrl-C or Done ends it)", err=True)
        if not no_browser and _has_screen():
            # In a thread of its own: some browsers return when they are closed.
            Thread(target=webbrowser.open, args=(server.url,), daemon=True).start()
        server.serve()
    if session.saved is None or session.pose is None:
        raise CalibrationError(f"{pair}: nothing was saved", "click Save before Done")
    pose = session.pose
    if as_json:
        print_json(
            {
                "picks": session.saved,
                "T_camera_lidar": pose.T_camera_lidar,
                "residuals_px": pose.residuals_px,
                "warnings": list(pose.warnings),
            }
        )
        return
    print(f"{session.saved}: {len(pose.residuals_px)} matches, {pose.rms_px:.1f} px")
    for warning in pose.warnings:
        typer.echo(f"lcdata: note: {warning}", err=True)


def _has_screen() -> bool:
    """Whether a browser would show itself, and not take the terminal, as text browsers do."""
    if sys.platform in ("darwin", "win32"):
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
