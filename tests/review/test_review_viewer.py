"""What the viewer itself says about a review."""

from __future__ import annotations

import socket
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import Popen
from typing import TYPE_CHECKING

import pytest
from box_room import CLEAN, RUN, add_results, make

from lcdata.evaluation.results import results_path, write_run
from lcdata.review import Wanted, save_review
from lcdata.review.live import Options, follow
from lcdata.review.live_viewer import into_file
from lcdata.review.one_pair import save_pair_review
from lcdata.review.viewer import serve_command, viewer_command

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

NO_DRIVER = "No graphics adapter was found"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_until(condition, seconds: float = 30.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "the viewer did not get there in time"
        time.sleep(0.2)


@contextmanager
def showing(path: Path, capfd: pytest.CaptureFixture[str]) -> Iterator[ViewerClient]:
    """A viewer that has loaded a file, without complaints when it is left."""
    from rerun.experimental import ViewerClient

    client = ViewerClient.spawn(
        headless=True,
        port=free_port(),
        hide_welcome_screen=True,
        executable_path=viewer_command(),
    )
    with client as viewer:
        try:
            viewer.open(f"file://{path}")
        except ConnectionError:
            if NO_DRIVER in capfd.readouterr().err:
                pytest.skip("no graphics driver (apt-get install mesa-vulkan-drivers)")
            raise
        wait_until(lambda: not viewer.get_state().loading)
        yield viewer
        logged = [entry for entry in viewer.get_logs() if entry.level in {"WARN", "ERROR"}]
        complaints = [e.message for e in logged if "Software rasterizer" not in e.message]
        assert not complaints


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["arm", "static", "no results", "two runs", "live"])
def test_no_view_reports_an_error_or_a_warning(tmp_path, capfd, kind):
    dataset = make(tmp_path / "set", arm=kind != "static", pairs=1)
    results = [] if kind == "no results" else add_results(dataset)
    path, wanted = tmp_path / "review.rrd", Wanted()
    if kind == "two runs":
        write_run(results_path(dataset, "other"), results)
        wanted = Wanted(compare=RUN)
    if kind == "live":
        stored = results_path(dataset, RUN)
        stored.unlink()
        looks = iter([lambda: write_run(stored, results[:2]), lambda: write_run(stored, results)])

        def ended() -> bool:
            look = next(looks, None)
            if look:
                look()
            return look is None

        follow(dataset, Options(wanted, poll_s=0.01), into_file("live", path), ended=ended)
    else:
        save_review(dataset, path, wanted=wanted)
    with showing(path, capfd) as viewer:
        for number, record in enumerate(dataset.pairs):
            viewer.set_time("pair", sequence=number, play_state="paused")
            assert viewer.take_screenshot()[:4] == b"\x89PNG"
            check(viewer.get_state(), number)
            viewer.set_time("stamp", timestamp=record.stamp_lidar_ns * 1e-9, play_state="paused")
            viewer.take_screenshot()
            check(viewer.get_state(), number)


@pytest.mark.slow
def test_the_blend_of_one_pair_shows_in_the_viewer(tmp_path, capfd):
    dataset = make(tmp_path / "set", arm=False, pairs=1, cameras={"lab": CLEAN})
    path, _ = save_pair_review(dataset, dataset.pairs[0].pair_id, tmp_path / "one.rrd")
    pictures = []
    with showing(path, capfd) as viewer:
        for percent in (0, 100):
            viewer.set_time("blend", sequence=percent, play_state="paused")
            viewer.take_screenshot()  # the first may still be of the time before
            pictures.append(viewer.take_screenshot())
        views = viewer.get_state().views
    assert pictures[0] != pictures[1]
    assert not {view.name: view.reports for view in views if view.reports}
    assert {view.name for view in views} == {
        "coloured: ground truth",
        "blended: ground truth",
        "NID landscape",
        "This pair",
    }


def check(state, number: int) -> None:
    complaints = {view.name: view.reports for view in state.views if view.reports}
    assert not complaints, f"pair {number}: {complaints}"
    classes = {view.view_class for view in state.views}
    assert {"3D", "2D", "TextDocument"} <= classes
    assert "ground truth" in {view.name for view in state.views}


@pytest.mark.slow
def test_a_browser_can_fetch_viewer_and_recording(tmp_path):
    dataset = make(tmp_path / "set", arm=False, pairs=1)
    path = save_review(dataset, tmp_path / "review.rrd").path
    web, grpc = free_port(), free_port()
    process = Popen(serve_command(path, web=web, grpc=grpc, open_browser=False))
    try:

        def answers() -> bool:
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{web}/", timeout=5) as page:
                    return b"rerun" in page.read().lower()
            except OSError:
                return False

        wait_until(answers)
        with socket.create_connection(("127.0.0.1", grpc), timeout=5):
            pass
    finally:
        process.terminate()
        process.wait(10)
