"""KITTI's raw data and its odometry benchmark, against the published equations."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lcdata.dataset import validate
from lcdata.dataset.importers import Choice, KittiOdometry, KittiRaw, import_dataset
from lcdata.dataset.importers.kitti_calib import (
    parse_calibration,
    read_calibration,
    read_timestamps,
)
from lcdata.errors import SourceError
from lcdata.geometry import se3

from . import layouts


def homogeneous(R: np.ndarray, T: np.ndarray | None = None) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = R
    if T is not None:
        result[:3, 3] = T
    return result


@pytest.mark.parametrize("camera", ["image_02", "image_03", "image_00"])
def test_points_of_a_synchronised_drive_project_as_the_devkit_says(
    tmp_path: Path, camera: str
) -> None:
    date = tmp_path / "2011_09_26"
    c = layouts.kitti_calibration(date)
    layouts.kitti_drive(date, camera=camera)
    made = import_dataset(KittiRaw(date, camera), tmp_path / "out")
    assert (made.pairs, made.poses, made.failures, made.warnings) == (3, 1, [], [])
    assert validate(tmp_path / "out") == []
    for n, pair in enumerate(made.dataset):
        points = layouts.points(100 + n)
        np.testing.assert_array_equal(pair.points, points[:, :3])
        np.testing.assert_array_equal(pair.intensity, points[:, 3])
        # y = P_rect_xx R_rect_00 Tr_velo_to_cam x
        X = np.column_stack([points[:, :3], np.ones(len(points))]).astype(float)
        chain = homogeneous(c["R_rect_00"]) @ homogeneous(c["R"], c["T"])
        y = X @ (c[f"P_rect_{camera[-2:]}"] @ chain).T
        pixels, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, pair.points))
        np.testing.assert_allclose(pixels, y[:, :2] / y[:, 2:], atol=1e-6)
        assert inside.sum() > 20
        assert not pair.camera.is_distorted
        record = made.dataset.pairs[n]
        source = date / "2011_09_26_drive_0001_sync" / camera / "data" / f"{n:010}.png"
        assert (tmp_path / "out" / record.image).read_bytes() == source.read_bytes()
        assert record.dt_ns == 10_000_001
        assert record.pair_id == f"2011_09_26/pose_000/0001_{n:010}"


def test_an_extracted_drive_is_paired_by_time_and_distorted(tmp_path: Path) -> None:
    date = tmp_path / "2011_09_26"
    c = layouts.kitti_calibration(date)
    drive = layouts.kitti_extract(date)
    made = import_dataset(KittiRaw(drive), tmp_path / "out")
    assert made.pairs == 2
    (failure,) = made.failures
    assert "0001_0000000002" in failure and "no image within 50 ms" in failure
    assert validate(tmp_path / "out") == []
    for n, (pair, record) in enumerate(zip(made.dataset, made.dataset.pairs, strict=True)):
        image = drive / "image_02" / "data" / f"{n + 1:010}.png"
        assert (tmp_path / "out" / record.image).read_bytes() == image.read_bytes()
        of_camera_0 = pair.points.astype(float) @ c["R"].T + c["T"]
        rotation, _ = cv2.Rodrigues(c["R_02"])
        expected, _ = cv2.projectPoints(of_camera_0, rotation, c["T_02"], c["K_02"], c["D_02"])
        pixels, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, pair.points))
        np.testing.assert_allclose(pixels[inside], expected[inside, 0], atol=1e-6)
        assert inside.sum() > 20
        np.testing.assert_allclose(pair.points, layouts.points(n)[:, :3], atol=1e-3)


def test_drives_of_a_date_share_one_extrinsic(tmp_path: Path) -> None:
    for name, seed in (("2011_09_26", 0), ("2011_09_28", 1)):
        layouts.kitti_calibration(tmp_path / "kitti" / name, seed)
        layouts.kitti_drive(tmp_path / "kitti" / name, 1)
        layouts.kitti_drive(tmp_path / "kitti" / name, 5)
    everything = KittiRaw(tmp_path / "kitti")
    made = import_dataset(everything, tmp_path / "out")
    assert (made.pairs, made.poses) == (12, 2)
    assert made.dataset.scenarios == ("2011_09_26", "2011_09_28")
    choice = Choice(only=("2011_09_28_drive_0005_sync",), every=2, limit=1)
    made = import_dataset(everything, tmp_path / "few", choice=choice)
    assert [pair.pair_id for pair in made.dataset.pairs] == ["2011_09_28/pose_000/0005_0000000000"]
    with pytest.raises(SourceError, match="no '2011_10_03' among the recordings"):
        import_dataset(everything, tmp_path / "no", choice=Choice(only=("2011_10_03",)))


def test_frames_without_a_partner_are_named(tmp_path: Path) -> None:
    date = tmp_path / "2011_09_26"
    layouts.kitti_calibration(date)
    drive = layouts.kitti_drive(date, frames=4)
    (drive / "velodyne_points" / "data" / "0000000001.bin").unlink()
    (drive / "image_02" / "data" / "0000000003.png").unlink()
    made = import_dataset(KittiRaw(drive), tmp_path / "out")
    assert made.pairs == 2
    text = "\n".join(made.failures)
    assert "0001_0000000001: there is an image of this number, but no scan" in text
    assert "0001_0000000003: there is a scan of this number, but no image" in text


def test_bad_kitti_folders_are_named_with_a_remedy(tmp_path: Path) -> None:
    date = tmp_path / "2011_09_26"
    drive = layouts.kitti_drive(date)

    def error(camera: str = "image_02") -> str:
        with pytest.raises(SourceError) as caught:
            import_dataset(KittiRaw(drive, camera), tmp_path / "out")
        assert not (tmp_path / "out").exists()
        return str(caught.value)

    assert "calib_velo_to_cam.txt: not there: the archive of the date's calibration" in error()
    c = layouts.kitti_calibration(date)
    assert "no camera 'left' in KITTI" in error("left")
    assert "image_03" in error("image_03")  # no such images in this drive
    cameras = date / "calib_cam_to_cam.txt"
    good = cameras.read_text()
    cameras.write_text(good.replace("P_rect_02", "P_rect_09"))
    assert "no P_rect_02 in it" in error()
    cameras.write_text(good.replace("R_rect_00", "R_rect"))
    assert "no R_rect_00 in it" in error()
    cameras.write_text(good)
    velodyne = date / "calib_velo_to_cam.txt"
    good = velodyne.read_text()
    velodyne.write_text(f"{good}{layouts.line('R', c['R'] * 1.01)}\n")
    assert "calib_velo_to_cam.txt: R, T is not a rotation" in error()
    velodyne.write_text(good.replace("R: ", "R: x"))
    assert "no R in it (there are T, delta_f, delta_c)" in error()
    velodyne.write_text(good.replace("T: ", "T: 1 "))
    assert "have 9 and 4 values" in error()
    velodyne.write_text(good)
    (drive / "velodyne_points" / "timestamps.txt").write_text("later\n")
    assert "timestamps.txt: no time stamps in it" in error()
    with pytest.raises(SourceError, match="no drive of KITTI's raw data"):
        import_dataset(KittiRaw(drive / "image_02"), tmp_path / "out")
    with pytest.raises(SourceError, match="does not exist"):
        import_dataset(KittiRaw(tmp_path / "nothing"), tmp_path / "out")


@pytest.mark.parametrize("below", ["", "sequences", "sequences/00"])
def test_a_sequence_of_the_odometry_benchmark(tmp_path: Path, below: str) -> None:
    c = layouts.kitti_sequence(tmp_path / "kitti")
    made = import_dataset(KittiOdometry(tmp_path / "kitti" / below), tmp_path / "out")
    assert (made.pairs, made.poses, made.failures, made.warnings) == (3, 1, [], [])
    assert validate(tmp_path / "out") == []
    stamps = [record.stamp_image_ns for record in made.dataset.pairs]
    assert stamps == [0, 103_787_500, 207_575_000]
    for n, pair in enumerate(made.dataset):
        X = np.column_stack([layouts.points(n)[:, :3], np.ones(60)]).astype(float)
        y = X @ (c["P2"] @ np.vstack([c["Tr"], [0, 0, 0, 1]])).T
        pixels, inside = pair.camera.project(se3.apply(pair.T_camera_lidar, pair.points))
        np.testing.assert_allclose(pixels, y[:, :2] / y[:, 2:], atol=1e-6)
        assert inside.sum() > 20 and pair.pair_id == f"00/pose_000/{n:06}"


def test_sequences_that_cannot_be_read_are_named_and_others_taken(tmp_path: Path) -> None:
    for name in ("00", "01", "02"):
        layouts.kitti_sequence(tmp_path / "kitti", name)
    folder = tmp_path / "kitti" / "sequences"
    (folder / "01" / "calib.txt").unlink()
    without_tr = (folder / "02" / "calib.txt").read_text().split("Tr")[0]
    (folder / "02" / "calib.txt").write_text(without_tr)
    made = import_dataset(KittiOdometry(tmp_path / "kitti"), tmp_path / "out")
    assert made.dataset.scenarios == ("00",)
    text = "\n".join(made.failures)
    assert "01/calib.txt: not there: data_odometry_calib.zip" in text
    assert "02/calib.txt: no Tr in it (there are P0, P1, P2, P3)" in text


def test_a_real_calib_txt_gives_the_reference(shared: Path, tmp_path: Path) -> None:
    """Of sequence 00: what kitti_road's reference was computed from, by others."""
    source = shared / "data" / "kitti_road"
    folder = tmp_path / "00"
    (folder / "image_2").mkdir(parents=True)
    (folder / "image_2" / "000000.png").symlink_to(source / "000000.png")
    layouts.scan(folder / "velodyne" / "000000.bin", layouts.points())
    (folder / "times.txt").write_text("0.000000e+00\n")
    P = [718.856, 0, 607.1928, 45.38225, 0, 718.856, 185.2157, -0.1130887, 0, 0, 1, 0.003779761]
    Tr = [4.276802385584e-04, -9.999672484946e-01, -8.084491683471e-03, -1.198459927713e-02]
    Tr += [-7.210626507497e-03, 8.081198471645e-03, -9.999413164504e-01, -5.403984729748e-02]
    Tr += [9.999738645903e-01, 4.859485810390e-04, -7.206933692422e-03, -2.921968648686e-01]
    (folder / "calib.txt").write_text(f"{layouts.line('P2', P)}\n{layouts.line('Tr', Tr)}\n")
    made = import_dataset(KittiOdometry(folder), tmp_path / "out")
    reference = json.loads((source / "reference.json").read_text())
    (pose,) = made.dataset.poses
    np.testing.assert_allclose(pose.T_camera_lidar, reference["T_camera_lidar"], atol=5e-6)
    assert made.dataset.camera("00").intrinsics == tuple(reference["K"])


