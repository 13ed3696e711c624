"""A recording without a bag: `images/STAMP.png` and `clouds/STAMP.pcd` in a folder.

The name of a file is its stamp: digits are nanoseconds, digits with a point are seconds.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from decimal import Decimal
from pathlib import Path

from lcdata.errors import MessageError, RecordingError
from lcdata.recording import fields, images
from lcdata.recording.cloud_files import READERS, read_cloud
from lcdata.recording.messages import Cloud, Image, Message
from lcdata.recording.storage import Raw, TopicInfo

IMAGES, CLOUDS = "images", "clouds"
"""Names of the two folders, and of the topics that they are."""

FILE = "file"
"""Encoding of a message that is the path of a file."""

SUFFIXES = {IMAGES: (".png", ".jpg", ".jpeg"), CLOUDS: tuple(READERS)}
TYPES = {IMAGES: "sensor_msgs/msg/CompressedImage", CLOUDS: "sensor_msgs/msg/PointCloud2"}


def is_plain_folder(path: Path) -> bool:
    """Whether a folder has the two folders of a recording without a bag."""
    return (path / IMAGES).is_dir() and (path / CLOUDS).is_dir()


class PlainFolder:
    """The files of a folder as a storage of messages.

    Args:
        path: The folder.

    Raises:
        RecordingError: One of its two folders has no file that can be used.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.problems: list[str] = []
        self.topics: dict[str, TopicInfo] = {}
        self._files: list[tuple[int, str, Path]] = []
        for topic in (IMAGES, CLOUDS):
            found = [*self._stamped(topic)]
            if not found:
                listed = ", ".join(SUFFIXES[topic])
                raise RecordingError(
                    f"{path / topic} has no file named by its stamp ({listed})",
                    "name files by nanoseconds, 1700000000000000000.png, or seconds",
                )
            self.topics[topic] = TopicInfo(topic, TYPES[topic], len(found), FILE)
            self._files += found
        self._files.sort()
        self.start_ns, self.end_ns = self._files[0][0], self._files[-1][0]

    def _stamped(self, topic: str) -> Iterator[tuple[int, str, Path]]:
        taken: dict[int, Path] = {}
        unnamed: list[str] = []
        for file in sorted((self.path / topic).iterdir()):
            if file.name.startswith(".") or file.suffix.lower() not in SUFFIXES[topic]:
                continue
            whole, point, fraction = file.stem.partition(".")
            if not whole.isdecimal() or (point and not fraction.isdecimal()):
                unnamed.append(file.name)
                continue
            stamp = int(Decimal(file.stem).scaleb(9)) if point else int(whole)
            if stamp in taken:
                self.problems.append(
                    f"{file} has the stamp of {taken[stamp].name}: the latter is used"
                )
                continue
            taken[stamp] = file
            yield stamp, topic, file
        if unnamed:
            self.problems.append(
                f"{self.path / topic}: {len(unnamed)} files are not named by a stamp, the first is "
                f"{unnamed[0]}: name them by nanoseconds or seconds"
            )

    def messages(self, topics: Collection[str], heads: Collection[str] = ()) -> Iterator[Raw]:
        """Paths of the files of some topics, in the order of their stamps."""
        for stamp, topic, file in self._files:
            if topic in topics:
                yield Raw(topic, stamp, memoryview(str(file).encode()))

    def close(self) -> None:
        """No file stays open."""


def read_file(raw: memoryview, stamp_ns: int, bag_ns: int) -> Message:
    """Image or cloud of a file.

    Raises:
        MessageError: It cannot be read, or is not what its suffix says.
    """
    path = Path(bytes(raw).decode())
    if path.suffix.lower() in READERS:
        records, height, width = read_cloud(path)
        fields.check_points(records.dtype)
        return Cloud(stamp_ns, bag_ns, "lidar", records, height, width)
    try:
        data = memoryview(path.read_bytes())
    except OSError as error:
        raise MessageError(f"{path} cannot be read ({error.strerror})") from error
    height, width = images.size(data)
    kind = path.suffix.lower().removeprefix(".")
    return Image(stamp_ns, bag_ns, "camera", data, kind, True, height, width)
