"""The line methods on lenses that no pinhole can hold, whole way: render, undistort, calibrate."""

from __future__ import annotations

import numpy as np
import pytest

import lcdata
from lcdata.geometry import se3

LENSES = {
    "fisheye": lcdata.Camera("fisheye", 1280, 960, (400, 401, 640, 475), (0.02, -0.01, 3e-3, 0)),
    "omni": lcdata.Camera("omni", 1280, 1024, (1.2, 900, 901, 640, 515), (-0.1, 0.05, 1e-3, 0)),
    "equirectangular": lcdata.Camera("equirectangular", 2048, 1024),
}


@pytest.mark.slow
@pytest.mark.parametrize("lens", LENSES)
def test_a_wide_lens_is_calibrated_by_its_lines(lens):
    from lcdata.simulation import render_pair

    pair = render_pair("gym", pose_index=1, seed=7, columns=1024, camera=LENSES[lens])
    T = pair.T_camera_lidar
    initial = se3.exp([0.1, -0.12, 0.08, *np.deg2rad([3, -3, 3])]) @ T
    result = lcdata.calibrate([pair], initial, method="plk")
    assert result.converged, result.message
    assert np.rad2deg(se3.rotation_error(result.T_camera_lidar, T)) < 0.4
    assert se3.translation_error(result.T_camera_lidar, T) < 0.06
