"""How the viewer lays out the review of one pair."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcdata.geometry import se3
from lcdata.geometry.camera import Camera
from lcdata.review import names
from lcdata.review.blending import reduced
from lcdata.review.landscape_figure import SIZE_PX

if TYPE_CHECKING:
    import rerun.blueprint as rrb

Array = NDArray[np.float64]


def blueprint(
    poses: Mapping[str, Array], middle: str, camera: Camera, has_landscape: bool
) -> rrb.Blueprint:
    """Coloured cloud and blended image above, a tab for each pose; landscape and text below.

    Args:
        poses: 4x4 `T_camera_lidar` by source.
        middle: The pose whose tabs are shown first.
        camera: Of the pair.
        has_landscape: Whether there is one.
    """
    import rerun.blueprint as rrb

    first = list(poses).index(middle)
    clouds = rrb.Tabs(*(_cloud_view(s, T) for s, T in poses.items()), active_tab=first)
    blends = rrb.Tabs(*(_blended_view(s, reduced(camera)) for s in poses), active_tab=first)
    text = rrb.TextDocumentView(origin=names.PAIR_TEXT, name="This pair")
    below: list[Any] = [text]
    if has_landscape:
        below.insert(0, _landscape_view())
    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(clouds, blends, column_shares=[1, 1]),
            rrb.Horizontal(*below, column_shares=[3, 2][-len(below) :]),
            row_shares=[1, 1],
        ),
        rrb.TimePanel(
            state="collapsed",
            timeline=names.BLEND,
            play_state="playing",
            loop_mode="all",
            fps=25.0,
        ),
        rrb.SelectionPanel(state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _cloud_view(source: str, T_camera_lidar: Array) -> Any:
    """The coloured cloud from behind the camera, upright as the LiDAR is."""
    import rerun.blueprint as rrb

    T_lidar_camera = se3.inverse(T_camera_lidar)
    eye, forward = T_lidar_camera[:3, 3], T_lidar_camera[:3, 2]
    return rrb.Spatial3DView(
        origin="/",
        contents=[
            f"/{names.COLOURED}/{source}/**",
            f"/{names.COLOURED}/{names.GROUND_TRUTH}/camera",
        ],
        name=f"coloured: {names.title(source)}",
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye - 1.6 * forward + [0.0, 0.0, 0.8],
            look_target=eye + 2.0 * forward,
            eye_up=[0.0, 0.0, 1.0],
        ),
        line_grid=False,
        background=[24, 26, 31],
    )


def _blended_view(source: str, camera: Camera) -> Any:
    import rerun.blueprint as rrb

    return rrb.Spatial2DView(
        origin="/",
        contents=[f"/{names.IMAGE}", f"/{names.BLENDED}/{source}/**"],
        name=f"blended: {names.title(source)}",
        visual_bounds=rrb.VisualBounds2D(x_range=[0, camera.width], y_range=[0, camera.height]),
    )


def _landscape_view() -> Any:
    import rerun.blueprint as rrb

    width, height = SIZE_PX
    return rrb.Spatial2DView(
        origin=f"/{names.LANDSCAPE}",
        name="NID landscape",
        background=[23, 25, 28],
        visual_bounds=rrb.VisualBounds2D(x_range=[0, width], y_range=[0, height]),
    )
