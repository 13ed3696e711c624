"""What the frame around an image says: how wrong the extrinsic is, in words and colour."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation import metrics
from lcdata.review import colours, names
from lcdata.review.text import error_text, uncertainty_text
from lcdata.review.trials import OUTCOME_COLOURS, outcome

if TYPE_CHECKING:
    from lcdata.evaluation.results import TrialResult
    from lcdata.pair import Pair

FRAME_PX = 4.0
SHARE = 0.07
"""Height of a banner as a share of the image's."""


def verdict(source: str, pair: Pair, shown: dict[str, TrialResult]) -> tuple[str, colours.RGB]:
    """What the frame around an image says, and its colour.

    Args:
        source: A method, or one of the two constants.
        pair: The pair.
        shown: The shown trial of each method.
    """
    if source == names.GROUND_TRUTH:
        assert pair.T_camera_lidar is not None
        sigma = metrics.groundtruth_sigma(pair.T_camera_lidar, pair.covariance)
        return uncertainty_text(sigma), colours.GREEN
    if source == names.INITIAL:
        if not shown:
            return "no results", colours.GREY
        first = next(iter(shown.values()))
        if first.T_camera_lidar_initial is None:
            return "no initial guess", colours.GREY
        errors = first.initial_rotation_error_deg, first.initial_translation_error_m
        return error_text(*errors), colours.GREY
    if source not in shown:
        return "no results", colours.GREY
    trial = shown[source]
    text = outcome(trial)
    if not trial.failed:
        text = f"{text}: {error_text(trial.rotation_error_deg, trial.translation_error_m)}"
    return text, OUTCOME_COLOURS[outcome(trial)]


def framed(size: tuple[int, int], text: str, colour: colours.RGB) -> tuple[Any, ...]:
    """A frame around an image with a banner in its corner, as Rerun's archetypes.

    Args:
        size: Width and height of the image, pixels.
        text: Of the banner, ASCII.
        colour: Of the frame.
    """
    import rerun as rr

    return (
        rr.Boxes2D(
            mins=[[FRAME_PX / 2, FRAME_PX / 2]],
            sizes=[np.array(size) - FRAME_PX],
            colors=[colour],
            radii=rr.Radius.ui_points(2.0),
            draw_order=40.0,
        ),
        rr.Image(banner(text, size[1]), color_model="L", draw_order=50.0),
    )


def banner(text: str, image_height: int) -> NDArray[np.uint8]:
    """White text on a dark ground as a grey picture, (H, W).

    A picture, for the viewer's own labels fade on one of its two themes; and not an encoded
    one, for it takes those for frames of a video, whose size must not change.

    Args:
        text: ASCII, which is what OpenCV's font has.
        image_height: Height in pixels of the image that it goes on.
    """
    import cv2

    height = max(12, round(SHARE * image_height))
    font = cv2.FONT_HERSHEY_DUPLEX
    scale = cv2.getFontScaleFromHeight(font, max(6, round(0.5 * height)))
    pen = max(1, height // 24)
    width = cv2.getTextSize(text, font, scale, pen)[0][0] + height
    picture = np.full((height, width), 24, np.uint8)
    place = height // 2, round(0.76 * height)
    cv2.putText(picture, text, place, font, scale, 255, pen, cv2.LINE_AA)
    return picture
