"""Input that nobody should give: every method refuses it by name or says that it failed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcdata.calibrators import available, calibrate
from lcdata.errors import LcdataError
from lcdata.simulation import render_pair

OURS = ("calib_anything", "cascade", "crlf", "edge", "nid", "nid_edge", "plk", "projection", "wide")


def hostile(pair):
    """Pairs by what is wrong with them."""
    rng = np.random.default_rng(0)
    n = len(pair.points)
    flat = np.column_stack([np.full(n, 5.0), rng.uniform(-5, 5, (n, 2))]).astype(np.float32)
    holes = np.where(rng.random((n, 1)) < 0.5, np.nan, pair.points).astype(np.float32)
    endless = np.where(rng.random((n, 1)) < 0.1, np.inf, pair.points).astype(np.float32)
    none, three = slice(0, 0), slice(0, 3)
    loose = replace(pair, organised=None, ring=None)
    return {
        "all points are NaN": replace(pair, points=np.full_like(pair.points, np.nan)),
        "half of the points are NaN": replace(pair, points=holes),
        "points at infinity": replace(pair, points=endless),
        "millimetres for metres, a thousand times": replace(pair, points=pair.points * 1e6),
        "one plane": replace(pair, points=flat),
        "no points": replace(loose, points=pair.points[none], intensity=pair.intensity[none]),
        "three points": replace(loose, points=pair.points[three], intensity=pair.intensity[three]),
        "intensities are NaN": replace(pair, intensity=np.full(n, np.nan, np.float32)),
        "intensities are alike": replace(pair, intensity=np.ones(n, np.float32)),
        "no intensities": replace(pair, intensity=None),
        "black image": replace(pair, image=np.zeros_like(pair.image)),
        "grey image": replace(pair, image=pair.image[:, :, 0].copy()),
    }


@pytest.fixture(scope="module")
def pairs():
    return hostile(render_pair("yard", seed=41, columns=512, width=320, height=180))


def test_no_method_is_forgotten():
    assert set(OURS) <= set(available())


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("method", OURS)
def test_a_method_refuses_or_fails_with_a_pose(pairs, method):
    truth = next(iter(pairs.values())).T_camera_lidar
    for name, pair in pairs.items():
        try:
            found = calibrate(pair, truth, method=method)
        except LcdataError as error:
            assert len(str(error)) > 10, name
            continue
        assert np.isfinite(found.T_camera_lidar).all(), name
        assert found.converged or found.message, name
        unusable = ("all points", "millimetres", "one plane", "no points", "three", "black")
        assert not (found.converged and name.startswith(unusable)), name
