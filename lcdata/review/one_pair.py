"""The review of one pair: coloured cloud, blended projection and NID landscape, pose by pose."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset.atomic import write_atomically, write_bytes
from lcdata.errors import CalibrationError, ReportError
from lcdata.features.nid_landscape import (
    REACH_DEG,
    REACH_M,
    Landscape,
    check_reach,
    landscape,
)
from lcdata.review import colours, names
from lcdata.review.blending import Blending, encoded
from lcdata.review.frustum import frustum
from lcdata.review.landscape_figure import draw
from lcdata.review.one_pair_blueprint import blueprint
from lcdata.review.one_pair_text import landscape_text, reading_text
from lcdata.review.save import recorded
from lcdata.review.shown import Shown
from lcdata.review.summary import pair_text
from lcdata.review.trials import Trials, trials_of_pair
from lcdata.review.verdict import framed, verdict

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.reader import Dataset
    from lcdata.pair import Pair

Array = NDArray[np.float64]

CLOUD_POINTS = 250_000
"""Points of a coloured cloud; of larger ones every n-th is kept."""

PREFERRED = ("nid", "nid_edge")
FRUSTUM_M = 0.15


def default_path(dataset: Dataset, pair_id: str) -> Path:
    """Where the review of a pair is written unless told otherwise."""
    from lcdata.dataset.schema import REPORT

    return dataset.path / REPORT / f"pair-{pair_id.replace('/', '-')}.rrd"


def save_pair_review(
    dataset: Dataset,
    pair_id: str,
    path: Path | None = None,
    *,
    method: str | None = None,
    thin: int | None = None,
    reach_m: float = REACH_M,
    reach_deg: float = REACH_DEG,
    progress: Callable[[str, int, int], None] | None = None,
) -> tuple[Path, Path | None]:
    """Write one pair and what a method made of it as a Rerun recording.

    Args:
        dataset: The data set.
        pair_id: The pair.
        path: File to write; None for one in the data set's report folder.
        method: Whose estimate to show; None for that of an NID method, or the first.
        thin: Every how many points of the cloud to keep; None for as many as `CLOUD_POINTS`.
        reach_m: Half-width of the landscape's translations, metres.
        reach_deg: Half-width of its rotations, degrees.
        progress: Called with the stage's name, steps done and steps in all.

    Returns:
        The recording, and the landscape's picture (PNG) beside it; None where there is no
        landscape, and the recording says why.

    Raises:
        ReportError: No result of the method on this pair, a disk that cannot be written.
        DatasetError: Unknown pair, or one that cannot be read.
        CalibrationError: A landscape that cannot reach so far.
    """
    if thin is not None and thin < 1:
        raise ReportError(f"every {thin}th point cannot be kept", "give 1 or more")
    tell = progress or (lambda stage, done, total: None)
    path = path or default_path(dataset, pair_id)
    pair = dataset.load(pair_id)
    trials = trials_of_pair(dataset, pair_id, method)
    chosen = method or _preferred(trials, pair_id)
    poses = _poses(pair, trials, chosen)
    middle = chosen if chosen in poses else names.GROUND_TRUTH
    tell("landscape", 0, 1)
    surroundings, reason = _landscape(pair, poses, middle, reach_m, reach_deg)
    tell("landscape", 1, 1)
    palette = colours.of_sources([chosen] if chosen else [])
    figure = None if surroundings is None else draw(surroundings, middle, palette)
    text = _text(dataset, pair_id, trials, landscape_text(surroundings, middle, reason))
    text += reading_text(has_intensity=pair.intensity is not None)
    with write_atomically(path) as temporary, recorded(temporary, pair_id) as recording:
        _log(recording, pair, poses, palette, trials, thin, tell)
        _log_documents(recording, figure, text)
        recording.send_blueprint(blueprint(poses, middle, pair.camera, figure is not None))
    beside = path.with_suffix(".png")
    if figure is None:
        beside.unlink(missing_ok=True)  # of an earlier review
        return path, None
    write_bytes(beside, figure)
    return path, beside


def _preferred(trials: Trials, pair_id: str) -> str:
    """The method to show; empty without any."""
    shown = trials.of_pair(pair_id)
    return next((m for m in (*PREFERRED, *shown) if m in shown), "")


def _poses(pair: Pair, trials: Trials, method: str) -> dict[str, Array]:
    """Extrinsics by source: the estimate first, for a person looks at that first."""
    assert pair.T_camera_lidar is not None
    poses: dict[str, Array | None] = {}
    if method:
        trial = trials.of_pair(pair.pair_id)[method]
        poses[method] = trial.T_camera_lidar_estimated
        poses[names.INITIAL] = trial.T_camera_lidar_initial
    poses[names.GROUND_TRUTH] = pair.T_camera_lidar
    return {source: T for source, T in poses.items() if T is not None}


def _landscape(
    pair: Pair, poses: Mapping[str, Array], middle: str, reach_m: float, reach_deg: float
) -> tuple[Landscape | None, str]:
    """The landscape, or why there is none."""
    check_reach(reach_m, reach_deg)
    try:
        found = landscape(
            pair,
            poses,
            middle,
            reach_m=reach_m,
            reach_deg=reach_deg,
            with_edges=middle == "nid_edge",
        )
        return found, ""
    except CalibrationError as error:
        return None, error.message


def _log(
    recording: rr.RecordingStream,
    pair: Pair,
    poses: Mapping[str, Array],
    palette: Mapping[str, colours.RGB],
    trials: Trials,
    thin: int | None,
    tell: Callable[[str, int, int], None],
) -> None:
    """The image, and for each pose the coloured cloud and the LiDAR's picture."""
    import rerun as rr

    def log(entity: str, *what: Any) -> None:
        recording.log(entity, *what, static=True)

    blending = Blending(pair)
    log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    image = encoded(blending.image, ".jpg")
    log(names.IMAGE, rr.EncodedImage(contents=image, media_type="image/jpeg", draw_order=-10.0))
    kept = slice(None, None, thin or 1 + len(blending.points) // CLOUD_POINTS)
    size = blending.camera.width, blending.camera.height
    shown = trials.of_pair(pair.pair_id)
    percent = np.arange(101)
    for number, (source, T) in enumerate(poses.items()):
        log(
            f"{names.COLOURED}/{source}/points",
            rr.Points3D(
                blending.points[kept],
                colors=blending.colours(T)[kept],
                radii=rr.Radius.ui_points(1.5),
            ),
        )
        log(
            f"{names.COLOURED}/{source}/camera",
            rr.LineStrips3D(
                frustum(pair.camera.undistorted(), T, FRUSTUM_M),
                colors=[palette[source]],
                radii=rr.Radius.ui_points(1.5),
            ),
        )
        folder = f"{names.BLENDED}/{source}"
        picture = encoded(blending.picture(T), ".png")
        log(
            f"{folder}/lidar",
            rr.EncodedImage(contents=picture, media_type="image/png", draw_order=10.0),
        )
        recording.send_columns(
            f"{folder}/lidar",
            [rr.TimeColumn(names.BLEND, sequence=percent)],
            rr.EncodedImage.columns(opacity=percent / 100),
        )
        log(f"{folder}/verdict", *framed(size, *verdict(source, pair, shown)))
        tell("pair", number + 1, len(poses))


def _log_documents(recording: rr.RecordingStream, figure: bytes | None, text: str) -> None:
    import rerun as rr

    if figure is not None:
        picture = rr.EncodedImage(contents=figure, media_type="image/png")
        recording.log(names.LANDSCAPE, picture, static=True)
    recording.log(names.PAIR_TEXT, rr.TextDocument(text, media_type="text/markdown"), static=True)


def _text(dataset: Dataset, pair_id: str, trials: Trials, *parts: str) -> str:
    """Markdown on the pair and what was made of it."""
    record = dataset.pair(pair_id)
    number = [r.pair_id for r in dataset.pairs].index(pair_id)
    return "\n".join([pair_text(number, record, Shown(dataset, trials)), *parts])
