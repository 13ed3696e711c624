"""Where a live review goes: Rerun's viewer, a browser, a file."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcdata.dataset.atomic import write_atomically
from lcdata.errors import ReportError
from lcdata.review.save import check_whole, new_recording, recorded
from lcdata.review.viewer import check_display, live_command, viewer_url

if TYPE_CHECKING:
    import rerun as rr

FLUSH_S = 10.0
END_S = 5.0

Recorder = Callable[[], AbstractContextManager["rr.RecordingStream"]]


def into_file(name: str, path: Path) -> Recorder:
    """Recordings that are written to a file, which is there once they end."""

    @contextmanager
    def recorder() -> Iterator[rr.RecordingStream]:
        with write_atomically(path) as temporary, recorded(temporary, name) as recording:
            yield recording

    return recorder


@contextmanager
def hosted(
    name: str, path: Path | None, *, in_browser: bool, port: int | None = None
) -> Iterator[tuple[Recorder, Callable[[], bool]]]:
    """A viewer, or a server for a browser, that is ended when it is left.

    Args:
        name: Of the recordings.
        path: File to write as well; None for none.
        in_browser: Serve to a browser of this machine, to no other machine.
        port: Where the browser finds the viewer; None for the usual one.

    Yields:
        What makes recordings, and what tells whether a reader has closed the viewer.

    Raises:
        ReportError: No display, or a viewer that is not there or ends with an error.
    """
    if not in_browser:
        check_display("--live cannot open a viewer")
    command, grpc, web = live_command(in_browser=in_browser, port=port)
    # A session of its own: Ctrl-C is for this process, which has something left to send.
    process = subprocess.Popen(command, start_new_session=True)
    if in_browser:
        print(viewer_url(web=web, grpc=grpc), flush=True)
    address = f"rerun+http://127.0.0.1:{grpc}/proxy"

    def gone() -> bool:
        return process.poll() is not None

    @contextmanager
    def recorder() -> Iterator[rr.RecordingStream]:
        if path is None:
            with _streamed(name, address, None, gone) as recording:
                yield recording
            return
        with (
            write_atomically(path) as temporary,
            _streamed(name, address, temporary, gone) as recording,
        ):
            yield recording

    try:
        yield recorder, gone
        if code := process.poll():
            raise ReportError(
                f"Rerun's viewer ended with code {code}", "its messages above say what it lacks"
            )
    finally:
        process.terminate()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def _streamed(
    name: str, address: str, path: Path | None, gone: Callable[[], bool]
) -> Iterator[rr.RecordingStream]:
    """A recording that goes to a viewer or server, and to a file if there is one.

    It ends quietly when the viewer is gone: a reader has closed it, and the file is kept.
    """
    import rerun as rr

    recording = new_recording(name, recording_id=f"{name}-{time.time_ns()}")
    sinks: list[Any] = [rr.GrpcSink(address)]
    if path is not None:
        sinks.append(rr.FileSink(path))
    try:
        recording.set_sinks(*sinks)
        recording.send_recording_name(name)
        yield recording
        recording.flush(timeout_sec=FLUSH_S)
        recording.disconnect()
        if path is not None:
            check_whole(path)
    except (RuntimeError, ValueError) as error:
        recording.disconnect()
        if gone():
            if path is not None:
                check_whole(path)
            return
        raise ReportError(
            f"the viewer at {address} does not take what it is sent ({error})",
            "it may have been closed",
        ) from error
    finally:
        recording.disconnect()