finite = st.floats(allow_nan=False, allow_infinity=False, width=64)
keys = st.text(st.sampled_from("ABPRTKSD_0123456789"), min_size=1, max_size=8)


@given(st.dictionaries(keys, st.lists(finite, min_size=1, max_size=12), max_size=5))
def test_numbers_come_back_from_a_calibration_file(values: dict[str, list[float]]) -> None:
    text = "".join(f"{key}: {' '.join(map(repr, row))}\n" for key, row in values.items())
    found = parse_calibration("calib_time: 09-Jan-2012 13:57:47\n" + text)
    assert {key: row.tolist() for key, row in found.items()} == values


@settings(max_examples=40)
@given(st.binary(max_size=300))
def test_any_bytes_are_a_calibration_or_a_named_error(content: bytes) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calib.txt"
        path.write_bytes(content)
        for read in (lambda p: read_calibration(p, "get it"), read_timestamps):
            try:
                read(path)
            except SourceError as error:
                assert "calib.txt" in str(error)


@settings(max_examples=40)
@given(st.integers(0, 59), st.integers(0, 999_999_999))
def test_stamps_have_every_nanosecond(second: int, ns: int) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "timestamps.txt"
        path.write_text(f"2011-09-26 13:02:00.000000000\n\n2011-09-26 13:02:{second:02}.{ns:09}\n")
        first, blank, last = read_timestamps(path)
        assert blank is None and first is not None and last is not None
        assert first == 1317042120 * 10**9
        assert last - first == second * 10**9 + ns
