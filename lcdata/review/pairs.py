"""One pair: cloud, image, and how each extrinsic fits the one to the other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.evaluation import metrics
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.review import colours, names
from lcdata.review.overlay import clip_segments, project_cloud, project_segments
from lcdata.review.text import error_text, uncertainty_text
from lcdata.review.trials import OUTCOME_COLOURS, Trials, matches_of, outcome

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.evaluation.results import TrialResult
    from lcdata.pair import Pair

Array = NDArray[np.float64]

OVERLAY_POINTS = 3000
"""Points in an overlay: more cover the image that they are to be compared with."""

OVERLAY_CANDIDATES = 40_000
"""Points of a cloud that are projected, of which an overlay takes what it needs."""

JPEG_QUALITY = 85
FRAME_PX = 4.0
WHITE = (255, 255, 255)


class PairLogger:
    """Logs pairs one after the other; holds none of them.

    Args:
        recording: Where to log.
        trials: What to show beside the ground truth.
        thin: Every how many points of a cloud to keep.
        frustum_m: Depth at which frustums end.
    """

    def __init__(
        self, recording: rr.RecordingStream, trials: Trials, thin: int, frustum_m: float
    ) -> None:
        self.recording = recording
        self.trials = trials
        self.thin = thin
        self.frustum_m = frustum_m
        self.colours = colours.of_sources(trials.methods)
        self._camera: Camera | None = None

    def log(self, pair: Pair, image_file: Path) -> None:
        """Log a pair at the recording's present time.

        Args:
            pair: The pair, with its ground truth.
            image_file: The image as recorded, whose bytes are used if it needs no undistortion.
        """
        import rerun as rr

        assert pair.T_camera_lidar is not None
        camera = pair.camera.undistorted()
        self._log_camera(camera)
        image = rr.EncodedImage(**encoded_image(pair, image_file))
        self.recording.log(names.IMAGE, rr.CoordinateFrame(names.FRAME_IMAGE), image)

        x, y, z = pair.points.T  # a sum is finite where all three are, and much faster to test
        returned = np.flatnonzero(np.isfinite(x + y + z))
        kept = returned[:: self.thin]
        points = np.ascontiguousarray(pair.points[kept], np.float32)
        self._log_cloud(points, None if pair.intensity is None else pair.intensity[kept])

        shown = self.trials.of_pair(pair.pair_id)
        extrinsics: dict[str, Array | None] = {names.GROUND_TRUTH: pair.T_camera_lidar}
        if self.trials.methods:
            initial = next((t.T_camera_lidar_initial for t in shown.values()), None)
            extrinsics[names.INITIAL] = initial
        for method in self.trials.methods:
            trial = shown.get(method)
            extrinsics[method] = trial.T_camera_lidar_estimated if trial else None
        if len(points) < OVERLAY_CANDIDATES:  # few rings: thinned, they would show no shape
            step = -(-len(returned) // OVERLAY_CANDIDATES)
            points = pair.points[returned[::step]] if len(returned) else points
        overlays = {
            source: project_cloud(
                camera,
                np.eye(4) if T is None else T,
                points[: 0 if T is None else None],
                OVERLAY_POINTS,
            )
            for source, T in extrinsics.items()
        }
        span = depth_span(overlays[names.GROUND_TRUTH][1])
        for source, T in extrinsics.items():
            self._log_overlay(source, *overlays[source], span)
            self._log_verdict(source, camera, *verdict(source, pair, shown))
            if source != names.GROUND_TRUTH:
                self._log_frustum(source, camera, T)
        for method in self.trials.methods:
            trial = shown.get(method)
            lines = matches_of(trial, pair.pair_id) if trial else _no_lines()
            self._log_lines(method, camera, extrinsics[method], *lines)

    def _log_camera(self, camera: Camera) -> None:
        """The ground truth's camera; again only when it changes."""
        import rerun as rr

        if camera == self._camera:
            return
        self._camera = camera
        self.recording.log(
            names.CAMERA,
            rr.Pinhole(
                image_from_camera=camera.K,
                resolution=[camera.width, camera.height],
                camera_xyz=rr.ViewCoordinates.RDF,
                parent_frame=names.FRAME_CAMERA,
                child_frame=names.FRAME_IMAGE,
                image_plane_distance=self.frustum_m,
                color=colours.GREEN,
            ),
        )

    def _log_cloud(self, points: NDArray[np.float32], intensity: NDArray[Any] | None) -> None:
        import rerun as rr

        values = np.linalg.norm(points, axis=1) if intensity is None else intensity
        self.recording.log(
            names.CLOUD,
            rr.CoordinateFrame(names.FRAME_LIDAR),
            rr.Points3D(
                points, colors=colours.by_intensity(values), radii=rr.Radius.ui_points(1.0)
            ),
        )

    def _log_overlay(
        self,
        source: str,
        pixels: NDArray[np.float32],
        depths: NDArray[np.float32],
        span: tuple[float, float],
    ) -> None:
        """The cloud in the image; nothing where there is no estimate."""
        import rerun as rr

        self.recording.log(
            f"{names.OVERLAYS}/{source}/cloud",
            rr.CoordinateFrame(names.FRAME_IMAGE),
            rr.Points2D(
                pixels,
                colors=colours.by_depth(depths, span),
                radii=rr.Radius.ui_points(1.3),
                draw_order=10.0,
            ),
        )

    def _log_verdict(self, source: str, camera: Camera, text: str, colour: colours.RGB) -> None:
        """A frame around the image that says in words and colour how wrong the extrinsic is."""
        import rerun as rr

        size = np.array([camera.width, camera.height]) - FRAME_PX
        self.recording.log(
            f"{names.OVERLAYS}/{source}/verdict",
            rr.CoordinateFrame(names.FRAME_IMAGE),
            rr.Boxes2D(
                mins=[[FRAME_PX / 2, FRAME_PX / 2]],
                sizes=[size],
                colors=[colour],
                radii=rr.Radius.ui_points(2.0),
                draw_order=40.0,
            ),
            # A box's own label would stand below it, outside the view.
            rr.Points2D(
                [[camera.width / 2, camera.height * 0.01]],
                colors=[WHITE],
                labels=[text],
                show_labels=True,
                radii=rr.Radius.ui_points(0.0),
                draw_order=41.0,
            ),
        )

    def _log_frustum(self, source: str, camera: Camera, T: Array | None) -> None:
        import rerun as rr

        strips = [] if T is None else frustum(camera, T, self.frustum_m)
        self.recording.log(
            f"{names.FRUSTUMS}/{source}",
            rr.CoordinateFrame(names.FRAME_LIDAR),
            rr.LineStrips3D(strips, colors=[self.colours[source]], radii=rr.Radius.ui_points(1.5)),
        )

    def _log_lines(
        self,
        method: str,
        camera: Camera,
        T: Array | None,
        lines_lidar: Array,
        lines_image: Array,
    ) -> None:
        """Matched lines: in the cloud, in the image (white), and the one put into the other."""
        import rerun as rr

        if T is None:
            lines_lidar, lines_image = _no_lines()
            T = np.eye(4)
        colour = self.colours[method]
        self.recording.log(
            f"{names.LINES}/{method}",
            rr.CoordinateFrame(names.FRAME_LIDAR),
            rr.LineStrips3D(
                lines_lidar.astype(np.float32), colors=[colour], radii=rr.Radius.ui_points(1.5)
            ),
        )
        folder = f"{names.OVERLAYS}/{method}"
        inside = clip_segments(lines_image, (camera.width, camera.height))
        projected = project_segments(camera, T, lines_lidar)
        for name, segments, segment_colour, radius, order in (
            ("lines_image", inside, WHITE, 1.8, 20.0),
            ("lines_cloud", projected, colour, 0.9, 30.0),  # thinner: white shows where they agree
        ):
            self.recording.log(
                f"{folder}/{name}",
                rr.CoordinateFrame(names.FRAME_IMAGE),
                rr.LineStrips2D(
                    segments.astype(np.float32),
                    colors=[segment_colour],
                    radii=rr.Radius.ui_points(radius),
                    draw_order=order,
                ),
            )


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
        errors = first.initial_rotation_error_deg, first.initial_translation_error_m
        return error_text(*errors), colours.GREY
    if source not in shown:
        return "no results", colours.GREY
    trial = shown[source]
    text = outcome(trial)
    if not trial.failed:
        text = f"{text}: {error_text(trial.rotation_error_deg, trial.translation_error_m)}"
    return text, OUTCOME_COLOURS[outcome(trial)]


