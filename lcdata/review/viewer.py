"""Showing a review: in Rerun's viewer, or in a browser."""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from lcdata.errors import ReportError

GRPC_PORT, WEB_PORT = 9876, 9090
LOCAL = "127.0.0.1"
SERVER_MEMORY = "75%"
"""A browser fetches the recording from a server, which drops what this cannot hold."""


def open_viewer(path: Path) -> None:
    """Open a review in Rerun's viewer and wait until it is closed.

    Raises:
        ReportError: No such file, no display, or a viewer that cannot start.
    """
    check_display(f"{path} cannot be shown")
    _run([viewer_command(), str(_existing(path))])


def check_display(what: str) -> None:
    """Refuse to open a window where there is no display.

    Raises:
        ReportError: There is none.
    """
    if sys.platform == "linux" and not (
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    ):
        raise ReportError(
            f"{what}: this machine has no display",
            "use --serve to show it in a browser, or open a file elsewhere with `rerun FILE`",
        )


def serve(path: Path, *, port: int = WEB_PORT, open_browser: bool = True) -> None:
    """Serve a review to a browser of this machine until it is interrupted.

    Args:
        path: The review.
        port: Where the browser finds the viewer; another one is taken if it is in use.
        open_browser: Whether to open a browser, too.

    Raises:
        ReportError: No such file, or a server that cannot start.
    """
    path = _existing(path)
    web, grpc = _free_port(port), _free_port(GRPC_PORT)
    print(viewer_url(web=web, grpc=grpc), flush=True)
    _run(serve_command(path, web=web, grpc=grpc, open_browser=open_browser))


def serve_command(path: Path, *, web: int, grpc: int, open_browser: bool) -> list[str]:
    """Command that serves a review on two ports of this machine, and to no other machine."""
    ports = ["--bind", LOCAL, "--port", str(grpc), "--web-viewer-port", str(web)]
    show = "--web-viewer" if open_browser else "--serve-web"
    return [viewer_command(), str(path), show, *ports, "--server-memory-limit", SERVER_MEMORY]


def live_command(*, in_browser: bool, port: int | None = None) -> tuple[list[str], int, int]:
    """Command of a viewer, or server for a browser, that waits for a recording.

    Returns:
        The command, the port that it listens at, and the port of the browser's page.
    """
    web, grpc = _free_port(port or WEB_PORT), _free_port(GRPC_PORT)
    ports = ["--bind", LOCAL, "--port", str(grpc)]
    command = [viewer_command(), *ports, "--server-memory-limit", SERVER_MEMORY]
    if in_browser:
        command += ["--serve-web", "--web-viewer-port", str(web)]
    return command, grpc, web


def viewer_url(*, web: int, grpc: int) -> str:
    """Address of the viewer's page that shows what a server of this machine has."""
    return f"http://{LOCAL}:{web}/?url=rerun%2Bhttp%3A%2F%2F{LOCAL}%3A{grpc}%2Fproxy"


def viewer_command() -> str:
    """Path of Rerun's own executable, which its Python package brings.

    Not the script `rerun` beside Python: that one starts the executable as a child, which would
    go on serving when the script is ended.

    Raises:
        ReportError: It is not there.
    """
    package = importlib.util.find_spec("rerun_cli")
    folder = Path(package.origin).parent if package and package.origin else Path()
    for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun"):
        if package and (folder / name).is_file():
            return str(folder / name)
    raise ReportError("Rerun's viewer is not there", "pip install --force-reinstall rerun-sdk")


def _run(command: Sequence[str]) -> None:
    process = subprocess.Popen(command)
    try:
        code = process.wait()
    except KeyboardInterrupt:  # the way to end it
        process.terminate()
        process.wait()
        return
    if code:
        raise ReportError(
            f"Rerun's viewer ended with code {code}", "its messages above say what it lacks"
        )


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise ReportError(f"no file {path}", "`lcdata review DATASET --save FILE.rrd` writes one")
    return path.resolve()


def _free_port(preferred: int) -> int:
    """The preferred port if nothing listens on it, else any free one."""
    for port in (preferred, 0):
        with socket.socket() as probe:
            try:
                probe.bind((LOCAL, port))
            except OSError:
                continue
            return int(probe.getsockname()[1])
    raise ReportError("no free network port", "close a program that serves one")
