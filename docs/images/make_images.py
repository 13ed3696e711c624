"""Makes the README's pictures from a data set of the sample recordings.

    lcdata build recordings/ && python docs/images/make_images.py dataset

The picture of the review needs a graphics driver (on a machine without one: mesa-vulkan-drivers).
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import cv2
import numpy as np
from rerun.experimental import ViewerClient

from lcdata.dataset import Dataset
from lcdata.evaluation import read_results
from lcdata.report import draw_overlay
from lcdata.review.viewer import viewer_command

HERE = Path(__file__).parent
PAIR = "yard/pose_001/000"
WIDTH = 640


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
    with ViewerClient.spawn(
        headless=True, port=9931, hide_welcome_screen=True, executable_path=viewer_command()
    ) as viewer:
        viewer.open(f"file://{(dataset.path / 'review.rrd').resolve()}")
        time.sleep(4)
        viewer.set_time("pair", sequence=number, play_state="paused")
        time.sleep(4)
        png = np.frombuffer(viewer.take_screenshot(), np.uint8)
    picture = cv2.resize(cv2.imdecode(png, 1), (1600, 900), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(HERE / "review.jpg"), picture, [cv2.IMWRITE_JPEG_QUALITY, 88])


if __name__ == "__main__":
    opened = Dataset.open(Path(sys.argv[1]))
    overlay(opened)
    review(opened)
