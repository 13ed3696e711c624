"""Other sensors than the default ones, as a user asks for them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from lcdata.errors import MissingLibraryError
from lcdata.open3d_loader import open3d

from .conftest import Lcdata

try:
    open3d()
except MissingLibraryError as error:
    pytest.skip(str(error), allow_module_level=True)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (("--lidar", "hdl_64"), "unknown LiDAR 'hdl_64': choose from os1_128, os1_64, avia"),
        (("--camera", "leica"), "unknown camera 'leica': choose from zed2i, fisheye, atan"),
        (("--moving", "1", "--rig", "rig.yaml"), "--moving is without an arm"),
    ],
)
def test_wrong_choices_are_one_line(
    lcdata: Lcdata, tmp_path: Path, options: tuple[str, ...], line: str
) -> None:
    done = lcdata("simulate", tmp_path / "out", *options)
    assert done.returncode == 1
    assert line in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


@pytest.mark.slow
def test_a_recording_by_hand_becomes_a_dense_data_set(lcdata: Lcdata, tmp_path: Path) -> None:
    pytest.importorskip("small_gicp")
    source, out = tmp_path / "in", tmp_path / "out"
    sensors = ("--lidar", "os1_64", "--columns", "512", "--camera", "fisheye")
    made = lcdata("simulate", source, "--moving", "0.8", *sensors, "--json")
    assert made.returncode == 0, made.stderr
    shown = lcdata("info", source)
    assert "build would take 1 pair of 8 scans merged" in shown.stdout
    built = lcdata("build", source, "-o", out, "--no-calibrate", "--json")
    assert built.returncode == 0, built.stderr
    assert json.loads(built.stdout)["pairs"] == 1
    assert lcdata("validate", out).returncode == 0
