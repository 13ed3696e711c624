from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lcdata.errors import RecordingError
from lcdata.geometry import se3
from lcdata.recording.source import open_recording
from lcdata.recording.transforms import static_extrinsic

from .bags import START, Messages, Stream, write

HALF = np.sqrt(0.5)
ONE = ("base", "camera", (1.0, 0, 0), (0, 0, HALF, HALF))
TWO = ("base", "mast", (0, 2.0, 0), (HALF, 0, 0, HALF))
THREE = ("mast", "lidar", (0, 0, 3.0), (0, HALF, 0, HALF))
EXPECTED = (
    se3.inverse(se3.from_xyz_xyzw([1, 0, 0, 0, 0, HALF, HALF]))
    @ se3.from_xyz_xyzw([0, 2, 0, HALF, 0, 0, HALF])
    @ se3.from_xyz_xyzw([0, 0, 3, 0, HALF, 0, HALF])
)


@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_a_chain_up_and_down_the_tree(tmp_path: Path, kind: str) -> None:
    def stream(m: Messages) -> Stream:
        yield "/tf_static", START, m.transforms(START, [ONE, TWO])
        yield "/tf_static", START + 1, m.transforms(START + 1, [("/mast", "/lidar", *THREE[2:])])

    with open_recording(write(tmp_path, "run", kind, stream)) as recording:
        T = static_extrinsic(recording, "camera", "lidar")
        np.testing.assert_allclose(T, EXPECTED, atol=1e-12)


def test_transforms_of_tf_that_do_not_change(tmp_path: Path) -> None:
    def stream(m: Messages) -> Stream:
        yield "/tf_static", START, m.transforms(START, [ONE])
        for i in range(5):
            moving = ("base", "wheel", (float(i), 0, 0), (0, 0, 0, 1))
            yield "/tf", START + i, m.transforms(START + i, [TWO, THREE, moving])

    with open_recording(write(tmp_path, "run", "ros1", stream)) as recording:
        T = static_extrinsic(recording, "camera", "lidar")
        np.testing.assert_allclose(T, EXPECTED, atol=1e-12)
        with pytest.raises(RecordingError, match="from 'wheel' to 'camera'; they join base, cam"):
            static_extrinsic(recording, "camera", "wheel")


def test_no_transforms(tmp_path: Path) -> None:
    def stream(m: Messages) -> Stream:
        yield "/joint_states", START, m.joints(START, ["a"], [0.0])

    with (
        open_recording(write(tmp_path, "run", "mcap", stream)) as recording,
        pytest.raises(RecordingError, match="there are none: give T_camera_lidar in the rig"),
    ):
        static_extrinsic(recording, "camera", "lidar")
