"""Pairs as Rerun's columns: cloud, image, and how each extrinsic fits the one to the other.

A block of pairs is sent at once, a chunk for each entity: many small messages take longer to
write, and longer to open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry.camera import Camera
from lcdata.review import colours, names
from lcdata.review.content import Content
from lcdata.review.frustum import frustum, plane
from lcdata.review.overlay import image_strips, project_strips
from lcdata.review.shown import Shown
from lcdata.review.trials import matches_of
from lcdata.review.verdict import banner, verdicts

if TYPE_CHECKING:
    import rerun as rr

    from lcdata.dataset.schema import PairRecord

Array = NDArray[np.float64]

WHITE = (255, 255, 255)
FRAME_PX = 4.0


@dataclass(frozen=True, eq=False)
class Row:
    """A pair on the timelines.

    Args:
        number: Its place on the timeline `pair`.
        record: Row of the data set.
        content: What is shown of it.
    """

    number: int
    record: PairRecord
    content: Content


class PairSender:
    """Sends pairs block by block; holds none of them.

    Args:
        recording: Where to send them.
        shown: What the review shows.
        frustum_m: Depth at which frustums end.
    """

    def __init__(self, recording: rr.RecordingStream, shown: Shown, *, frustum_m: float) -> None:
        self.recording = recording
        self.shown = shown
        self.frustum_m = frustum_m
        self._camera: Camera | None = None
        self._image = ""
        self._entities: set[str] = set()

    def send(self, rows: Sequence[Row]) -> None:
        """Send pairs, in the order of the timeline."""
        if not rows:
            return
        times = time_columns(rows)
        for row in rows:
            self._send_camera(row)
        self._send_images(rows)
        self._send_clouds(rows, times)
        for source in self.shown.sources:
            self._send_overlay(source, rows, times)
        self.send_results(rows)

    def send_results(self, rows: Sequence[Row]) -> None:
        """Send what depends on results alone: verdicts, frustums and matched lines."""
        times = time_columns(rows)
        for view in self.shown.views:
            self._send_verdicts(view.key, rows, times)
        for source in self.shown.sources:
            if source != names.GROUND_TRUTH:
                self._send_frustums(source, rows, times)
        for method in self.shown.trials.methods:
            self._send_lines(method, rows, times)

    def send_overlay(self, source: str, rows: Sequence[Row]) -> None:
        """Send one source's overlays alone."""
        self._send_overlay(source, rows, time_columns(rows))

    def _once(self, entity: str, *archetypes: Any) -> None:
        """What an entity has for all time, among it its frame: a view complains of one without."""
        if entity not in self._entities:
            self._entities.add(entity)
            self.recording.log(entity, *archetypes, static=True)

    def _send_camera(self, row: Row) -> None:
        """The ground truth's camera; again only when it changes."""
        import rerun as rr

        camera = self.shown.dataset.camera(row.record.scenario)
        if camera == self._camera:
            return
        self._camera = camera
        self.recording.send_columns(
            names.CAMERA,
            time_columns([row]),
            rr.Pinhole.columns(
                image_from_camera=[plane(camera)],
                resolution=[[camera.width, camera.height]],
                camera_xyz=[rr.ViewCoordinates.RDF],
                parent_frame=[names.FRAME_CAMERA],
                child_frame=[names.FRAME_IMAGE],
                image_plane_distance=[self.frustum_m],
                color=[colours.GREEN],
            ),
        )

    def _send_images(self, rows: Sequence[Row]) -> None:
        """An entity for each scenario and kind of file: the viewer takes images for a video.

        Frames must not change in size or coding, which those of another camera would.
        """
        import rerun as rr

        groups: list[tuple[str, list[Row]]] = []
        for row in rows:
            kind = row.content.media_type.rpartition("/")[2]
            entity = names.image(row.record.scenario, kind) if kind else ""
            if not groups or groups[-1][0] != entity:
                groups.append((entity, []))
            groups[-1][1].append(row)
        for entity, group in groups:
            times = time_columns(group)
            if self._image not in ("", entity):
                # Not `rr.Clear`: a viewer that fetches chunks as it needs them goes on showing it.
                nothing = rr.EncodedImage.columns(blob=[b""], media_type=[""]).partition([0])
                self.recording.send_columns(self._image, time_columns(group[:1]), nothing)
            self._image = entity
            if entity:
                self._once(entity, rr.CoordinateFrame(names.FRAME_IMAGE))
                columns = rr.EncodedImage.columns(
                    blob=[row.content.image for row in group],
                    media_type=[row.content.media_type for row in group],
                )
                self.recording.send_columns(entity, times, columns)

    def _send_clouds(self, rows: Sequence[Row], times: list[Any]) -> None:
        import rerun as rr

        self._once(
            names.CLOUD,
            rr.CoordinateFrame(names.FRAME_LIDAR),
            rr.Points3D.from_fields(radii=rr.Radius.ui_points(1.0)),
        )
        positions = np.concatenate([row.content.points for row in rows])
        packed = np.concatenate([row.content.colours for row in rows])
        columns = rr.Points3D.columns(positions=positions, colors=packed)
        lengths = [len(row.content.points) for row in rows]
        self.recording.send_columns(names.CLOUD, times, columns.partition(lengths))

    def _send_overlay(self, source: str, rows: Sequence[Row], times: list[Any]) -> None:
        """The cloud in the image; nothing where there is no estimate."""
        import rerun as rr

        entity = names.overlay(source, "cloud")
        self._once(
            entity,
            rr.CoordinateFrame(names.FRAME_IMAGE),
            rr.Points2D.from_fields(radii=rr.Radius.ui_points(1.3), draw_order=10.0),
        )
        overlays = [row.content.overlays[source] for row in rows]
        columns = rr.Points2D.columns(
            positions=np.concatenate([overlay.pixels for overlay in overlays]),
            colors=np.concatenate([overlay.colours for overlay in overlays]),
        )
        lengths = [len(overlay.pixels) for overlay in overlays]
        self.recording.send_columns(entity, times, columns.partition(lengths))

    def _send_verdicts(self, key: str, rows: Sequence[Row], times: list[Any]) -> None:
        """A frame around the image that says in words and colour how wrong the extrinsic is."""
        import rerun as rr

        entity = names.overlay(key, "verdict")
        self._once(
            entity,
            rr.CoordinateFrame(names.FRAME_IMAGE),
            rr.Boxes2D.from_fields(radii=rr.Radius.ui_points(2.0), draw_order=40.0),
            rr.Image.from_fields(draw_order=50.0),
        )
        sizes, frames, pictures = [], [], []
        for row in rows:
            camera = self.shown.dataset.camera(row.record.scenario)
            lines, colour = verdicts(self.shown, key, row.record)
            sizes.append([camera.width, camera.height])
            frames.append(colour)
            pictures.append(banner(lines, camera.height))
        halves = 0.5 * (np.array(sizes, np.float32) - FRAME_PX)
        boxes = rr.Boxes2D.columns(
            half_sizes=halves, centers=0.5 * np.array(sizes, np.float32), colors=frames
        )
        formats = [
            rr.components.ImageFormat(
                width=p.shape[1],
                height=p.shape[0],
                color_model="L" if p.ndim == 2 else "RGB",
                channel_datatype="U8",
            )
            for p in pictures
        ]
        images = rr.Image.columns(buffer=[p.tobytes() for p in pictures], format=formats)
        self.recording.send_columns(entity, times, [*boxes, *images])

    def _send_frustums(self, source: str, rows: Sequence[Row], times: list[Any]) -> None:
        import rerun as rr

        entity = names.frustum(source)
        self._once(
            entity,
            rr.CoordinateFrame(names.FRAME_LIDAR),
            rr.LineStrips3D.from_fields(
                colors=[self.shown.colours[source]], radii=rr.Radius.ui_points(1.5)
            ),
        )
        strips, lengths = [], []
        for row in rows:
            T = self.shown.extrinsics(row.record)[source]
            camera = self.shown.dataset.camera(row.record.scenario).undistorted()
            found = [] if T is None else frustum(camera, T, self.frustum_m)
            strips += [strip.astype(np.float32) for strip in found]
            lengths.append(len(found))
        columns = rr.LineStrips3D.columns(strips=strips)
        self.recording.send_columns(entity, times, columns.partition(lengths))

    def _send_lines(self, method: str, rows: Sequence[Row], times: list[Any]) -> None:
        """Matched lines: in the cloud, in the image (white), and the one put into the other."""
        colour = self.shown.colours[method]
        in_cloud: list[Sequence[Array]] = []
        in_image: list[Sequence[Array]] = []
        projected: list[Sequence[Array]] = []
        for row in rows:
            trial = self.shown.trials.of_pair(row.record.pair_id).get(method)
            T = trial.T_camera_lidar_estimated if trial else None
            if trial is None or T is None:
                for strips in (in_cloud, in_image, projected):
                    strips.append([])
                continue
            lidar, image = matches_of(trial, row.record.pair_id)
            camera = self.shown.dataset.camera(row.record.scenario)
            in_cloud.append(list(lidar))
            in_image.append(image_strips(camera, image))
            projected.append(project_strips(camera, T, lidar))
        self._send_strips(names.lines(method), in_cloud, times, colour, 1.5)
        # Those of the image below and wider: white shows where they agree.
        path = names.overlay(method, "lines_image")
        self._send_strips(path, in_image, times, WHITE, 1.8, draw_order=20.0)
        path = names.overlay(method, "lines_cloud")
        self._send_strips(path, projected, times, colour, 0.9, draw_order=30.0)

    def _send_strips(
        self,
        entity: str,
        strips: Sequence[Sequence[Array]],
        times: list[Any],
        colour: colours.RGB,
        radius: float,
        draw_order: float | None = None,
    ) -> None:
        """Lines of each pair, in the image if they have an order there, else in the cloud."""
        import rerun as rr

        if entity not in self._entities and not any(strips):
            return  # most methods match no lines
        flat = [strip.astype(np.float32) for found in strips for strip in found]
        lengths = [len(found) for found in strips]
        radii = rr.Radius.ui_points(radius)
        if draw_order is None:
            style = rr.LineStrips3D.from_fields(colors=[colour], radii=radii)
            self._once(entity, rr.CoordinateFrame(names.FRAME_LIDAR), style)
            columns = rr.LineStrips3D.columns(strips=flat)
        else:
            style_2d = rr.LineStrips2D.from_fields(
                colors=[colour], radii=radii, draw_order=draw_order
            )
            self._once(entity, rr.CoordinateFrame(names.FRAME_IMAGE), style_2d)
            columns = rr.LineStrips2D.columns(strips=flat)
        self.recording.send_columns(entity, times, columns.partition(lengths))


def time_columns(rows: Sequence[Row]) -> list[Any]:
    """Both timelines of some pairs."""
    import rerun as rr

    stamps = np.array([row.record.stamp_lidar_ns for row in rows], "M8[ns]")
    return [
        rr.TimeColumn(names.PAIR, sequence=[row.number for row in rows]),
        rr.TimeColumn(names.STAMP, timestamp=stamps),
    ]
