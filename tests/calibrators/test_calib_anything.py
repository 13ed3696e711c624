from pathlib import Path

import cv2
import numpy as np
import pytest

import lcdata
from lcdata.calibrators import available, create
from lcdata.errors import CalibrationError
from lcdata.evaluation.protocol import perturb
from lcdata.geometry import se3
from lcdata.pair import Pair
from tests.segment_scene import patch_pair, patches

SHARED = Path(__file__).parents[3] / "shared" / "data"


def errors(found, pair):
    T = found.T_camera_lidar
    return (
        np.rad2deg(se3.rotation_error(T, pair.T_camera_lidar)),
        se3.translation_error(T, pair.T_camera_lidar),
    )


@pytest.fixture(scope="module")
def pair():
    return patch_pair(5)


@pytest.fixture(scope="module")
def prepared(pair):
    return create("calib_anything").prepare(pair)


def write_masks(folder, pair, seed):
    folder.mkdir(parents=True)
    label = patches(seed)
    for k in range(label.max() + 1):
        cv2.imwrite(str(folder / f"{k:03d}.png"), np.where(label == k, 255, 0).astype(np.uint8))
    return folder


def test_it_is_registered():
    assert "calib_anything" in available()


def test_the_pose_of_a_world_of_patches_is_found(pair, prepared):
    initial = perturb(pair.T_camera_lidar, 3.0, 0.1, np.random.default_rng(0))
    found = create("calib_anything").calibrate([pair], initial, [prepared])
    degrees, metres = errors(found, pair)
    assert degrees < 0.3 and metres < 0.05
    assert found.cost_final < found.cost_initial
    assert np.isfinite(found.covariance).all()
    assert np.linalg.eigvalsh(found.covariance)[0] > 0
    assert found.converged == (found.message == "")
    assert se3.sigma_distance(found.T_camera_lidar, pair.T_camera_lidar, found.covariance) < 5


def test_two_pairs_with_masks_from_files_one_without_intensity(tmp_path):
    first = patch_pair(5, points=5000, intensity=False, pair_id="a")
    second = patch_pair(6, points=5000, pair_id="b", T=first.T_camera_lidar)
    for pair, seed in ((first, 5), (second, 6)):
        write_masks(tmp_path / pair.pair_id, pair, seed)
    initial = perturb(first.T_camera_lidar, 2.0, 0.05, np.random.default_rng(1))
    found = lcdata.calibrate(
        [first, second],
        initial,
        method="calib_anything",
        masks=str(tmp_path),
        search_samples=1000,
    )
    assert "no intensity: normals and classes only" in found.message
    degrees, metres = errors(found, first)
    assert degrees < 0.3 and metres < 0.1


def test_bad_masks_are_named(tmp_path, pair):
    make = lambda folder: create("calib_anything", masks=str(folder))  # noqa: E731
    with pytest.raises(CalibrationError, match="no such file or folder"):
        make(tmp_path / "none").prepare(pair)
    (tmp_path / "empty").mkdir()
    with pytest.raises(CalibrationError, match="no images in it"):
        make(tmp_path / "empty").prepare(pair)
    for name, mask, match in (
        ("black", np.zeros((400, 640), np.uint8), "empty"),
        ("white", np.full((400, 640), 255, np.uint8), "all white"),
        ("small", np.eye(40, dtype=np.uint8) * 255, "40x40 pixels for an image of 640x400"),
    ):
        folder = write_masks(tmp_path / name, pair, 5)
        cv2.imwrite(str(folder / "bad.png"), mask)
        with pytest.raises(CalibrationError, match=match):
            make(folder).prepare(pair)
    (tmp_path / "few").mkdir()
    for k in (0, 1):
        cv2.imwrite(str(tmp_path / "few" / f"{k}.png"), np.eye(400, 640, dtype=np.uint8) * 255)
    with pytest.raises(CalibrationError, match="2 segments in the image"):
        make(tmp_path / "few").prepare(pair)


def test_an_image_without_a_picture_is_refused(pair):
    plain = Pair(np.full_like(pair.image, 9), pair.points, pair.intensity, pair.camera)
    with pytest.raises(CalibrationError, match="all pixels are 9"):
        create("calib_anything").prepare(plain)


