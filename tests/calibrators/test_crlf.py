"""CRLF on made-up roads with exact poses, on a real crossing, and on what it cannot use."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import road_world as world

import lcdata
from lcdata.calibrators import create
from lcdata.errors import CalibrationError
from lcdata.evaluation.protocol import perturb
from lcdata.features.crlf_refine import cost_j
from lcdata.features.road_masks import given_masks
from lcdata.features.road_view import stack, together
from lcdata.geometry import se3
from lcdata.geometry.camera import Camera

SEEDS = (24, 26)
FISHEYE = Camera("fisheye", 960, 480, (560, 560, 478, 236), (-0.01, 0.002, 0.0, 0.0))


def errors(result, pair):
    T = pair.T_camera_lidar
    degrees = np.rad2deg(se3.rotation_error(result.T_camera_lidar, T))
    return degrees, se3.translation_error(result.T_camera_lidar, T)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Masks of all pairs, named by their pairs."""
    path = tmp_path_factory.mktemp("masks")
    (path / "road").mkdir()
    for seed in SEEDS:
        pair, lane, pole = world.made(seed)
        assert cv2.imwrite(str(path / f"{pair.pair_id}.png"), world.white(lane, pole))
    return path


@pytest.fixture(scope="module")
def pair():
    return world.made(SEEDS[0])[0]


@pytest.fixture(scope="module")
def kept(pair, folder):
    """Features of the pair, the same whatever is done with them."""
    return create("crlf", masks=str(folder)).prepare(pair)


def write(path, mask):
    assert cv2.imwrite(str(path), mask)
    return str(path)


def test_it_needs_no_guess(pair, folder, kept):
    result = create("crlf", masks=str(folder)).calibrate([pair], None, [kept])
    degrees, metres = errors(result, pair)
    assert degrees < 0.3
    assert metres < 0.06
    assert result.converged, result.message
    assert result.cost_final <= result.cost_initial
    sigmas = np.sqrt(np.diag(result.covariance))
    assert (sigmas[:3] < 0.035).all()
    assert se3.sigma_distance(result.T_camera_lidar, pair.T_camera_lidar, result.covariance) < 5


def test_coarse_calibration_alone_is_near(pair, folder, kept):
    method = create("crlf", masks=str(folder), refine="none")
    result = method.calibrate([pair], None, [kept])
    degrees, metres = errors(result, pair)
    assert degrees < 3
    assert metres < 0.5


def test_the_search_improves_a_guess(pair, folder, kept):
    initial = perturb(pair.T_camera_lidar, 1.0, 0.1, np.random.default_rng(5))
    result = create("crlf", masks=str(folder)).calibrate([pair], initial, [kept])
    degrees, metres = errors(result, pair)
    assert degrees < 0.3
    assert metres < 0.08
    assert result.cost_final < result.cost_initial


def test_algorithm_1_raises_the_papers_cost(pair, folder, kept):
    initial = perturb(pair.T_camera_lidar, 1.0, 0.1, np.random.default_rng(5))
    method = create("crlf", masks=str(folder), refine="random", random_count=1000)
    found = method.calibrate([pair], initial, [kept]).T_camera_lidar
    data = stack(together([kept.view]), initial[None])
    before, after = cost_j(data, np.stack([initial, found]))
    assert after > 1.2 * before


@pytest.mark.slow
def test_the_search_is_at_least_as_good_as_algorithm_1(pair, folder):
    initial = perturb(pair.T_camera_lidar, 1.0, 0.1, np.random.default_rng(6))
    method = create("crlf", masks=str(folder))
    kept = [method.prepare(pair)]
    found, again = (method.calibrate([pair], initial, kept) for _ in range(2))
    random = create("crlf", refine="random").calibrate([pair], initial, kept)
    assert found.cost_final <= random.cost_final + 0.02
    np.testing.assert_array_equal(again.T_camera_lidar, found.T_camera_lidar)


@pytest.mark.slow
def test_pairs_of_one_extrinsic_are_solved_jointly(pair, folder):
    other, lane, pole = world.road_pair(SEEDS[1], T=pair.T_camera_lidar)
    write(folder / "road" / f"{SEEDS[1]}.png", world.white(lane, pole))
    method = create("crlf", masks=str(folder))
    result = method.calibrate([pair, other], None)
    degrees, metres = errors(result, pair)
    assert degrees < 0.2
    assert metres < 0.05
    blind = replace(other, intensity=None)
    left = method.calibrate([pair, blind], None)
    assert "left out" in left.message
    assert errors(left, pair)[1] < 0.06