def encoded_image(pair: Pair, file: Path) -> dict[str, Any]:
    """Bytes and media type of a pair's image without distortion, as `EncodedImage` takes them.

    The recorded bytes where they are free of distortion: encoding anew costs time and quality.
    """
    import cv2

    if not pair.camera.is_distorted:
        media_type = "image/png" if file.suffix.lower() == ".png" else "image/jpeg"
        return {"contents": file.read_bytes(), "media_type": media_type}
    image = pair.camera.undistort(pair.image)
    if image.ndim == 3:
        image = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return {"contents": data.tobytes(), "media_type": "image/jpeg"}


def depth_span(depths: NDArray[np.float32]) -> tuple[float, float]:
    """Depths in metres between which most of what the camera sees lies."""
    if not len(depths):
        return 1.0, 50.0
    near, far = np.quantile(depths, [0.02, 0.98])
    return float(near), float(max(far, near * 1.5))


def frustum(camera: Camera, T_camera_lidar: Array, depth_m: float) -> list[Array]:
    """A camera's field of view as line strips in the LiDAR frame, metres."""
    w, h = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5], [w, -0.5], [w, h], [-0.5, h]])
    fx, fy, cx, cy = camera.intrinsics
    rays = np.column_stack([(corners - [cx, cy]) / [fx, fy], np.ones(4)]) * depth_m
    T_lidar_camera = se3.inverse(T_camera_lidar)
    corners = se3.apply(T_lidar_camera, rays)
    eye = T_lidar_camera[:3, 3]
    return [np.vstack([corners, corners[:1]]), *(np.stack([eye, c]) for c in corners)]


def _no_lines() -> tuple[Array, Array]:
    return np.zeros((0, 2, 3)), np.zeros((0, 2, 2))
