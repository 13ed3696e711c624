"""Makes the README's pictures from a data set of the sample recordings.

    lcdata build recordings/ && python docs/images/make_images.py dataset

and that of one pair from a simulated one, of a LiDAR whose scans are merged:

    lcdata simulate avia --lidar avia --scenario gym --poses 1 --pairs 15 --seed 5
    echo "integration: static" >> avia/rig.yaml
    lcdata build avia -o dense --methods nid --init-rotation 1 --init-translation 0.1
    python docs/images/make_images.py dataset dense

The pictures of reviews need a graphics driver (on a machine without one: mesa-vulkan-drivers),
those of pages need Chromium.
"""

from __future__ import annotations

import json
import sys
import tempfile
import threading
import time
from pathlib import Path

import cv2
import numpy as np
from rerun.experimental import ViewerClient

from lcdata.dataset import Dataset
from lcdata.evaluation import read_results
from lcdata.geometry import se3
from lcdata.pick import PickServer, Session
from lcdata.report import draw_overlay
from lcdata.review import Selection, Wanted, save_review
from lcdata.review.one_pair import save_pair_review
from lcdata.review.viewer import viewer_command

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "pick"))

from chromium import Browser  # noqa: E402

PAIR = "yard/pose_001/000"
WIDTH = 640

PICKED = "gym/pose_000/000"
PLACES = ((413, 444), (523, 491), (482, 549), (394, 552), (217, 412), (560, 520), (122, 644))
"""Pixels of the LiDAR's picture: corners of a scoreboard, a basket, a box, a window, a line."""


def overlay(dataset: Dataset) -> None:
    """The cloud on the image at the initial guess, the estimate and the ground truth."""
    trial = next(
        t
        for t in read_results(dataset).trials
        if t.pair_ids == (PAIR,) and t.method == "projection"
    )
    pair = dataset.load(PAIR)
    poses = (trial.T_camera_lidar_initial, trial.T_camera_lidar_estimated, pair.T_camera_lidar)
    panels = [draw_overlay(pair, T, width=WIDTH) for T in poses]
    gap = np.full((panels[0].shape[0], 8, 3), 255, np.uint8)
    picture = np.hstack([panels[0], gap, panels[1], gap, panels[2]])
    cv2.imwrite(
        str(HERE / "overlay.jpg"),
        cv2.cvtColor(picture, cv2.COLOR_RGB2BGR),
        [cv2.IMWRITE_JPEG_QUALITY, 88],
    )


def review(dataset: Dataset) -> None:
    """The review in Rerun's viewer at the same pair."""
    number = [p.pair_id for p in dataset.pairs].index(PAIR)
    viewer_picture(dataset.path / "review.rrd", "pair", number, HERE / "review.jpg")


def compared(dataset: Dataset) -> None:
    """Two methods of a run on one timeline, at the same pair."""
    number = [p.pair_id for p in dataset.pairs].index(PAIR)
    wanted = Wanted(Selection(methods=("projection",)), compare="plk")
    with tempfile.TemporaryDirectory() as folder:
        path = save_review(dataset, Path(folder) / "compared.rrd", wanted=wanted).path
        viewer_picture(path, "pair", number, HERE / "review-compare.jpg")


def review_pair(dataset: Dataset) -> None:
    """The review of one pair, blended half and half."""
    with tempfile.TemporaryDirectory() as folder:
        pair_id = dataset.pairs[0].pair_id
        path, _ = save_pair_review(dataset, pair_id, Path(folder) / "pair.rrd", method="nid")
        viewer_picture(path, "blend", 50, HERE / "review-pair.jpg", quality=80)


def viewer_picture(path: Path, timeline: str, time_: int, out: Path, quality: int = 88) -> None:
    """What Rerun's viewer shows of a recording at a time."""
    with ViewerClient.spawn(
        headless=True, port=9931, hide_welcome_screen=True, executable_path=viewer_command()
    ) as viewer:
        viewer.open(f"file://{path.resolve()}")
        time.sleep(4)
        viewer.set_time(timeline, sequence=time_, play_state="paused")
        time.sleep(4)
        png = np.frombuffer(viewer.take_screenshot(), np.uint8)
    picture = cv2.resize(cv2.imdecode(png, 1), (1600, 900), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(out), picture, [cv2.IMWRITE_JPEG_QUALITY, quality])


def pick(dataset: Dataset) -> None:
    """The page for picking matches, with a few that are about a pixel off."""
    session, pair = Session(dataset, PICKED), dataset.load(PICKED)
    rng = np.random.default_rng(0)
    matches = []
    for place in PLACES:
        found = session.point(*place)
        seen = pair.camera.project(se3.apply(pair.T_camera_lidar, [found["point"]]))[0][0]
        camera = (seen + rng.normal(0, 1, 2)).tolist()
        matches.append({"camera": camera, "lidar": found["at"], "point": found["point"]})
    with tempfile.TemporaryDirectory() as profile, PickServer(session) as server:
        thread = threading.Thread(target=server.serve, daemon=True)
        thread.start()
        with Browser(Path(profile), 1440, 800) as browser:
            browser.open(server.url)
            browser.value(f"matches = {json.dumps(matches)}; changed(); 1")
            browser.until("!$('save').disabled")
            browser.picture(Path(profile) / "page.png")
            picture = cv2.imread(str(Path(profile) / "page.png"))
        server.stop()
        thread.join()
    cv2.imwrite(str(HERE / "pick.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 88])


def report(dataset: Dataset) -> None:
    """The report's page: its beginning, and worst trials beside it."""
    tall = 1350
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile,
        Browser(Path(profile), 1200, tall) as browser,
    ):
        browser.theme("light")
        browser.call("Page.navigate", url=(dataset.path / "report/index.html").resolve().as_uri())
        browser.until("document.querySelector('.beside') && document.readyState === 'complete'")
        browser.value("document.querySelectorAll('img').forEach((i) => { i.loading = 'eager'; })")
        browser.until("[...document.images].every((image) => image.complete)")
        parts = []
        for place in ("document.querySelector('.kind')", "document.querySelector('.beside')"):
            browser.value(f"scrollTo(0, {place}.getBoundingClientRect().y + scrollY - 2)")
            browser.picture(Path(profile) / "page.png")
            parts.append(cv2.imread(str(Path(profile) / "page.png")))
    gap = np.full((tall, 40, 3), 255, np.uint8)
    picture = cv2.resize(np.hstack([parts[0], gap, parts[1]]), (1720, 952), None, 0, 0, 3)
    cv2.imwrite(str(HERE / "report.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 82])


if __name__ == "__main__":
    opened = Dataset.open(Path(sys.argv[1]))
    pick(opened)
    report(opened)
    overlay(opened)
    review(opened)
    compared(opened)
    if len(sys.argv) > 2:
        review_pair(Dataset.open(Path(sys.argv[2])))
