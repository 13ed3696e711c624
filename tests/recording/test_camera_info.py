"""Intrinsics of cameras that show a part of their sensor, or bin its pixels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lcdata.errors import GeometryError
from lcdata.geometry.camera import Camera
from lcdata.recording.source import open_recording

from .bags import START, Messages, write

POINTS = np.array([[-0.03, 0.01, 1.0], [0.03, -0.02, 1.5], [0.0, 0.0, 1.0], [0.05, 0.05, 4.0]])
D = (-0.1, 0.01, 1e-3, -2e-3, 0.0)


def recorded(tmp_path: Path, kind: str, **options: Any) -> Camera:
    """The camera of a real message in a real bag."""

    def stream(m: Messages) -> Any:
        yield "/camera_info", START, m.camera_info(START, 64, 48, D, **options)

    tmp_path.mkdir(exist_ok=True)
    with open_recording(write(tmp_path, "one", kind, stream)) as recording:
        ((_, info),) = recording.messages()
        return info.camera()


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_part_of_the_sensor_moves_the_principal_point(tmp_path: Path, kind: str) -> None:
    whole = recorded(tmp_path, kind)
    assert (whole.width, whole.height, whole.intrinsics) == (64, 48, (500, 500, 32, 24))
    part = recorded(tmp_path / "part", kind, roi=(10, 6, 40, 30))
    assert (part.width, part.height, part.intrinsics) == (40, 30, (500, 500, 22, 18))
    assert part.distortion == whole.distortion
    assert recorded(tmp_path / "all", kind, roi=(0, 0, 64, 48)) == whole
    assert recorded(tmp_path / "ones", kind, binning=(1, 1)) == whole


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_binned_pixels_are_the_means_of_their_blocks(tmp_path: Path, kind: str) -> None:
    """A point at the middle of a block of the sensor is at the middle of the image's pixel."""
    whole = recorded(tmp_path, kind)
    binned = recorded(tmp_path / "part", kind, roi=(10, 6, 41, 32), binning=(2, 4))
    assert (binned.width, binned.height) == (20, 8)
    at_sensor, at_image = (camera.project(POINTS)[0] for camera in (whole, binned))
    blocks = (at_sensor + 0.5 - [10, 6]) / [2, 4] - 0.5
    seen = np.isfinite(at_image).all(axis=1)
    assert seen.all()
    np.testing.assert_allclose(at_image[seen], blocks[seen], atol=1e-9)


def test_a_part_outside_the_sensor_is_named(tmp_path: Path) -> None:
    with pytest.raises(GeometryError, match=r"40x30 pixels at 30, 6 of a camera info for 64x48"):
        recorded(tmp_path, "mcap", roi=(30, 6, 40, 30))
