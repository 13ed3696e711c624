"""One pair: cloud, image, and how each extrinsic fits the one to the other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.review import colours, names
from lcdata.review.overlay import clip_segments, project_cloud, project_segments
from lcdata.review.trials import Trials, matches_of
from lcdata.review.verdict import framed, verdict

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.pair import Pair

Array = NDArray[np.float64]

OVERLAY_POINTS = 3000
"""Points in an overlay: more cover the image that they are to be compared with."""

OVERLAY_CANDIDATES = 40_000
"""Points of a cloud that are projected, of which an overlay takes what it needs."""

JPEG_QUALITY = 85
WHITE = (255, 255, 255)


class PairLogger:
    """Logs pairs one after the other; holds none of them.

    Args:
        recording: Where to log.
        trials: What to show beside the ground truth.
        scenarios: Names of all scenarios.
        thin: Every how many points of a cloud to keep.
        frustum_m: Depth at which frustums end.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        trials: Trials,
        scenarios: Sequence[str],
        *,
        thin: int,
        frustum_m: float,
    ) -> None:
        self.recording = recording
        self.trials = trials
        self.thin = thin
        self.frustum_m = frustum_m
        self.colours = colours.of_sources(trials.methods)
        self._camera: Camera | None = None
        self._image = ""
        self._log_frames(scenarios)

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
        self._log_image(pair.scenario, rr.EncodedImage(**encoded_image(pair, image_file)))

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

    def _log_frames(self, scenarios: Sequence[str]) -> None:
        """The frame of every entity, for all time: a view complains of one without."""
        import rerun as rr

        methods = self.trials.methods
        guesses = [names.INITIAL, *methods] if methods else []
        in_image = [names.image(scenario) for scenario in scenarios]
        for source in (names.GROUND_TRUTH, *guesses):
            in_image += [f"{names.OVERLAYS}/{source}/{part}" for part in ("cloud", "verdict")]
        for method in methods:
            in_image += [f"{names.OVERLAYS}/{method}/lines_{kind}" for kind in ("image", "cloud")]
        in_lidar = [names.CLOUD, *(f"{names.FRUSTUMS}/{source}" for source in guesses)]
        in_lidar += [f"{names.LINES}/{method}" for method in methods]
        for frame, paths in ((names.FRAME_IMAGE, in_image), (names.FRAME_LIDAR, in_lidar)):
            for path in paths:
                self.recording.log(path, rr.CoordinateFrame(frame), static=True)

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

    def _log_image(self, scenario: str, image: rr.EncodedImage) -> None:
        """An entity for each scenario: the viewer takes encoded images for frames of a video.

        Frames must not change in size or coding, which those of another camera would.
        """
        import rerun as rr

        path = names.image(scenario)
        if self._image not in ("", path):
            self.recording.log(self._image, rr.Clear(recursive=False))
        self._image = path
        self.recording.log(path, image)

    def _log_cloud(self, points: NDArray[np.float32], intensity: NDArray[Any] | None) -> None:
        import rerun as rr

        values = np.linalg.norm(points, axis=1) if intensity is None else intensity
        self.recording.log(
            names.CLOUD,
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
            rr.Points2D(
                pixels,
                colors=colours.by_depth(depths, span),
                radii=rr.Radius.ui_points(1.3),
                draw_order=10.0,
            ),
        )

    def _log_verdict(self, source: str, camera: Camera, text: str, colour: colours.RGB) -> None:
        """A frame around the image that says in words and colour how wrong the extrinsic is."""
        entity = f"{names.OVERLAYS}/{source}/verdict"
        self.recording.log(entity, *framed((camera.width, camera.height), text, colour))

    def _log_frustum(self, source: str, camera: Camera, T: Array | None) -> None:
        import rerun as rr

        strips = [] if T is None else frustum(camera, T, self.frustum_m)
        self.recording.log(
            f"{names.FRUSTUMS}/{source}",
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
                rr.LineStrips2D(
                    segments.astype(np.float32),
                    colors=[segment_colour],
                    radii=rr.Radius.ui_points(radius),
                    draw_order=order,
                ),
            )


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
