"""Entity paths, frame names and timelines of a review: one place, so that all parts agree.

Every transform uses named frames, for URDF loading does: mixed with transforms that follow the
entity path, cloud and camera would stay unplaced. Our own frames are `lidar`, `camera` (of the
ground truth) and `image`; those of the arm have the prefix `arm/`, for a URDF may well have a
link called `camera`.
"""

from __future__ import annotations

PAIR = "pair"
STAMP = "stamp"

FRAME_LIDAR = "lidar"
FRAME_CAMERA = "camera"
FRAME_IMAGE = "image"
ARM_PREFIX = "arm/"

ARM = "arm"
JOINTS = "joints"
TOWER = "tower"
LIDAR = "lidar"
CLOUD = "lidar/cloud"
CAMERA = "camera"
IMAGES = "camera/image"
UNCERTAINTY = "camera/uncertainty"
FRUSTUMS = "frustums"
LINES = "lines"
OVERLAYS = "overlays"
ERRORS = "errors"
DIFFERENCE = "difference"
OUTCOMES = "outcomes"
SCENARIO = "scenario"
SUMMARY = "summary"
PAIR_TEXT = "pair"

BLEND = "blend"
IMAGE = "image"
COLOURED = "coloured"
BLENDED = "blended"
LANDSCAPE = "landscape"

INITIAL = "initial"
GROUND_TRUTH = "ground_truth"
FORMER = "ground_truth_a"
LIMIT = "limit"
BEYOND = "beyond"


def arm_frame(link: str) -> str:
    """Frame of a link of the arm."""
    return ARM_PREFIX + link


def image(scenario: str, kind: str) -> str:
    """Entity of a scenario's images of a kind, `jpeg` or `png`."""
    return f"{IMAGES}/{part(scenario)}/{kind}"


def overlay(source: str, what: str) -> str:
    """Entity of what lies over the images of a source."""
    return f"{OVERLAYS}/{part(source)}/{what}"


def frustum(source: str) -> str:
    """Entity of a source's frustum."""
    return f"{FRUSTUMS}/{part(source)}"


def lines(method: str) -> str:
    """Entity of the lines in the cloud that a method matched."""
    return f"{LINES}/{part(method)}"


def series(folder: str, measure: str, source: str) -> str:
    """Entity of a curve: of the errors or of the differences."""
    return f"{folder}/{measure}/{part(source)}"


def together(title: str) -> str:
    """Folder of the verdict on two sources."""
    return f"{title}.both"


def part(name: str) -> str:
    """A name as one part of an entity path: a label may well have spaces or an equals sign."""
    import rerun as rr

    return str(rr.escape_entity_path_part(name))


def title(source: str) -> str:
    """What a reader calls a source of an extrinsic: a method, or one of the two constants."""
    return {INITIAL: "initial guess", GROUND_TRUTH: "ground truth"}.get(source, source)
