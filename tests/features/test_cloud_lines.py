"""3D lines of worlds whose edges are known exactly, of real scans, and of hopeless input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from box_world import (
    BoxWorld,
    beam_directions,
    distance_to_edges,
    pose,
    room_with_boxes,
    scan,
    tilt,
    yard_with_boxes,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from lcdata.features.cloud_lines import BOUNDARY, PLANE_PLANE, CloudLines, extract_cloud_lines

Array = np.ndarray


def lines_of(image: Array) -> CloudLines:
    return extract_cloud_lines(image.reshape(-1, 3).astype(np.float32), image.shape[:2])


@pytest.fixture(scope="module")
def beams() -> Array:
    return beam_directions(columns=1024)


@pytest.fixture(scope="module", params=["room", "yard"])
def worlds(request: pytest.FixtureRequest) -> list[tuple[BoxWorld, CloudLines]]:
    beams = beam_directions(columns=2048)
    make = room_with_boxes if request.param == "room" else yard_with_boxes
    return [
        (world, lines_of(scan(world, beams, np.random.default_rng(seed))))
        for seed, world in ((seed, make(seed)) for seed in range(3))
    ]


def test_lines_lie_on_true_edges(worlds: list[tuple[BoxWorld, CloudLines]]) -> None:
    distances: dict[int, list[Array]] = {PLANE_PLANE: [], BOUNDARY: []}
    for world, lines in worlds:
        off = distance_to_edges(lines.segments, world.edges())
        for kind, found in distances.items():
            found.append(off[lines.kind == kind])
        assert (lines.kind == PLANE_PLANE).sum() >= 15
        assert (lines.kind == BOUNDARY).sum() >= 12
    creases = np.concatenate(distances[PLANE_PLANE])
    outlines = np.concatenate(distances[BOUNDARY])
    # 2 cm of range noise, up to 40 m away.
    assert np.median(creases) < 0.003
    assert np.quantile(creases[:, 2:-2], 0.9) < 0.006
    assert np.median(outlines) < 0.012
    assert np.quantile(np.median(outlines, axis=1), 0.9) < 0.05


def test_standard_deviations_are_honest(worlds: list[tuple[BoxWorld, CloudLines]]) -> None:
    for kind in (PLANE_PLANE, BOUNDARY):
        ratio = []
        for world, lines in worlds:
            chosen = lines.kind == kind
            middle = distance_to_edges(lines.segments[chosen], world.edges(), samples=3)[:, 1]
            ratio.append(middle / lines.std[chosen])
        assert 0.1 < np.median(np.concatenate(ratio)) < 1.5
        assert np.quantile(np.concatenate(ratio), 0.9) < 4.0


def test_outlines_are_not_biased(beams: Array) -> None:
    """A board in front of a wall: as wide and as high as it is, on average over many places."""
    errors = []
    for n in range(8):
        rng = np.random.default_rng(n)
        half = np.array([0.05, rng.uniform(0.4, 0.8), rng.uniform(0.4, 0.8)])
        world = BoxWorld(
            np.array(
                [
                    tilt(*rng.uniform(-6, 6, 2)) @ pose((rng.uniform(4, 9), 0, 0)),
                    pose((0, 0, 0)),
                ]
            ),
            np.array([half, [14.0, 12.0, 4.0]]),
            np.array([False, True]),
        )
        lines = lines_of(scan(world, beams, rng))
        T = np.linalg.inv(world.T_lidar_box[0])
        local = lines.segments @ T[:3, :3].T + T[:3, 3]
        on_board = (np.abs(local[..., 0]) < 0.1).all(axis=1) & (lines.kind == BOUNDARY)
        for middle in local[on_board].mean(axis=1):
            axis = 1 if abs(middle[1]) / half[1] > abs(middle[2]) / half[2] else 2
            errors.append(abs(middle[axis]) - half[axis])
    assert len(errors) > 25
    assert abs(np.mean(errors)) < 3 * np.std(errors) / np.sqrt(len(errors)) + 0.001
    assert np.abs(errors).max() < 0.06


def test_no_crease_between_a_box_and_what_is_far_behind(beams: Array) -> None:
    world = BoxWorld(
        np.array([pose((5, 0, 0.2), 30), pose((0, 0, 0))]),
        np.array([[0.5, 0.5, 0.5], [12.0, 12.0, 3.0]]),
        np.array([False, True]),
    )
    lines = lines_of(scan(world, beams, np.random.default_rng(0)))
    off = distance_to_edges(lines.segments, world.edges())
    assert off.max() < 0.12
    boxed = np.linalg.norm(lines.segments.mean(axis=1) - [5, 0, 0.2], axis=1) < 1.2
    assert (lines.kind[boxed] == PLANE_PLANE).sum() == 1  # the one vertical edge between two faces
    assert (lines.kind[boxed] == BOUNDARY).sum() >= 4


@pytest.mark.parametrize("columns", [512, 1024])
def test_a_corner_across_the_seam_is_found_as_any_other(columns: int) -> None:
    """Turning the world by half a turn puts other edges on the seam and changes nothing else."""
    counts = []
    for yaw in (0.0, 90.0, 180.0):
        turn = pose((0, 0, 0), yaw)
        room = room_with_boxes(5)
        world = BoxWorld(turn @ room.T_lidar_box, room.half_sizes, room.hollow)
        lines = lines_of(scan(world, beam_directions(columns=columns), np.random.default_rng(1)))
        assert np.quantile(distance_to_edges(lines.segments, world.edges()), 0.9) < 0.05
        counts.append(len(lines))
    assert max(counts) - min(counts) <= 0.35 * max(counts)


def test_a_wall_across_the_seam_has_no_line_there(beams: Array) -> None:
    wall = BoxWorld(np.array([pose((-6, 0, 0))]), np.array([[0.5, 9.0, 5.0]]), np.array([False]))
    lines = lines_of(scan(wall, beams, np.random.default_rng(0)))
    behind = np.abs(lines.segments[..., 1]).max(axis=1) < 2.0
    assert not behind.any()


def test_the_borders_of_a_crop_are_no_edges() -> None:
    """A window of azimuth, given as columns that do not exist or as columns without returns."""
    room = BoxWorld(np.array([pose((0, 0, 0.5))]), np.array([[9.0, 7.0, 2.5]]), np.array([True]))
    crop = scan(room, beam_directions(columns=512, azimuth_deg=90), np.random.default_rng(0))
    full = scan(room, beam_directions(columns=1024), np.random.default_rng(0))
    full[:, :384] = np.nan
    full[:, 640:] = 0
    for image in (crop, full):
        lines = lines_of(image)
        assert len(lines) >= 2
        assert (lines.kind == PLANE_PLANE).all()
        assert distance_to_edges(lines.segments, room.edges()).max() < 0.05


@pytest.mark.parametrize("field", ["ring", "order", "elevation"])
def test_unorganised_clouds_give_the_lines_of_the_scan(field: str, beams: Array) -> None:
    world = room_with_boxes(7)
    image = scan(world, beams, np.random.default_rng(3))
    expected = lines_of(image)
    points = image.reshape(-1, 3)
    ring = np.repeat(np.arange(128), 1024)
    seen = np.isfinite(points).all(axis=1)
    points, ring = points[seen], ring[seen]
    if field != "order":
        shuffled = np.random.default_rng(0).permutation(len(points))
        points, ring = points[shuffled], ring[shuffled]
    lines = extract_cloud_lines(points, ring=ring if field == "ring" else None)
    off = distance_to_edges(lines.segments, world.edges())
    assert np.median(off) < 0.006
    assert np.quantile(off, 0.9) < 0.05
    assert abs(len(lines) - len(expected)) <= 0.15 * len(expected)


def test_rings_in_any_order_and_staggered_columns_are_put_right(beams: Array) -> None:
    world = room_with_boxes(8)
    image = scan(world, beams, np.random.default_rng(4))
    expected = lines_of(image)
    flipped = lines_of(image[::-1])
    staggered = np.stack([np.roll(row, 9 * (n % 4), axis=0) for n, row in enumerate(image)])
    for lines in (flipped, lines_of(staggered), lines_of(image[:, ::-1])):
        assert abs(len(lines) - len(expected)) <= 0.15 * len(expected)
        assert np.quantile(distance_to_edges(lines.segments, world.edges()), 0.9) < 0.05


@pytest.mark.parametrize(
    "points, organised",
    [
        (np.zeros((0, 3)), None),
        (np.zeros((0, 3)), (0, 0)),
        (np.full((4096, 3), np.nan), (16, 256)),
        (np.zeros((4096, 3)), (16, 256)),
        (np.full((4096, 3), np.nan), None),
        (np.ones((4096, 3)), (16, 256)),
        (np.full((4096, 3), np.inf), (16, 256)),
        (np.ones((3, 3)), None),
        (beam_directions(1, 2048).reshape(-1, 3) * 5.0, (1, 2048)),
        (beam_directions(1, 2048).reshape(-1, 3) * 5.0, None),
        (beam_directions(16, 512).reshape(-1, 3) * 5.0, (16, 512)),
    ],
    ids=[
        "empty", "empty image", "NaN", "zeros", "NaN, unorganised", "one point", "infinite",
        "three points", "one ring", "one ring, unorganised", "a sphere",
    ],
)  # fmt: skip
def test_hopeless_clouds_have_no_lines(points: Array, organised: tuple[int, int] | None) -> None:
    lines = extract_cloud_lines(points, organised)
    assert len(lines) == 0
    assert lines.segments.shape == (0, 2, 3)
    assert lines.kind.dtype == np.uint8


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    rings=st.integers(1, 24),
    columns=st.integers(1, 80),
    missing=st.floats(0, 1),
    scale=st.sampled_from([1e-3, 1.0, 30.0, 1e6]),
    organised=st.booleans(),
)
def test_noise_is_never_an_error(
    seed: int, rings: int, columns: int, missing: float, scale: float, organised: bool
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(0, scale, (rings * columns, 3))
    points[rng.random(len(points)) < missing] = np.nan
    lines = extract_cloud_lines(points, (rings, columns) if organised else None)
    assert np.isfinite(lines.segments).all()
    assert (lines.std > 0).all()
    assert (lines.support > 0).all()


def test_the_same_scan_gives_the_same_lines(beams: Array) -> None:
    image = scan(yard_with_boxes(3), beams, np.random.default_rng(0))
    assert np.array_equal(lines_of(image).segments, lines_of(image).segments)


def test_the_cloud_is_left_as_it_is(beams: Array) -> None:
    points = scan(room_with_boxes(0), beams, np.random.default_rng(0)).reshape(-1, 3)
    points = points.astype(np.float32)
    before = points.copy()
    extract_cloud_lines(points, (128, 1024))
    assert np.array_equal(points, before, equal_nan=True)


def real_cloud(path: Path) -> tuple[Array, Array | None]:
    from pypcd4 import PointCloud

    cloud = PointCloud.from_path(path)
    fields = cloud.pc_data
    points = np.stack([fields[axis] for axis in "xyz"], axis=1)
    return points, fields["ring"].astype(int) if "ring" in cloud.fields else None


def test_kitti_has_lines_but_hardly_any_along_a_ring_of_the_road(shared: Path) -> None:
    along_rings, total = 0, 0
    for path in sorted((shared / "data" / "kitti_road").glob("*.pcd")):
        lines = extract_cloud_lines(real_cloud(path)[0])
        assert 20 <= len(lines) <= 300, path.name
        along_rings, total = along_rings + ring_lines_on_the_ground(lines), total + len(lines)
    assert along_rings <= 0.02 * total


def test_a_pandar_gives_the_same_lines_without_its_ring_field(shared: Path) -> None:
    points, ring = real_cloud(shared / "data" / "opencalib_crossing" / "calib.pcd")
    with_ring = extract_cloud_lines(points, ring=ring)
    without = extract_cloud_lines(points)
    assert 20 <= len(with_ring) <= 200
    assert abs(len(with_ring) - len(without)) <= 0.1 * len(with_ring)
    assert ring_lines_on_the_ground(with_ring) <= 1


def ring_lines_on_the_ground(lines: CloudLines) -> int:
    """Outlines at constant elevation on the road: what a ring taken for an edge looks like."""
    start, end = lines.segments[:, 0], lines.segments[:, 1]
    azimuth = np.arctan2(lines.segments[..., 1], lines.segments[..., 0])
    span = np.abs((np.diff(azimuth)[:, 0] + np.pi) % (2 * np.pi) - np.pi)
    rise = np.abs(
        start[:, 2] / np.linalg.norm(start, axis=1) - end[:, 2] / np.linalg.norm(end, axis=1)
    )
    level = (span > np.radians(3)) & (rise < np.radians(0.15))
    ground = lines.segments[..., 2].max(axis=1) < -1.4
    return int((level & ground & (lines.kind == BOUNDARY)).sum())