def test_points_out_of_view_are_told_where_they_went(pair, prepared):
    behind = np.diag([-1.0, 1, -1, 1]) @ pair.T_camera_lidar
    found = create("calib_anything").calibrate([pair], behind, [prepared])
    assert not found.converged and found.degenerate
    assert np.array_equal(found.T_camera_lidar, behind)
    assert "no point in view" in found.message and "behind the camera" in found.message


def test_clouds_with_holes_or_nothing(pair):
    points = pair.points.copy()
    points[::7], points[1::7] = np.nan, 0.0
    light = pair.intensity.copy()
    light[2::7] = np.nan
    method = create("calib_anything")
    holes = method.prepare(Pair(pair.image, points, light, pair.camera))
    assert len(holes.cloud.points) == len(points) - sum(len(points[k::7]) for k in range(3))
    assert np.isfinite(holes.cloud.points).all() and np.isfinite(holes.cloud.intensity).all()
    flat = method.prepare(Pair(pair.image, points, np.full_like(light, 3), pair.camera))
    assert flat.cloud.intensity is None and "intensity tells nothing" in flat.note
    nothing = Pair(pair.image, points[:0], None, pair.camera)
    found = method.calibrate([nothing], pair.T_camera_lidar)
    assert "the cloud has no points" in found.message


def test_a_cloud_that_fits_nowhere_is_not_called_converged(pair):
    other = patch_pair(77)
    mixed = Pair(pair.image, other.points, other.intensity, pair.camera)
    found = create("calib_anything", search_samples=300).calibrate([mixed], other.T_camera_lidar)
    assert not found.converged
    assert found.message


@pytest.mark.parametrize(
    "parameters",
    [
        {"score": "best"},
        {"encoder": "a.onnx"},
        {"masks": "m", "encoder": "a.onnx", "decoder": "b.onnx"},
        {"search_rotation_deg": 0.0},
        {"search_translation_m": float("nan")},
        {"grid": 0},
        {"seed": -1},
    ],
)
def test_impossible_parameters_are_refused(parameters):
    with pytest.raises(CalibrationError):
        create("calib_anything", **parameters)


def test_masks_of_a_model_are_used(tmp_path):
    pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    from lcdata.geometry.camera import Camera
    from tests.sam_models import decoder, encoder

    camera = Camera("pinhole", 128, 128, (64, 64, 64, 64))
    image = np.zeros((128, 128, 3), np.uint8)
    image[:, :, 0] = np.repeat(np.arange(0, 256, 64), 32)[:, None]
    image[:, :, 1] = np.repeat(np.arange(0, 256, 64), 32)[None]
    points = np.random.default_rng(0).uniform([3, -3, -3], [9, 3, 3], (500, 3))
    method = create(
        "calib_anything",
        encoder=encoder(tmp_path / "encoder.onnx"),
        decoder=decoder(tmp_path / "decoder.onnx"),
        grid=8,
    )
    assert method.prepare(Pair(image, points, None, camera)).layers.masks == 16


@pytest.mark.slow
def test_pairs_that_determine_the_pose_are_called_converged(pair):
    T = pair.T_camera_lidar
    pairs = [pair, *(patch_pair(seed, T=T) for seed in (6, 7, 8))]
    initial = perturb(T, 3.0, 0.1, np.random.default_rng(0))
    found = create("calib_anything").calibrate(pairs, initial)
    degrees, metres = errors(found, pair)
    assert found.converged and not found.degenerate
    assert degrees < 0.15 and metres < 0.03


@pytest.mark.slow
def test_the_crossing_from_three_degrees():
    folder = SHARED / "opencalib_crossing"
    if not folder.is_dir():
        pytest.skip("no opencalib_crossing in ../shared/data")
    import sys

    sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
    try:
        from nid import real_pair
    finally:
        sys.path.pop(0)
    real = real_pair(folder, "calib")
    method = create("calib_anything")
    features = method.prepare(real)
    found = [
        method.calibrate(
            [real],
            perturb(real.T_camera_lidar, 3.0, 0.0, np.random.default_rng([seed, 4])),
            [features],
        )
        for seed in range(3)
    ]
    values = np.array([errors(each, real) for each in found])
    assert np.median(values[:, 0]) < 0.3 and np.median(values[:, 1]) < 0.12
    for each, (degrees, metres) in zip(found, values, strict=True):
        assert not each.converged or (degrees < 0.5 and metres < 0.1)
