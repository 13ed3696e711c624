"""How the viewer lays a review out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.review import names
from lcdata.review.errors import MEASURES

if TYPE_CHECKING:
    import rerun.blueprint as rrb

Array = NDArray[np.float64]


def blueprint(
    methods: Sequence[str],
    axis_tops: Mapping[str, float],
    *,
    size: tuple[int, int],
    root: str,
    T_root_camera: Array,
    lidar: Array,
) -> rrb.Blueprint:
    """Scene and images above, errors and text below.

    Args:
        methods: Names of the methods; none if there are no results.
        axis_tops: Upper end of the axis of each measure that has values.
        size: Width and height in pixels of the largest image.
        root: Frame that the scene is shown in.
        T_root_camera: 4x4 of the first pair, from behind which the scene is seen.
        lidar: (3,) where the LiDAR is in the root frame, metres.
    """
    import rerun.blueprint as rrb

    sources = [names.INITIAL, *methods, names.GROUND_TRUTH] if methods else [names.GROUND_TRUTH]
    images = rrb.Grid(
        *(_image_view(source, size) for source in sources),
        grid_columns=1 if len(sources) == 1 else 2 if len(sources) <= 4 else 3,
        name="cloud on image",
    )
    above = rrb.Horizontal(_scene_view(root, T_root_camera, lidar), images, column_shares=[2, 3])
    text = rrb.Tabs(
        rrb.TextDocumentView(origin=names.SUMMARY, name="Summary"),
        rrb.TextDocumentView(origin=names.PAIR_TEXT, name="This pair"),
        active_tab=0,
    )
    plots = [
        _plot(m.name, m.title, axis_tops[m.name], with_legend=i == 0)
        for i, m in enumerate(m for m in MEASURES if m.name in axis_tops)
    ]
    below: list[Any] = [text]
    if methods:
        verdicts = rrb.StateTimelineView(
            contents=[f"/{names.SCENARIO}", f"/{names.OUTCOMES}/**"],
            name="Right or wrong, pair by pair",
        )
        curves = [rrb.Horizontal(*plots)] if plots else []
        below.insert(0, rrb.Vertical(verdicts, *curves, row_shares=[4, 5][: 1 + len(curves)]))
    return rrb.Blueprint(
        rrb.Vertical(
            above,
            rrb.Horizontal(*below, column_shares=[3, 2][-len(below) :]),
            row_shares=[3, 2],
        ),
        rrb.TimePanel(state="collapsed", timeline=names.PAIR, play_state="paused", fps=2.0),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _scene_view(root: str, T_root_camera: Array, lidar: Array) -> Any:
    """The scene from behind and above the camera; from the side on which no mast hides the arm."""
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
        ],
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


def _image_view(source: str, size: tuple[int, int]) -> Any:
    import rerun.blueprint as rrb

    return rrb.Spatial2DView(
        origin=f"/{names.CAMERA}",
        contents=[f"/{names.IMAGES}/**", f"/{names.OVERLAYS}/{source}/**"],
        name=names.title(source),
        spatial_information=rrb.SpatialInformation(target_frame=names.FRAME_IMAGE),
        visual_bounds=rrb.VisualBounds2D(x_range=[0, size[0]], y_range=[0, size[1]]),
    )


def _plot(measure: str, title: str, top: float, with_legend: bool) -> Any:
    import rerun.blueprint as rrb

    return rrb.TimeSeriesView(
        origin=f"/{names.ERRORS}/{measure}",
        name=title,
        axis_y=rrb.ScalarAxis(range=(0.0, top), zoom_lock=False),
        plot_legend=rrb.PlotLegend(rrb.Corner2D.LeftTop, visible=with_legend),
    )
