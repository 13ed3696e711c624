from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lcdata.errors import TopicError
from lcdata.recording.source import open_recording
from lcdata.recording.topics import Topics, choose_topics
from lcdata.rig import Rig

from .bags import START, Messages, write

JPEG = b"\xff\xd8\xff\xe0"


def rig(**topics: str) -> Rig:
    return Rig.from_dict({"ground_truth": "static", "topics": topics})


def recording_of(tmp_path: Path, *topics: str) -> Any:
    """A recording with one message on each topic, of the type that its name suggests."""

    def stream(m: Messages):
        for topic in topics:
            if "camera_info" in topic:
                message = m.camera_info(START, 4, 3)
            elif topic.endswith("compressed"):
                message = m.compressed(START, JPEG, "jpeg")
            elif "image" in topic:
                message = m.image(START, np.zeros((3, 4), np.uint8), "mono8")
            elif "joint" in topic:
                message = m.joints(START, ["a"], [0.0])
            else:
                message = m.cloud(START, np.zeros(2, [(n, "f4") for n in "xyz"]))
            yield topic, START, message

    return open_recording(write(tmp_path, "run", "mcap", stream))


def test_the_only_topic_of_each_type_is_taken(tmp_path: Path) -> None:
    names = ("/points", "/image", "/camera_info", "/joint_states")
    with recording_of(tmp_path, *names) as recording:
        assert choose_topics(recording) == Topics(*names)
        assert choose_topics(recording, rig()) == Topics(*names[:3], None)


def test_ambiguous_topics_are_listed(tmp_path: Path) -> None:
    with recording_of(tmp_path, "/front/points", "/rear/points", "/image") as recording:
        with pytest.raises(TopicError) as error:
            choose_topics(recording)
        assert "2 topics could be lidar" in str(error.value)
        assert "/front/points (1 x PointCloud2), /rear/points (1 x PointCloud2)" in str(error.value)
        assert str(error.value).endswith("set topics.lidar in the rig")
        assert choose_topics(recording, Rig.from_dict(
            {
                "ground_truth": "static",
                "topics": {"lidar": "/rear/points"},
                "camera": {"width": 4, "height": 3, "intrinsics": [1, 1, 1, 1]},
            }
        )) == Topics("/rear/points", "/image", None, None)  # fmt: skip


def test_missing_topics_list_what_is_there(tmp_path: Path) -> None:
    with (
        recording_of(tmp_path, "/points") as recording,
        pytest.raises(TopicError, match=r"no image topic .* topics are /points \(1 x PointCl"),
    ):
        choose_topics(recording)


def test_a_topic_of_the_rig_that_does_not_fit(tmp_path: Path) -> None:
    with recording_of(tmp_path, "/points", "/camera/image", "/camera/camera_info") as recording:
        for asked, message in (
            ({"image": "/camera/imag"}, "no topic /camera/imag: did you mean /camera/image?"),
            ({"lidar": "/camera/image"}, "is of type sensor_msgs/msg/Image, not sensor_msgs/msg/P"),
            ({"lidar": "/x"}, r"no topic /x: candidates are /points \(1 x PointCloud2\)"),
        ):
            with pytest.raises(TopicError, match=message.replace("?", r"\?")):
                choose_topics(recording, rig(**asked))


def test_an_arm_needs_joint_states_and_a_camera_needs_its_model(tmp_path: Path) -> None:
    link = {"translation_m": [0, 0, 0], "rotation_rpy_deg": [0, 0, 0]}
    arm = Rig.from_dict({"T_camera_effector": link, "T_base_lidar": link})
    with recording_of(tmp_path, "/points", "/image") as recording:
        with pytest.raises(TopicError, match="without an arm needs ground_truth: static"):
            choose_topics(recording, arm)
        with pytest.raises(TopicError, match="give the camera's model and intrinsics in the rig"):
            choose_topics(recording, rig())


def test_one_of_a_camera_s_transports_and_its_own_camera_info(tmp_path: Path) -> None:
    with recording_of(
        tmp_path,
        "/points",
        "/zed/left/image_raw",
        "/zed/left/image_raw/compressed",
        "/zed/left/camera_info",
        "/zed/depth/image_raw",
        "/zed/depth/camera_info",
        "/joint_states",
        "/gripper/joint_states",
    ) as recording:
        assert choose_topics(recording) == Topics(
            "/points", "/zed/left/image_raw", "/zed/left/camera_info", "/joint_states"
        )
