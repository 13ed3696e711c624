"""What the frame around an image says: how wrong the extrinsic is, in words and colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation import metrics
from lcdata.review import colours, names
from lcdata.review.text import error_text, uncertainty_text
from lcdata.review.trials import (
    NO_ESTIMATE,
    OUTCOME_COLOURS,
    RIGHT,
    RIGHT_FLAGGED,
    UNDECIDED,
    WRONG,
    WRONG_FLAGGED,
    outcome,
)

if TYPE_CHECKING:
    from lcdata.dataset.schema import PairRecord, PoseRecord
    from lcdata.evaluation.results import TrialResult
    from lcdata.pair import Pair
    from lcdata.review.shown import Shown

FRAME_PX = 4.0
SHARE = 0.07
"""Height of a banner's line as a share of the image's."""

WHITE: colours.RGB = (255, 255, 255)


Line = tuple[str, colours.RGB]
"""Words of a banner, and their colour."""

SEVERITY = (NO_ESTIMATE, WRONG, WRONG_FLAGGED, UNDECIDED, RIGHT_FLAGGED, RIGHT)
"""Outcomes, the worst first."""


def verdicts(shown: Shown, key: str, record: PairRecord) -> tuple[tuple[Line, ...], colours.RGB]:
    """What the frame around a view's image says, and its colour.

    Args:
        shown: What the review shows.
        key: Of the view.
        record: Row of the pair.

    Returns:
        Lines of words with their colours, and the frame's colour: of two that are compared that
        of the worse.
    """
    view = next(view for view in shown.views if view.key == key)
    trials = shown.trials.of_pair(record.pair_id)
    pose = shown.dataset.pose(record.pose_id)
    comparison = shown.comparison
    if len(view.sources) == 1 or comparison is None:
        (source,) = view.sources
        if source == names.FORMER and comparison is not None:
            former = comparison.former.get(record.pose_id)
            if former is None:
                return (("no such pose then", WHITE),), colours.GREY
            text, colour = verdict(names.GROUND_TRUTH, former, trials)
        else:
            text, colour = verdict(source, pose, trials)
        return ((text, WHITE),), colour
    if shown.of_truths:
        former = comparison.former.get(record.pose_id)
        if former is None:
            return (("no such pose in A", WHITE),), colours.GREY
        T_a, T_b = former.T_camera_lidar, pose.T_camera_lidar
        apart = metrics.rotation_error_deg(T_b, T_a), metrics.translation_error_m(T_b, T_a)
        text = f"A and B: {error_text(*apart)} apart"
        return ((text, WHITE),), colours.GREY
    lines, worst = [], len(SEVERITY)
    for side, colour, source in zip("AB", colours.SIDES, view.sources, strict=True):
        lines.append((f"{side} {verdict(source, pose, trials)[0]}", colour))
        if source in trials:
            worst = min(worst, SEVERITY.index(outcome(trials[source])))
    frame = OUTCOME_COLOURS[SEVERITY[worst]] if worst < len(SEVERITY) else colours.GREY
    return tuple(lines), frame


def verdict(
    source: str, pair: Pair | PoseRecord, shown: dict[str, TrialResult]
) -> tuple[str, colours.RGB]:
    """What the frame around an image says of one source, and its colour.

    Args:
        source: A method, or one of the two constants.
        pair: The pair, or its pose.
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
        rr.Image(banner(((text, WHITE),), size[1]), color_model="L", draw_order=50.0),
    )


def banner(lines: Sequence[Line], image_height: int) -> NDArray[np.uint8]:
    """Text on a dark ground as a picture: (H, W) if it is white, (H, W, 3) RGB if coloured.

    A picture, for the viewer's own labels fade on one of its two themes; and not an encoded
    one, for it takes those for frames of a video, whose size must not change.

    Args:
        lines: ASCII, which is what OpenCV's font has, and colours.
        image_height: Height in pixels of the image that it goes on.
    """
    import cv2

    height = max(12, round(SHARE * image_height))
    font = cv2.FONT_HERSHEY_DUPLEX
    scale = cv2.getFontScaleFromHeight(font, max(6, round(0.5 * height)))
    pen = max(1, height // 24)
    widths = [cv2.getTextSize(text, font, scale, pen)[0][0] for text, _ in lines]
    grey = all(colour == WHITE for _, colour in lines)
    shape = (height * len(lines), max(widths) + height) + (() if grey else (3,))
    picture = np.full(shape, 24, np.uint8)
    for number, (text, colour) in enumerate(lines):
        place = height // 2, round(0.76 * height) + number * height
        ink = 255 if grey else colour
        cv2.putText(picture, text, place, font, scale, ink, pen, cv2.LINE_AA)
    return picture
