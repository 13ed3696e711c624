"""What a review shows of one pair, read and computed without decoding what is shown as it is."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset import cloud_file
from lcdata.errors import DatasetError, LcdataError, MessageError
from lcdata.geometry.camera import Camera
from lcdata.recording import fields, images
from lcdata.review import colours
from lcdata.review.overlay import project_cloud
from lcdata.review.thinning import Thinning

if TYPE_CHECKING:
    from lcdata.dataset.reader import Dataset
    from lcdata.dataset.schema import PairRecord

T = TypeVar("T")
R = TypeVar("R")
Array = NDArray[np.float64]

OVERLAY_CANDIDATES = 40_000
"""Points of a cloud that are projected where the thinned ones show the camera too little."""

JPEG_QUALITY = 90
WORKERS = 2


class Overlay(NamedTuple):
    """The cloud in the image: (M, 2) pixels and (M,) packed colours by distance."""

    pixels: NDArray[np.float32]
    colours: NDArray[np.uint32]


@dataclass(frozen=True, eq=False)
class Content:
    """One pair.

    Args:
        pair_id: Its name.
        image: Bytes of its image file; empty if it could not be read.
        media_type: Their type.
        points: (N, 3) kept points in the LiDAR frame, metres.
        colours: (N,) packed RGBA by intensity, or by range without any.
        overlays: The cloud in the image by each source's extrinsic; empty without one.
        failures: What could not be read, a line each.
    """

    pair_id: str
    image: bytes
    media_type: str
    points: NDArray[np.float32]
    colours: NDArray[np.uint32]
    overlays: dict[str, Overlay]
    failures: tuple[str, ...] = field(default=())


def read_content(
    dataset: Dataset,
    record: PairRecord,
    extrinsics: Mapping[str, Array | None],
    reference: str,
    thinning: Thinning,
) -> Content:
    """Read a pair and put its cloud into its image by each extrinsic.

    What is missing or damaged is left out and told; the rest is shown.

    Args:
        dataset: The data set.
        record: Row of the pair.
        extrinsics: 4x4 by source; None where there is no estimate.
        reference: The source whose distances set the scale of colours.
        thinning: What to keep.
    """
    failures = []
    camera = dataset.camera(record.scenario)
    data, media_type = b"", ""
    try:
        data, media_type = _image(dataset.path / record.image, camera, record, thinning)
    except LcdataError as error:
        failures.append(f"{record.pair_id}: {error.message}")
    points, dense, values = np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32), np.zeros(0)
    try:
        points, values, dense = _cloud(dataset.path / record.cloud, record.pair_id, thinning)
        if not len(points):
            failures.append(f"{record.pair_id}: {record.cloud} has no point with a return")
    except LcdataError as error:
        failures.append(f"{record.pair_id}: {error.message}")
    at_most = thinning.overlay
    found = {reference: _seen(camera, extrinsics.get(reference), points, at_most)}
    if len(found[reference][0]) < at_most < len(dense):  # thinned, few rings show no shape
        points_seen = dense
        found = {}
    else:
        points_seen = points
    for source, extrinsic in extrinsics.items():
        if source not in found:
            found[source] = _seen(camera, extrinsic, points_seen, at_most)
    span = distance_span(found[reference][1])
    return Content(
        pair_id=record.pair_id,
        image=data,
        media_type=media_type,
        points=points,
        colours=colours.by_intensity(values),
        overlays={
            source: Overlay(pixels, colours.by_depth(distances, span))
            for source, (pixels, distances) in found.items()
            if source in extrinsics
        },
        failures=tuple(failures),
    )


def _seen(
    camera: Camera, extrinsic: Array | None, points: NDArray[np.float32], at_most: int
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    if extrinsic is None:
        return np.zeros((0, 2), np.float32), np.zeros(0, np.float32)
    return project_cloud(camera, extrinsic, points, at_most)


def _image(path: Path, camera: Camera, record: PairRecord, thinning: Thinning) -> tuple[bytes, str]:
    """Bytes of an image file as it is, but for PNGs that are large or that no viewer shows."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        suffix = images.suffix(data, path.name)
        images.check_whole(data, path.name)
    except MessageError as error:
        raise DatasetError(f"{path}: {error.message}") from error
    size = images.size(data)
    if size not in ((0, 0), (camera.height, camera.width)):
        raise DatasetError(
            f"{path}: {size[1]}x{size[0]} for a camera of {camera.width}x{camera.height}"
        )
    deep = suffix == ".png" and data[24:25] == b"\x10"
    if suffix == ".png" and (deep or record.scenario in thinning.as_jpeg):
        return _as_jpeg(data), "image/jpeg"
    return data, "image/png" if suffix == ".png" else "image/jpeg"


def _as_jpeg(data: bytes) -> bytes:
    import cv2

    image = images.decode_file(data)
    if image.ndim == 3:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1])


def _cloud(
    path: Path, pair_id: str, thinning: Thinning
) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[np.float32]]:
    """Kept points (N, 3), their intensities or ranges (N,), and more points (M, 3) for overlays."""
    records, _, _ = cloud_file.read(path)
    try:
        fields.check_points(records.dtype)
    except MessageError as error:
        raise DatasetError(f"{path}: {error.message}") from error
    x, y, z = (np.asarray(records[axis], np.float32) for axis in "xyz")
    # A sum is finite where all three are; (0, 0, 0) is a pulse without return.
    returned = np.flatnonzero(np.isfinite(x + y + z) & ((x != 0) | (y != 0) | (z != 0)))
    kept = returned[thinning.keep(len(returned), pair_id)]
    points = np.stack([x[kept], y[kept], z[kept]], axis=1)
    name = fields.intensity_name(records.dtype)
    values = np.linalg.norm(points, axis=1) if name is None else records[name][kept]
    more = returned[:: max(1, -(-len(returned) // OVERLAY_CANDIDATES))]
    if len(more) <= len(kept):
        more = more[:0]
    return points, values, np.stack([x[more], y[more], z[more]], axis=1)


def distance_span(distances: NDArray[np.float32]) -> tuple[float, float]:
    """Distances in metres between which most of what the camera sees lies."""
    if not len(distances):
        return 1.0, 50.0
    near, far = np.quantile(distances, [0.02, 0.98])
    return float(near), float(max(far, near * 1.5))


def in_order(function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
    """Results in the order of the items, computed ahead by a few threads.

    NumPy and reading files let other threads run; a few results are held at a time.
    """
    waiting: deque[Future[R]] = deque()
    with ThreadPoolExecutor(WORKERS) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) > 2 * WORKERS:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:  # Ctrl-C too
            pool.shutdown(wait=False, cancel_futures=True)
