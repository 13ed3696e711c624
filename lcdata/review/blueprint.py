"""How the viewer lays a review out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.review import colours, names
from lcdata.review.difference import TITLES as DIFFERENCES
from lcdata.review.errors import MEASURES
from lcdata.review.shown import Shown, View

if TYPE_CHECKING:
    import rerun.blueprint as rrb

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Axes:
    """Axes of the plots.

    Args:
        tops: Upper end of the axis of each measure that has errors.
        differences: Both ends of that of each measure that has differences.
    """

    tops: Mapping[str, float] = field(default_factory=dict)
    differences: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def blueprint(
    shown: Shown, axes: Axes, *, root: str, T_root_camera: Array, lidar: Array
) -> rrb.Blueprint:
    """Scene and images above, errors and text below.

    Args:
        shown: What the review shows.
        axes: Of the plots that there are.
        root: Frame that the scene is shown in.
        T_root_camera: 4x4 of the first pair, from behind which the scene is seen.
        lidar: (3,) where the LiDAR is in the root frame, metres.
    """
    import rerun.blueprint as rrb

    dataset = shown.dataset
    cameras = {scenario: dataset.camera(scenario) for scenario in dataset.scenarios}
    size = max(c.width for c in cameras.values()), max(c.height for c in cameras.values())
    wide = [name for name, camera in cameras.items() if camera.model != "pinhole"]
    images = rrb.Grid(
        *(_image_view(view, size) for view in shown.views),
        grid_columns=1 if len(shown.views) == 1 else 2 if len(shown.views) <= 4 else 3,
        name="cloud on image",
    )
    scene = _scene_view(root, T_root_camera, lidar, wide)
    above = rrb.Horizontal(scene, images, column_shares=[2, 3])
    text = rrb.Tabs(
        rrb.TextDocumentView(origin=names.SUMMARY, name="Summary"),
        rrb.TextDocumentView(origin=names.PAIR_TEXT, name="This pair"),
        active_tab=0,
    )
    plots = _plots(axes, compared=shown.comparison is not None)
    below: list[Any] = [text]
    lanes = []
    if shown.trials.methods:
        lanes = [
            rrb.StateTimelineView(
                contents=[f"/{names.SCENARIO}", f"/{names.OUTCOMES}/**"],
                name="Right or wrong, pair by pair",
            )
        ]
    if lanes or plots:
        rows = [*lanes, *plots]
        high = min(9.0, 1.5 * (2 + len(shown.trials.methods)))  # a lane for each method
        shares = [*([high] if lanes else []), *([5.0] * len(plots))]
        below.insert(0, rrb.Vertical(*rows, row_shares=shares))
    return rrb.Blueprint(
        rrb.Vertical(
            above,
            rrb.Horizontal(*below, column_shares=[3, 2][-len(below) :]),
            row_shares=[3, 2] if shown.comparison is None else [1, 1],
        ),
        rrb.TimePanel(state="collapsed", timeline=names.PAIR, play_state="paused", fps=2.0),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _plots(axes: Axes, compared: bool) -> list[Any]:
    """Rows of plots: errors, and under them the differences."""
    import rerun.blueprint as rrb

    wanted = [m for m in MEASURES if m.name in axes.tops]
    if compared:  # room for what is compared
        wanted = [m for m in wanted if m.name != "sigma_distance"]
    errors = [
        _plot(names.ERRORS, m.name, m.title, (0.0, axes.tops[m.name]), with_legend=i == 0)
        for i, m in enumerate(wanted)
    ]
    differences = [
        _plot(names.DIFFERENCE, name, DIFFERENCES[name], ends, with_legend=i == 0)
        for i, (name, ends) in enumerate(axes.differences.items())
    ]
    return [rrb.Horizontal(*row) for row in (errors, differences) if row]


def _scene_view(root: str, T_root_camera: Array, lidar: Array, wide: Sequence[str]) -> Any:
    """The scene from behind and above the camera; from the side on which no mast hides the arm.

    Pictures of the scenarios `wide`, whose lenses are no pinholes, would be false on a plane.
    """
    import rerun.blueprint as rrb

    eye, forward = T_root_camera[:3, 3], T_root_camera[:3, 2].copy()
    forward[2] = 0.0
    length = np.linalg.norm(forward)
    forward = forward / length if length > 0.1 else np.array([1.0, 0.0, 0.0])
    side = np.array([-forward[1], forward[0], 0.0])
    if side @ (lidar - eye) > 0:
        side = -side
    up = np.array([0.0, 0.0, 1.0])
    return rrb.Spatial3DView(
        origin="/",
        contents=[
            f"/{folder}/**"
            for folder in (
                names.ARM,
                names.JOINTS,
                names.TOWER,
                names.LIDAR,
                names.CAMERA,
                names.FRUSTUMS,
                names.LINES,
            )
        ]
        + [f"- /{names.IMAGES}/{names.part(scenario)}/**" for scenario in wide],
        name="Scene",
        spatial_information=rrb.SpatialInformation(target_frame=root, show_axes=False),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye - 1.9 * forward + 1.8 * side + 1.0 * up,
            look_target=eye + 0.8 * forward,
            eye_up=up,
        ),
        line_grid=False,
        background=[24, 26, 31],
    )


def _image_view(view: View, size: tuple[int, int]) -> Any:
    import rerun as rr
    import rerun.blueprint as rrb

    parts = [f"/{names.overlay(view.key, 'verdict')}"]
    overrides: dict[Any, Any] = {}
    for colour, source in zip(colours.SIDES, view.sources, strict=False):
        parts.append(f"/{names.overlay(source, 'cloud')}")
        if len(view.sources) > 1:
            flat = rr.Points2D.from_fields(colors=[colour])
            overrides[f"/{names.overlay(source, 'cloud')}"] = flat
        else:
            parts += [f"/{names.overlay(source, kind)}" for kind in ("lines_image", "lines_cloud")]
    return rrb.Spatial2DView(
        origin=f"/{names.CAMERA}",
        contents=[f"/{names.IMAGES}/**", *parts],
        name=view.title,
        overrides=overrides,
        spatial_information=rrb.SpatialInformation(target_frame=names.FRAME_IMAGE),
        visual_bounds=rrb.VisualBounds2D(x_range=[0, size[0]], y_range=[0, size[1]]),
    )


def _plot(
    folder: str, measure: str, title: str, ends: tuple[float, float], with_legend: bool
) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=f"/{folder}/{measure}",
        name=title,
        axis_y=rrb.ScalarAxis(range=ends, zoom_lock=False),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=with_legend),
    )
