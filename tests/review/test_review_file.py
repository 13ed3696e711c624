from __future__ import annotations

import subprocess
from dataclasses import replace

import numpy as np
import pytest
from box_room import BAD, GOOD, add_results, load_arm, make
from rrd import Rrd
from scipy.spatial.transform import Rotation

from lcdata.geometry import se3
from lcdata.review import save_review
from lcdata.review.overlay import project_cloud
from lcdata.review.trials import choose_trials
from lcdata.review.viewer import viewer_command

MEASURES = {
    "rotation_deg": "rotation_error_deg",
    "translation_m": "translation_error_m",
    "sigma_distance": "sigma_distance",
}


def transforms(rrd, entity):
    """Time to (parent, child, 4x4) of the transforms of an entity."""
    columns = [
        rrd.rows(entity, f"Transform3D:{name}")
        for name in ("translation", "quaternion", "parent_frame", "child_frame")
    ]
    result = {}
    for time in columns[0]:
        translation, quaternion, parent, child = (column[time][0] for column in columns)
        T = np.eye(4)
        T[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
        T[:3, 3] = translation
        result[time] = parent, child, T
    return result


def all_transforms(rrd):
    """Time (None for static) to {child: (parent, 4x4)}."""
    tree: dict = {}
    for entity in rrd.entities:
        for time, (parent, child, T) in transforms(rrd, entity).items():
            tree.setdefault(time, {})[child] = parent, T
    return tree


def test_rerun_finds_no_fault_with_the_file(review):
    command = [viewer_command(), "rrd", "verify", str(review)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "verified without error" in done.stdout + done.stderr


def test_timelines_are_pair_and_stamp_and_nothing_else(rrd, dataset):
    assert rrd.timelines == {"pair", "stamp"}
    cloud = "Points3D:positions"
    assert sorted(rrd.rows("/lidar/cloud", cloud)) == list(range(len(dataset.pairs)))
    stamps = sorted(rrd.rows("/lidar/cloud", cloud, "stamp"))
    assert stamps == [record.stamp_lidar_ns for record in dataset.pairs]


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("method", [GOOD, BAD])
def test_error_series_are_the_results(rrd, dataset, measure, method):
    expected = {}
    trials = choose_trials(dataset)
    for number, record in enumerate(dataset.pairs):
        trial = trials.of_pair(record.pair_id).get(method)
        if trial is not None and not trial.failed:
            expected[number] = getattr(trial, MEASURES[measure])
    series = rrd.rows(f"/errors/{measure}/{method}", "Scalars:scalars")
    assert {time: value[0] for time, value in series.items()} == expected
    assert len(expected) == (8 if method == GOOD else 6)


def test_the_series_of_the_ground_truth_is_its_own_uncertainty(rrd, dataset):
    series = rrd.rows("/errors/rotation_deg/ground_truth", "Scalars:scalars")
    for number, record in enumerate(dataset.pairs):
        covariance = dataset.pose(record.pose_id).covariance
        sigma = np.rad2deg(np.sqrt(np.trace(covariance[3:, 3:])))
        assert series[number][0] == pytest.approx(sigma)


def test_lanes_say_where_a_method_fails(rrd):
    lane = rrd.rows(f"/outcomes/{BAD}", "StateChange:state")
    shown = [(lane[k] or [""])[0] for k in range(9)]
    right = "right"
    assert shown[:4] == [right, "no estimate", "wrong, not flagged", ""]
    assert shown[4:8] == [right] * 4
    assert shown[8] == ""  # the lane's end
    scenarios = rrd.rows("/scenario", "StateChange:state")
    assert [scenarios[k][0] for k in (0, 3, 4, 7)] == ["den", "den", "lab", "lab"]


def test_small_clouds_hold_every_return(rrd, dataset):
    stored = rrd.rows("/lidar/cloud", "Points3D:positions")
    for number, record in enumerate(dataset.pairs):
        points = dataset.load(record.pair_id).points
        points = points[np.isfinite(points).all(axis=1)]
        np.testing.assert_array_equal(np.array(stored[number], np.float32), points)


def test_images_keep_their_bytes_distorted_or_not(rrd, dataset):
    for numbers, entity, media_type in (
        (range(4), "/camera/image/den/jpeg", "image/jpeg"),
        (range(4, 8), "/camera/image/lab/png", "image/png"),
    ):
        blobs = rrd.rows(entity, "EncodedImage:blob")
        types = rrd.rows(entity, "EncodedImage:media_type")
        for number in numbers:
            recorded = (dataset.path / dataset.pairs[number].image).read_bytes()
            assert bytes(blobs[number][0]) == recorded
            assert types[number] == [media_type]
    assert rrd.rows("/camera/image/den/jpeg", "EncodedImage:blob")[4] == []  # no longer shown


def test_the_camera_is_logged_again_only_when_it_changes(rrd, dataset):
    pinholes = rrd.rows("/camera", "Pinhole:image_from_camera")
    assert sorted(pinholes) == [0, 4]
    K = np.array(pinholes[4][0]).reshape(3, 3).T
    np.testing.assert_allclose(K, dataset.camera("lab").K)


def test_overlays_are_the_cloud_as_each_extrinsic_projects_it(rrd, dataset):
    trials = choose_trials(dataset)
    for number in (0, 5):
        pair = dataset.load(dataset.pairs[number].pair_id)
        points = pair.points[np.isfinite(pair.points).all(axis=1)]
        shown = trials.of_pair(pair.pair_id)
        extrinsics = {
            "initial": shown[GOOD].T_camera_lidar_initial,
            GOOD: shown[GOOD].T_camera_lidar_estimated,
            BAD: shown[BAD].T_camera_lidar_estimated,
            "ground_truth": pair.T_camera_lidar,
        }
        for source, T in extrinsics.items():
            stored = rrd.rows(f"/overlays/{source}/cloud", "Points2D:positions")[number]
            pixels, _ = project_cloud(pair.camera, T, points, 3000)
            np.testing.assert_array_equal(np.array(stored, np.float32), pixels)
            assert len(pixels) > 50


@pytest.mark.parametrize("number", [1, 3])
def test_nothing_stays_on_screen_where_a_method_has_no_estimate(rrd, number):
    for entity, component in (
        (f"/overlays/{BAD}/cloud", "Points2D:positions"),
        (f"/overlays/{BAD}/lines_image", "LineStrips2D:strips"),
        (f"/overlays/{BAD}/lines_cloud", "LineStrips2D:strips"),
        (f"/lines/{BAD}", "LineStrips3D:strips"),
        (f"/frustums/{BAD}", "LineStrips3D:strips"),
    ):
        assert rrd.rows(entity, component)[number] == []


def test_matched_lines_are_shown_in_3d_and_2d(rrd, dataset):
    trial = choose_trials(dataset).of_pair(dataset.pairs[0].pair_id)[GOOD]
    lines = np.array(rrd.rows(f"/lines/{GOOD}", "LineStrips3D:strips")[0])
    np.testing.assert_allclose(lines, trial.matches.points_lidar, atol=1e-6)
    entity, component = f"/overlays/{GOOD}/lines_image", "LineStrips2D:strips"
    in_image = np.array(rrd.rows(entity, component)[4])  # of a camera without distortion
    np.testing.assert_allclose(in_image, trial.matches.points_image)
    bent = rrd.rows(entity, component)[0]
    camera = dataset.camera("den")
    rays = camera.unproject(np.concatenate(bent))
    (fx, fy), (cx, cy) = camera.intrinsics[:2], camera.intrinsics[2:]
    straight = rays[:, :2] / rays[:, 2:] * [fx, fy] + [cx, cy]
    np.testing.assert_allclose(straight[:, 0], 50, atol=1e-3)
    assert 50 - 1e-3 < straight[:, 1].min() < straight[:, 1].max() < 100 + 1e-3


def test_the_arm_moves_as_the_joints_say(rrd, dataset):
    arm = load_arm(dataset.rig)
    tree = all_transforms(rrd)
    for number, record in enumerate(dataset.pairs):
        frames = tree[None] | tree[number]
        T, frame = np.eye(4), "arm/end_effector_link"
        while frame != "arm/base_link":
            frame, step = frames[frame]
            T = step @ T
        expected = arm.forward(dataset.pose(record.pose_id).joint_positions)
        np.testing.assert_allclose(T, expected, atol=1e-6)


def test_the_camera_sits_where_arm_and_mount_put_it(rrd, dataset):
    """Camera through the LiDAR (ground truth) and camera through the arm are the same."""
    tree = all_transforms(rrd)
    for number, record in enumerate(dataset.pairs):
        parent, T_base_lidar = tree[number]["lidar"]
        assert parent == "arm/base_link"
        parent, T_lidar_camera = tree[number]["camera"]
        assert parent == "lidar"
        pose = dataset.pose(record.pose_id)
        expected = se3.inverse(pose.T_effector_base) @ se3.inverse(pose.T_camera_effector)
        np.testing.assert_allclose(T_base_lidar @ T_lidar_camera, expected, atol=1e-6)


@pytest.mark.parametrize("arm", [True, False])
def test_every_frame_hangs_on_the_root(tmp_path, arm):
    """Else the viewer says `No transform path`."""
    dataset = make(tmp_path / "set", arm=arm, pairs=1)
    rrd = Rrd(save_review(dataset, tmp_path / "review.rrd").path)
    root = "arm/base_link" if arm else "lidar"
    tree = all_transforms(rrd)
    used = {
        frame[0]
        for entity in rrd.entities
        for frame in rrd.rows(entity, "CoordinateFrame:frame").values()
    }
    for number in range(len(dataset.pairs)):
        frames = {"image": ("camera", None)} | tree.get(None, {}) | tree[number]
        for frame in used:
            parent = frame
            while parent != root:
                parent = frames[parent][0]


def test_a_data_set_without_an_arm_has_no_arm(tmp_path):
    dataset = make(tmp_path / "set", arm=False)
    add_results(dataset)
    rrd = Rrd(save_review(dataset, tmp_path / "review.rrd").path)
    roots = {entity.split("/")[1] for entity in rrd.entities if entity != "/"}
    assert not roots & {"arm", "joints", "tower"}
    assert {"lidar", "camera", "overlays", "errors", "outcomes"} <= roots
    assert "/errors/rotation_deg/ground_truth" not in rrd.entities
    assert not any("sigma_distance" in entity for entity in rrd.entities)


def test_without_results_only_the_ground_truth_is_shown(tmp_path):
    dataset = make(tmp_path / "set", pairs=1)
    rrd = Rrd(save_review(dataset, tmp_path / "review.rrd").path)
    overlays = {e.split("/")[2] for e in rrd.entities if e.startswith("/overlays/")}
    assert overlays == {"ground_truth"}
    assert not any(e.startswith(("/errors", "/outcomes", "/frustums")) for e in rrd.entities)
    assert "No results yet" in rrd.static("/summary", "TextDocument:text")[0]


def test_an_arm_whose_model_is_elsewhere_is_left_out_and_named(tmp_path):
    dataset = make(tmp_path / "set", pairs=1)
    rig = dataset.info.rig | {"arm": dataset.info.rig["arm"] | {"model": "own/robot.urdf"}}
    arm = dataset.info.arm | {"model": "own/robot.urdf"}
    moved = replace(dataset, info=replace(dataset.info, rig=rig, arm=arm))
    rrd = Rrd(save_review(moved, tmp_path / "review.rrd").path)
    assert not any(entity.startswith("/arm") for entity in rrd.entities)
    text = rrd.static("/summary", "TextDocument:text")[0]
    assert "The arm is not shown: its model own/robot.urdf" in text


def test_thinning_can_be_chosen(tmp_path):
    dataset = make(tmp_path / "set", arm=False, pairs=1)
    rrd = Rrd(save_review(dataset, tmp_path / "review.rrd", thin=7).path)
    points = dataset.load(dataset.pairs[0].pair_id).points
    stored = rrd.rows("/lidar/cloud", "Points3D:positions")[0]
    points = points[np.isfinite(points).all(axis=1)]
    np.testing.assert_array_equal(np.array(stored, np.float32), points[::7])


def test_progress_is_told_pair_by_pair(tmp_path):
    dataset = make(tmp_path / "set", arm=False, pairs=1)
    told = []
    save_review(dataset, tmp_path / "r.rrd", progress=lambda *step: told.append(step))
    assert told == [("review", 1, 2), ("review", 2, 2)]