@pytest.mark.slow
def test_other_lenses_are_seen_through(tmp_path):
    pair, lane, pole = world.road_pair(SEEDS[1], camera=FISHEYE)
    mask = write(tmp_path / "mask.png", world.white(lane, pole))
    degrees, metres = errors(lcdata.calibrate(pair, None, method="crlf", masks=mask), pair)
    assert degrees < 0.3
    assert metres < 0.08


def test_without_masks_a_guess_is_enough(pair):
    initial = perturb(pair.T_camera_lidar, 0.5, 0.05, np.random.default_rng(7))
    result = lcdata.calibrate([pair], initial, method="crlf")
    degrees, metres = errors(result, pair)
    assert degrees < 0.5
    assert metres < 0.12


def test_a_network_gives_both_masks(tmp_path, pair, monkeypatch):
    monkeypatch.syspath_prepend(str(world.__file__).replace("road_world.py", "features"))
    from test_segmentation import network

    _, lane, pole = world.made(SEEDS[0])
    painted = np.full((*lane.shape, 3), [10, 10, 200], np.uint8)
    painted[lane], painted[pole] = [250, 0, 0], [0, 250, 0]
    weights = [[-1, -1, 1], [1, -1, -1], [-1, 1, -1]]
    model = network(tmp_path / "model.onnx", weights, lane.shape)
    classes = {"lane": [1], "pole": [2], "mean": [0, 0, 0], "std": [1, 1, 1]}
    coloured = replace(pair, image=painted)
    image = given_masks(coloured, "", model, classes, "never")
    assert image.lane.any()
    result = lcdata.calibrate(coloured, None, method="crlf", model=str(model), classes=classes)
    degrees, metres = errors(result, pair)
    assert degrees < 0.3
    assert metres < 0.06


def test_features_can_be_kept(pair, folder, kept):
    import pickle

    method = create("crlf", masks=str(folder))
    stored = pickle.loads(pickle.dumps(kept))
    result, again = method.calibrate([pair], None, [stored]), method.calibrate([pair], None)
    np.testing.assert_array_equal(result.T_camera_lidar, again.T_camera_lidar)


def test_bare_roads_are_refused(tmp_path, pair):
    _, lane, pole = world.made(SEEDS[0])
    cases = {
        "no pole in the image": world.white(lane),
        "no lane in the image": world.white(pole),
    }
    for said, mask in cases.items():
        path = write(tmp_path / "mask.png", mask)
        with pytest.raises(CalibrationError, match=said) as raised:
            lcdata.calibrate(pair, None, method="crlf", masks=path)
        assert raised.value.remedy


