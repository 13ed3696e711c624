"""review.rrd: written pair by pair, so that memory does not grow with the data set."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcdata.dataset.atomic import write_atomically
from lcdata.errors import ReportError
from lcdata.geometry import se3
from lcdata.review import names, scene, uncertainty
from lcdata.review.blueprint import blueprint
from lcdata.review.errors import send_errors, send_outcomes
from lcdata.review.pairs import PairLogger
from lcdata.review.summary import pair_text, summary
from lcdata.review.trials import Trials, choose_trials

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.reader import Dataset
    from lcdata.dataset.schema import PairRecord

APPLICATION = "lcdata"
THIN = 8
END_NS = 100_000_000
FRUSTUM_ARM_M, FRUSTUM_STATIC_M = 0.45, 1.0


def save_review(
    dataset: Dataset,
    path: Path,
    *,
    thin: int = THIN,
    run: str | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Path:
    """Write a data set and its results as a Rerun recording.

    Args:
        dataset: The data set.
        path: File to write; replaced if it is there, complete or not at all.
        thin: Every how many points of a cloud to keep.
        run: Which run's results to show; None for the one that was written last.
        progress: Called with the stage's name, pairs done and pairs in all.

    Returns:
        `path`.

    Raises:
        ReportError: No pairs, a `thin` below 1, an unknown run, or results that cannot be read.
        DatasetError: A pair that cannot be read, or a disk that cannot be written.
    """
    if thin < 1:
        raise ReportError(f"every {thin}th point cannot be kept", "give 1 or more")
    if not dataset.pairs:
        raise ReportError(f"{dataset.path} has no pairs", "there is nothing to review")
    trials = choose_trials(dataset, run)
    if run is not None and trials.run != run:
        stored = ", ".join(trials.other_runs) or "none"
        raise ReportError(f"{dataset.path} has no run {run!r}", f"stored are {stored}")
    with write_atomically(Path(path)) as temporary:
        _write(dataset, temporary, trials, thin, progress or (lambda stage, done, total: None))
    return Path(path)


def _write(
    dataset: Dataset,
    path: Path,
    trials: Trials,
    thin: int,
    progress: Callable[[str, int, int], None],
) -> None:
    with recorded(path, dataset.path.resolve().name) as recording:
        _log_whole(recording, dataset, trials)
        is_arm = dataset.rig.ground_truth == "arm"
        depth = FRUSTUM_ARM_M if is_arm else FRUSTUM_STATIC_M
        logger = PairLogger(recording, trials, dataset.scenarios, thin=thin, frustum_m=depth)
        for number, record in enumerate(dataset.pairs):
            recording.set_time(names.PAIR, sequence=number)
            recording.set_time(names.STAMP, timestamp=np.datetime64(record.stamp_lidar_ns, "ns"))
            logger.log(dataset.load(record.pair_id), dataset.path / record.image)
            progress("review", number + 1, len(dataset.pairs))


@contextmanager
def recorded(path: Path, name: str) -> Iterator[rr.RecordingStream]:
    """A recording that is written to a file, without times of its own.

    Args:
        path: File to write.
        name: Of the recording.

    Raises:
        ReportError: Rerun could not write all of it.
    """
    import rerun as rr
    from rerun.chunk import RrdReader

    recording = rr.RecordingStream(APPLICATION, recording_id=name)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    try:
        recording.save(path)
        recording.send_recording_name(name)
        yield recording
        recording.flush()
        recording.disconnect()
        RrdReader(path).store()  # reads the index at the end, which a full disk cuts off
    except (RuntimeError, ValueError) as error:  # what Rerun raises when it cannot write
        free = shutil.disk_usage(path.parent).free / 1e6
        raise ReportError(
            f"{path.parent}: Rerun could not write the review there ({error})",
            f"{free:.0f} MB are free on that disk; make room, then `lcdata review DATASET`",
        ) from error
    finally:
        recording.disconnect()


def _log_whole(recording: rr.RecordingStream, dataset: Dataset, trials: Trials) -> None:
    """Everything but the pairs' clouds and images: small, and sent in columns."""
    import rerun as rr

    records = dataset.pairs
    poses = [dataset.pose(record.pose_id) for record in records]

    def time(numbers: Sequence[int]) -> list[Any]:
        return time_columns(records, numbers)

    everywhere = time(range(len(records)))
    arm = scene.load_arm(dataset)
    is_arm = dataset.rig.ground_truth == "arm"
    root = names.arm_frame(dataset.rig.arm.base_frame) if is_arm else names.FRAME_LIDAR
    recording.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    scene.log_lidar(recording)
    if is_arm:
        scene.log_tower(recording, poses[0], root)
    if arm is not None:
        scene.log_arm(recording, arm)
        scene.send_joints(recording, arm, poses, everywhere)
    scene.send_sensors(recording, poses, everywhere, root)
    scale = uncertainty.scale_of(dataset.poses)
    uncertainty.send_ellipsoids(recording, poses, everywhere, scale)
    tops = send_errors(recording, trials, [r.pair_id for r in records], poses, time)
    if trials.methods:
        send_outcomes(recording, trials, records, time(range(len(records) + 1)))
    text = summary(dataset, trials, arm_is_missing=is_arm and arm is None, scale=scale)
    document = rr.TextDocument(text, media_type="text/markdown")
    recording.log(names.SUMMARY, document, static=True)
    texts = [
        pair_text(number, len(records), record, pose, trials)
        for number, (record, pose) in enumerate(zip(records, poses, strict=True))
    ]
    columns = rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * len(texts))
    recording.send_columns(names.PAIR_TEXT, everywhere, columns)
    T_root_lidar = poses[0].T_base_lidar if is_arm else None
    T_root_lidar = np.eye(4) if T_root_lidar is None else T_root_lidar
    T_root_camera = T_root_lidar @ se3.inverse(poses[0].T_camera_lidar)
    cameras = [dataset.camera(scenario) for scenario in dataset.scenarios]
    size = max(c.width for c in cameras), max(c.height for c in cameras)
    layout = blueprint(
        trials.methods,
        tops,
        size=size,
        root=root,
        T_root_camera=T_root_camera,
        lidar=T_root_lidar[:3, 3],
    )
    recording.send_blueprint(layout)


def time_columns(records: Sequence[PairRecord], numbers: Sequence[int]) -> list[Any]:
    """Columns of both timelines.

    Args:
        records: All pairs.
        numbers: Which of them; one more than the last stands for the end of the last.
    """
    import rerun as rr

    stamps = [record.stamp_lidar_ns for record in records]
    stamps.append(stamps[-1] + END_NS)
    return [
        rr.TimeColumn(names.PAIR, sequence=list(numbers)),
        rr.TimeColumn(names.STAMP, timestamp=np.array([stamps[i] for i in numbers], "M8[ns]")),
    ]
