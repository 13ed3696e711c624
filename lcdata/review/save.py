"""review.rrd: written block by block, so that memory does not grow with the data set."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcdata.dataset.atomic import write_atomically
from lcdata.errors import ReportError
from lcdata.geometry import se3
from lcdata.review import names, scene, uncertainty
from lcdata.review.arrange import Wanted, arrange
from lcdata.review.blueprint import Axes, blueprint
from lcdata.review.content import in_order, read_content
from lcdata.review.difference import send_differences
from lcdata.review.errors import send_errors, send_outcomes
from lcdata.review.pairs import PairSender, Row
from lcdata.review.shown import Shown
from lcdata.review.summary import pair_text, summary
from lcdata.review.thinning import Thinning, plan

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.reader import Dataset
    from lcdata.dataset.schema import PairRecord

APPLICATION = "lcdata"
END_NS = 100_000_000
FRUSTUM_ARM_M, FRUSTUM_STATIC_M = 0.45, 1.0
BLOCK = 10
"""Pairs that are sent at once; no block has pairs of two poses."""

FLUSH_EVERY = 60
"""Pairs after which what was sent must have been written: a full disk is found before the end."""

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Review:
    """A review that was written.

    Args:
        path: The file.
        pairs: How many pairs it shows.
        failures: What could not be read and is not shown, a line each.
        notes: What a user should know: what was thinned or left out.
    """

    path: Path
    pairs: int
    failures: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def save_review(
    dataset: Dataset,
    path: Path,
    *,
    wanted: Wanted | None = None,
    points: int | None = None,
    thin: int | None = None,
    progress: Progress | None = None,
) -> Review:
    """Write a data set and its results as a Rerun recording.

    Args:
        dataset: The data set.
        path: File to write; replaced if it is there, complete or not at all.
        wanted: Which pairs and results to show, and what to compare; None for all pairs and the
            run that was written last.
        points: Points of a cloud to keep; None for as many as fit into some 400 MB.
        thin: Every how many points to keep in place of a number.
        progress: Called with the stage's name, pairs done and pairs in all.

    Returns:
        Where it is, and what it lacks.

    Raises:
        ReportError: No pairs, nothing left by the filters, an unknown name, results that cannot
            be read, or a disk that cannot be written.
        DatasetError: A folder that cannot be written.
    """
    shown = arrange(dataset, wanted or Wanted())
    thinning = plan(shown.dataset, len(shown.sources), points=points, thin=thin)
    with (
        write_atomically(Path(path)) as temporary,
        recorded(temporary, dataset.path.resolve().name) as recording,
    ):
        failures = send_all(recording, shown, thinning, progress)
    notes = tuple(filter(None, (shown.note, thinning.note)))
    return Review(Path(path), len(shown.dataset), failures, notes)


def send_all(
    recording: rr.RecordingStream,
    shown: Shown,
    thinning: Thinning,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Send all that is shown; returns what could not be read."""
    tell = progress or (lambda stage, done, total: None)
    send_whole(recording, shown, thinning.note)
    sender = PairSender(recording, shown, frustum_m=frustum_depth(shown.dataset))
    failures: list[str] = []
    block: list[Row] = []
    records = shown.dataset.pairs

    def read(record: PairRecord) -> Any:
        extrinsics = shown.extrinsics(record)
        return read_content(shown.dataset, record, extrinsics, names.GROUND_TRUTH, thinning)

    for number, content in enumerate(in_order(read, records)):
        record = records[number]
        if block and (len(block) == BLOCK or block[-1].record.pose_id != record.pose_id):
            sender.send(block)
            block = []
        block.append(Row(number, record, content))
        failures += content.failures
        if number % FLUSH_EVERY == FLUSH_EVERY - 1:
            recording.flush()
        tell("review", number + 1, len(records))
    sender.send(block)
    if failures:
        text = "# Not shown\n\n" + "\n".join(f"- {failure}" for failure in failures)
        send_summary(recording, shown, thinning.note, text)
    return tuple(failures)


def frustum_depth(dataset: Dataset) -> float:
    """Depth in metres at which frustums end."""
    return FRUSTUM_ARM_M if dataset.rig.ground_truth == "arm" else FRUSTUM_STATIC_M


@contextmanager
def recorded(path: Path, name: str) -> Iterator[rr.RecordingStream]:
    """A recording that is written to a file, without times of its own.

    Args:
        path: File to write.
        name: Of the recording.

    Raises:
        ReportError: Rerun could not write all of it.
    """
    recording = new_recording(name)
    try:
        recording.save(path)
        recording.send_recording_name(name)
        yield recording
        recording.flush()
        recording.disconnect()
        check_whole(path)
    except (RuntimeError, ValueError) as error:  # what Rerun raises when it cannot write
        free = shutil.disk_usage(path.parent).free / 1e6
        raise ReportError(
            f"{path.parent}: Rerun could not write the review there ({error})",
            f"{free:.0f} MB are free on that disk; make room, then `lcdata review DATASET`",
        ) from error
    finally:
        recording.disconnect()


