from __future__ import annotations

import numpy as np

from lcdata.features.paint_lines import extract_paint_lines


def painted_floor(rings=64, columns=2048, height=1.8, noise=0.0):
    """Scan of a floor with a white stripe 10 cm wide from (4, -3) to (9, 2).

    Returns:
        points, intensity, (rings, columns) and the two borders (2, 2, 3).
    """
    rng = np.random.default_rng(0)
    elevation = np.deg2rad(np.linspace(-2, -30, rings))[:, None]
    azimuth = np.linspace(np.pi, -np.pi, columns, endpoint=False)[None]
    distance = height / np.sin(-elevation) + rng.normal(size=(rings, columns)) * noise
    points = np.stack(
        [
            distance * np.cos(elevation) * np.cos(azimuth),
            distance * np.cos(elevation) * np.sin(azimuth),
            distance * np.sin(elevation) + 0 * azimuth,
        ],
        -1,
    ).reshape(-1, 3)
    start, end = np.array([4.0, -3.0]), np.array([9.0, 2.0])
    along = (end - start) / np.linalg.norm(end - start)
    across = np.array([-along[1], along[0]])
    offset = points[:, :2] - start
    on = (np.abs(offset @ across) < 0.05) & (offset @ along > 0)
    on &= offset @ along < np.linalg.norm(end - start)
    intensity = np.where(on, 80.0, 20.0) + rng.normal(size=len(points))
    borders = [[[*(p + s * 0.05 * across), -height] for p in (start, end)] for s in (-1.0, 1.0)]
    return points.astype(np.float32), intensity, (rings, columns), np.array(borders)


def check(segments, borders, tolerance=0.02):
    """Both borders are found, and nothing else."""
    found = set()
    for segment in segments:
        for i, (a, b) in enumerate(borders):
            along = (b - a) / np.linalg.norm(b - a)
            off = segment - a
            off = off - (off @ along)[:, None] * along
            if np.linalg.norm(off, axis=1).max() < tolerance:
                found.add(i)
                break
        else:
            raise AssertionError(f"no border at {segment.tolist()}")
    assert found == {0, 1}


def test_borders_of_a_stripe_are_found_where_they_are():
    points, intensity, organised, borders = painted_floor(noise=0.005)
    segments, sigma = extract_paint_lines(points, intensity, organised)
    check(segments, borders)
    assert (sigma > 0).all()
    assert sigma.max() < 0.03


def test_unorganised_clouds_work_by_ring_and_by_order():
    points, intensity, (rings, columns), borders = painted_floor()
    ring = np.repeat(np.arange(rings), columns)
    order = np.random.default_rng(1).permutation(len(points))
    check(extract_paint_lines(points[order], intensity[order], ring=ring[order])[0], borders)
    # Rings by order begin in the middle of the stripe: two pieces, each known a little less well.
    check(extract_paint_lines(points, intensity)[0], borders, 0.025)


def test_what_is_as_narrow_as_a_few_beams_has_no_paint():
    points, _, organised, _ = painted_floor()
    shape = points.reshape(*organised, 3)
    azimuth = np.arctan2(shape[..., 1], shape[..., 0])
    height = shape[..., 2] / np.linalg.norm(shape[..., :2], axis=2)
    # A post 10 cm wide and 4.5 m away, one half of it dark, in front of a wall at 6 m.
    on = np.abs(azimuth) < 0.05 / 4.5
    depth = np.where(on, 4.5, 6.0)
    scan = np.stack([depth, depth * np.tan(azimuth), depth * height], -1)
    scan[np.abs(azimuth) > 0.5] = np.nan
    light = np.where(on, np.where(azimuth > 0, 80.0, 25.0), 50.0)
    cloud = scan.reshape(-1, 3).astype(np.float32)
    assert len(extract_paint_lines(cloud, light.reshape(-1), organised)[0]) == 0


def test_texture_and_noise_are_no_lines():
    points, _, organised, _ = painted_floor()
    rng = np.random.default_rng(2)
    # Speckle on every point is the worst case: some of its many steps are in line by chance.
    speckle = rng.uniform(20, 80, len(points))
    assert len(extract_paint_lines(points, speckle, organised)[0]) < 60
    assert len(extract_paint_lines(points, np.full(len(points), 7.0), organised)[0]) == 0


def test_no_intensity_no_points_no_rings():
    points, intensity, organised, _ = painted_floor(rings=8)
    assert len(extract_paint_lines(points, None, organised)[0]) == 0
    assert len(extract_paint_lines(points[:0], intensity[:0])[0]) == 0
    nothing = np.full_like(points, np.nan)
    assert len(extract_paint_lines(nothing, intensity, organised)[0]) == 0
    shuffled = np.random.default_rng(0).permutation(len(points))
    assert extract_paint_lines(points[shuffled], intensity[shuffled])[0].shape[1:] == (2, 3)