def test_one_lane_in_the_image_is_refused(tmp_path, pair):
    mask = world.white(world.made(SEEDS[0])[2])
    height, width = mask.shape
    cv2.line(mask, (width // 4, height - 1), (width // 2 - 20, height // 2 + 40), 255, 7)
    path = write(tmp_path / "mask.png", mask)
    with pytest.raises(CalibrationError, match="one lane in the image's mask"):
        lcdata.calibrate(pair, None, method="crlf", masks=path)


def test_lanes_that_are_not_parallel_are_refused(folder, pair):
    small = Camera("pinhole", 96, 48, (56, 56, 48, 24))
    scene = world.Road((), ((15.0, 8.0, 0.1, 6.0), (20.0, -8.0, 0.1, 6.0)))
    bare = world.road_pair(1, scene=scene, camera=small, T=pair.T_camera_lidar)[0]
    x, y = bare.points[:, 0], bare.points[:, 1]
    painted = (np.abs(y - 2.0) < 0.15) | (np.abs(0.8 * (y + 4.0) - 0.6 * (x - 4.0)) < 0.15)
    light = np.where(painted, 60.0, 12.0).astype(np.float32)
    other = replace(pair, points=bare.points, intensity=light, ring=None)
    with pytest.raises(CalibrationError, match="lanes in the cloud are not parallel"):
        lcdata.calibrate(other, None, method="crlf", masks=str(folder))


@pytest.mark.parametrize(
    ("scene", "said"),
    [
        (world.Road((), ((15.0, 8.0, 0.1, 6.0), (20.0, -8.0, 0.1, 6.0))), "no lane in the cloud"),
        (
            world.Road(((-60.0, 90.0, 1.9, 2.1),), ((15.0, 8.0, 0.1, 6.0),)),
            "one lane in the cloud",
        ),
        (
            world.Road(((-60.0, 90.0, 1.9, 2.1), (-60.0, 90.0, -1.9, -1.7)), ()),
            "no pole in the cloud",
        ),
    ],
)
def test_clouds_without_lanes_or_poles_are_refused(folder, pair, scene, said):
    small = Camera("pinhole", 96, 48, (56, 56, 48, 24))
    bare = world.road_pair(1, scene=scene, camera=small, T=pair.T_camera_lidar)[0]
    light = np.where(bare.intensity > 45, bare.intensity, 12.0).astype(np.float32)
    other = replace(pair, points=bare.points, intensity=light, ring=None)
    with pytest.raises(CalibrationError, match=said):
        lcdata.calibrate(other, None, method="crlf", masks=str(folder))


@pytest.mark.parametrize(
    ("parameters", "initial", "said"),
    [
        ({}, None, "neither masks nor a model nor an initial guess"),
        ({"masks": "none.png"}, None, "no such file"),
        ({"masks": "a", "model": "b"}, None, "give one"),
        ({"refine": "magic"}, None, "refine is 'magic'"),
        ({"coarse": "perhaps"}, None, "coarse is 'perhaps'"),
        ({"contours": True}, None, "contours is True"),
        ({"reach_m": -1.0}, None, "reach_m is -1.0"),
        ({"random_count": 1.5}, None, "random_count is 1.5"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(pair, parameters, initial, said):
    with pytest.raises(CalibrationError, match=said):
        lcdata.calibrate(pair, initial, method="crlf", **parameters)


def test_masks_of_another_size_are_refused(tmp_path, pair):
    mask = write(tmp_path / "mask.png", world.white(world.made(SEEDS[0])[1])[::2, ::2])
    with pytest.raises(CalibrationError, match="480x240 pixels for an image of 960x480"):
        lcdata.calibrate(pair, None, method="crlf", masks=mask)


def test_nothing_in_view_is_no_success(pair, folder, kept):
    away = pair.T_camera_lidar.copy()
    away[:3, :3] = se3.exp([0, 0, 0, 0, np.pi, 0])[:3, :3] @ away[:3, :3]
    result = create("crlf", masks=str(folder)).calibrate([pair], away, [kept])
    assert not result.converged
    assert np.isfinite(result.T_camera_lidar).all()
    assert result.message


@pytest.mark.slow
def test_a_real_crossing(shared):
    from pypcd4 import PointCloud

    data = shared / "data" / "opencalib_crossing"
    reference = json.loads((data / "reference.json").read_text())
    image = cv2.imread(str(data / "calib.png"))[:, :, ::-1].copy()
    cloud = PointCloud.from_path(data / "calib.pcd")
    camera = Camera(
        "pinhole", image.shape[1], image.shape[0], tuple(reference["K"]), tuple(reference["D"])
    )
    T = se3.check_transform(reference["T_camera_lidar"])
    points, light = cloud.numpy(("x", "y", "z")), cloud.numpy(("intensity",))[:, 0]
    pair = lcdata.Pair(image, points, light, camera, T_camera_lidar=T)
    masks = str(data / "mask.jpg")
    coarse = create("crlf", masks=masks, refine="none").calibrate([pair], None)
    assert (np.array(errors(coarse, pair)) < [3.0, 0.5]).all()
    method = create("crlf", masks=masks)
    kept = [method.prepare(pair)]
    assert (np.array(errors(method.calibrate([pair], None, kept), pair)) < [0.5, 0.12]).all()
    for seed in range(5):
        initial = perturb(T, 1.0, 0.1, np.random.default_rng([seed, 4]))
        assert (np.array(errors(method.calibrate([pair], initial, kept), pair)) < [0.25, 0.1]).all()