def check_whole(path: Path) -> None:
    """Read the index at the end of a recording, which a full disk cuts off.

    Raises:
        ValueError: It is not there.
    """
    from rerun.chunk import RrdReader

    RrdReader(path).store()


def new_recording(name: str, recording_id: str | None = None) -> rr.RecordingStream:
    """A recording without times of its own."""
    import rerun as rr

    recording = rr.RecordingStream(APPLICATION, recording_id=recording_id or name)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    return recording


def send_whole(recording: rr.RecordingStream, shown: Shown, note: str) -> None:
    """Everything but the pairs' clouds and images: small, and sent in columns."""
    import rerun as rr

    dataset, records = shown.dataset, shown.dataset.pairs
    poses = [dataset.pose(record.pose_id) for record in records]
    everywhere = time_columns(records, range(len(records)))
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
    uncertainty.send_ellipsoids(recording, poses, everywhere, uncertainty.scale_of(dataset.poses))
    send_summary(recording, shown, note)
    send_results(recording, shown)
    send_texts(recording, shown, range(len(records)))


def send_results(recording: rr.RecordingStream, shown: Shown) -> None:
    """Series of errors and differences, lanes of outcomes, and the layout that shows them."""
    dataset, records = shown.dataset, shown.dataset.pairs
    poses = [dataset.pose(record.pose_id) for record in records]

    def time(numbers: Sequence[int]) -> list[Any]:
        return time_columns(records, numbers)

    pair_ids = [record.pair_id for record in records]
    tops = send_errors(recording, shown.trials, shown.colours, pair_ids, poses, time)
    differences = {} if shown.comparison is None else send_differences(recording, shown, time)
    if shown.trials.methods:
        send_outcomes(recording, shown.trials, records, time)
    send_layout(recording, shown, Axes(tops, differences))


def send_layout(recording: rr.RecordingStream, shown: Shown, axes: Axes) -> None:
    """How the viewer lays it out."""
    dataset = shown.dataset
    pose = dataset.pose(dataset.pairs[0].pose_id)
    is_arm = dataset.rig.ground_truth == "arm"
    root = names.arm_frame(dataset.rig.arm.base_frame) if is_arm else names.FRAME_LIDAR
    T_root_lidar = pose.T_base_lidar if is_arm else None
    T_root_lidar = np.eye(4) if T_root_lidar is None else T_root_lidar
    layout = blueprint(
        shown,
        axes,
        root=root,
        T_root_camera=T_root_lidar @ se3.inverse(pose.T_camera_lidar),
        lidar=T_root_lidar[:3, 3],
    )
    recording.send_blueprint(layout)


def send_summary(
    recording: rr.RecordingStream, shown: Shown, note: str, failures: str = ""
) -> None:
    """The text on all pairs."""
    import rerun as rr

    dataset = shown.dataset
    is_arm = dataset.rig.ground_truth == "arm"
    text = summary(
        shown,
        arm_is_missing=is_arm and scene.load_arm(dataset) is None,
        scale=uncertainty.scale_of(dataset.poses),
        note=note,
    )
    document = rr.TextDocument(
        "\n\n".join(filter(None, (failures, text))), media_type="text/markdown"
    )
    recording.log(names.SUMMARY, document, static=True)


def send_texts(recording: rr.RecordingStream, shown: Shown, numbers: Sequence[int]) -> None:
    """The text on each of some pairs."""
    import rerun as rr

    records = shown.dataset.pairs
    texts = [pair_text(number, records[number], shown) for number in numbers]
    columns = rr.TextDocument.columns(text=texts, media_type=["text/markdown"] * len(texts))
    recording.send_columns(names.PAIR_TEXT, time_columns(records, numbers), columns)


def time_columns(records: Sequence[PairRecord], numbers: Sequence[int]) -> list[Any]:
    """Columns of both timelines.

    Args:
        records: All pairs.
        numbers: Which of them; one more than the last stands for the end of the last.
    """
    import rerun as rr

    stamps = [record.stamp_lidar_ns for record in records]
    stamps.append(max(stamps) + END_NS)
    return [
        rr.TimeColumn(names.PAIR, sequence=list(numbers)),
        rr.TimeColumn(names.STAMP, timestamp=np.array([stamps[i] for i in numbers], "M8[ns]")),
    ]
