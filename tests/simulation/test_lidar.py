from __future__ import annotations

import numpy as np
import pytest

from lcdata.simulation.lidar import MAX_RANGE_M, POINT, RINGS, SCAN_NS, Ouster
from lcdata.simulation.mesh import Material, quad
from lcdata.simulation.raycast import RayCaster

WHITE = Material("#ffffff", noise=0.0)
DISTANCE = 6.0


@pytest.fixture(scope="module")
def wall() -> RayCaster:
    """A large wall at x = 6 m."""
    y, z = 60.0, 30.0
    x = DISTANCE
    return RayCaster(quad([x, y, -z], [x, -y, -z], [x, -y, z], [x, y, z], WHITE))


def _scan(wall: RayCaster, lidar: Ouster) -> np.ndarray:
    return lidar.scan(wall, np.eye(4), 1.0, np.random.default_rng(0))


def test_ranges_of_a_wall_are_those_of_the_closed_form(wall: RayCaster) -> None:
    lidar = Ouster(512, noisy=False)
    origin, direction, _, _ = lidar.beams()
    records = _scan(wall, lidar)
    with np.errstate(divide="ignore"):
        expected = (DISTANCE - origin[:, 0]) / direction[:, 0]
    ahead = (expected > 0) & (expected < 50)
    assert ahead.sum() > 20_000
    np.testing.assert_allclose(records["range"][ahead] / 1000, expected[ahead], atol=6e-4)
    np.testing.assert_allclose(records["x"][ahead], DISTANCE, atol=6e-4)
    behind = direction[:, 0] < 0
    assert (records["range"][behind] == 0).all()
    assert (records["x"][behind] == 0).all()


def test_noise_is_centimetres_and_some_beams_do_not_return(wall: RayCaster) -> None:
    exact, noisy = _scan(wall, Ouster(1024, noisy=False)), _scan(wall, Ouster(1024))
    near = (exact["range"] > 0) & (exact["range"] < 7000) & (noisy["range"] > 0)
    errors = noisy["range"][near].astype(float) - exact["range"][near]
    assert 8 < errors.std() < 25
    assert abs(errors.mean()) < 1
    lost = (exact["range"] > 0) & (exact["range"] < 7000) & (noisy["range"] == 0)
    assert 0.0005 < lost.sum() / near.sum() < 0.05
    assert noisy["range"].max() <= 1000 * MAX_RANGE_M + 200


def test_intensity_falls_with_range_and_angle(wall: RayCaster) -> None:
    records = _scan(wall, Ouster(512))
    middle = records.reshape(RINGS, 512)[RINGS // 2]
    hit = middle["range"] > 0
    near = middle["intensity"][hit & (middle["range"] < 6200)].mean()
    far = middle["intensity"][hit & (middle["range"] > 12_000)].mean()
    assert near > 2 * far > 0


@pytest.mark.parametrize("columns", [512, 1024, 2048])
def test_a_scan_is_an_image_of_rings_and_columns(wall: RayCaster, columns: int) -> None:
    lidar = Ouster(columns)
    _, direction, t, _ = lidar.beams()
    grid = direction.reshape(RINGS, columns, 3)
    elevation = np.rad2deg(np.arcsin(grid[..., 2]))
    np.testing.assert_allclose(elevation[[0, -1], 0], [22.5, -22.5], atol=1e-4)
    azimuth = np.unwrap(np.arctan2(grid[..., 1], grid[..., 0]), axis=1)
    assert (np.diff(azimuth, axis=1) < 0).all(), "columns run clockwise"
    spread = np.ptp(np.unwrap(azimuth, axis=0), axis=0)
    assert spread.max() <= 2 * np.pi / columns * 1.01, "columns line up"
    assert t.max() < SCAN_NS
    ring = _scan(wall, lidar)["ring"].reshape(RINGS, columns)
    assert (ring == np.arange(RINGS)[:, None]).all()


def test_the_azimuth_window_blanks_what_is_outside(wall: RayCaster) -> None:
    records = _scan(wall, Ouster(512, azimuth_window_deg=60.0))
    hit = records["range"] > 0
    angle = np.rad2deg(np.arctan2(records["y"][hit], records["x"][hit]))
    assert 29 < np.abs(angle).max() < 31
    assert hit.sum() == pytest.approx(RINGS * 512 / 6, rel=0.05)
    assert (records["t"][~hit] == 0).mean() > 0.95


def test_points_are_laid_out_as_by_the_driver() -> None:
    offsets = {name: POINT.fields[name][1] for name in POINT.names}
    assert POINT.itemsize == 48
    assert offsets == {
        "x": 0, "y": 4, "z": 8, "intensity": 16, "t": 20,
        "reflectivity": 24, "ring": 26, "ambient": 28, "range": 32,
    }  # fmt: skip
