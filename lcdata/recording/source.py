"""Recordings: finding them, opening them, streaming typed messages out of them."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

from lcdata.errors import MessageError, RecordingError
from lcdata.recording.conversion import READ_TYPES, Converter, has_header, header_stamp
from lcdata.recording.joint_log import JOINT_LOG, JointLog
from lcdata.recording.messages import Message
from lcdata.recording.opening import (
    COMPRESSED_SUFFIXES,
    KINDS,
    OPENERS,
    open_storage,
    storage_suffix,
)
from lcdata.recording.plain_folder import FILE, is_plain_folder
from lcdata.recording.storage import TopicInfo

Stamps = Literal["header", "bag"]
Wanted = Callable[[str, int], bool]
"""Whether the message of a topic and stamp (ns) is to be read."""


def find_recordings(path: Path) -> list[Path]:
    """Recordings at a path, sorted: a bag file, a ROS 2 folder, or a folder of those, any depth.

    Raises:
        RecordingError: There is none, or two would have the same name.
    """
    if not path.exists():
        raise RecordingError(f"{path} does not exist", "give a recording or a folder of them")
    found = sorted(_walk(path))
    if not found:
        raise RecordingError(f"no recording in {path}", f"give {KINDS}")
    names: dict[str, Path] = {}
    for recording in found:
        try:
            recording.name.encode()
        except UnicodeEncodeError as error:
            raise RecordingError(
                f"{str(recording)!a}: its name is not UTF-8", "rename it: it names the scenario"
            ) from error
        other = names.setdefault(scenario_name(recording), recording)
        if other != recording:
            raise RecordingError(
                f"{other} and {recording} have the same name", "rename one: it names the scenario"
            )
    return found


def _walk(path: Path) -> Iterator[Path]:
    if path.is_file():
        if not storage_suffix(path):
            raise RecordingError(f"{path} is not a recording", f"give {KINDS}")
        yield path
    elif (path / "metadata.yaml").is_file() or is_plain_folder(path):
        yield path
    elif not path.is_dir():
        raise RecordingError(f"{path} is neither a file nor a folder", f"give {KINDS}")
    else:
        for child in path.iterdir():
            if not child.name.startswith(".") and (child.is_dir() or storage_suffix(child)):
                yield from _walk(child)


def scenario_name(path: Path) -> str:
    """A recording's name: its file's name without suffixes, or its folder's."""
    # Without `resolve`, a link keeps its own name; `.` and `..` have none.
    name = path.name if path.name not in ("", "..") else path.resolve().name
    if path.is_dir():
        return name
    for ending in (*COMPRESSED_SUFFIXES, ".active", *OPENERS):
        name = name.removesuffix(ending)
    return name


def open_recording(
    path: Path, stamps: Stamps = "header", joint_log: JointLog | None = None
) -> Recording:
    """Open a recording; use it as a context manager.

    Args:
        path: A bag file, a ROS 2 storage file or a ROS 2 folder.
        stamps: Which stamp the messages' `stamp_ns` is.
        joint_log: A file with the arm's joint positions.

    Raises:
        RecordingError: Nothing in it can be read.
    """
    return Recording(path, stamps, joint_log)


class Recording:
    """An open recording.

    Args:
        path: A bag file, a ROS 2 storage file or a ROS 2 folder.
        stamps: Which stamp the messages' `stamp_ns` is.
        joint_log: A file with the arm's joint positions, a topic of the file's name.
    """

    def __init__(
        self, path: Path, stamps: Stamps = "header", joint_log: JointLog | None = None
    ) -> None:
        self.path = path
        self.joint_log = joint_log
        self.scenario = scenario_name(path)
        self.stamps: Stamps = stamps
        self._storage = open_storage(path)
        self._converters: dict[str, Converter] = {}
        self._bad: Counter[str] = Counter()
        self._first_bad: dict[str, str] = {}

    @property
    def topics(self) -> dict[str, TopicInfo]:
        """Topics by name."""
        if self.joint_log is None:
            return self._storage.topics
        name, samples = self.joint_log.topic, len(self.joint_log.table.rows)
        return {**self._storage.topics, name: TopicInfo(name, JOINT_LOG, samples, "")}

    @property
    def start_ns(self) -> int:
        """The recorder's stamp of the first message; 0 without messages."""
        return self._storage.start_ns

    @property
    def end_ns(self) -> int:
        """The recorder's stamp of the last message; 0 without messages."""
        return self._storage.end_ns

    @property
    def problems(self) -> list[str]:
        """What was wrong with the file and the messages read so far, one line each."""
        messages = [
            f"{self.path}: topic {topic}: {count} message{'s' * (count > 1)} cannot be read: "
            f"{self._first_bad[topic]}"
            for topic, count in self._bad.items()
        ]
        return list(dict.fromkeys([*self._storage.problems, *messages]))

    def serialised(
        self,
        topics: Collection[str] | None = None,
        wanted: Wanted | None = None,
        heads: Collection[str] = (),
    ) -> Iterator[tuple[str, int, int, memoryview]]:
        """Topic, stamp in ns, the recorder's stamp in ns and bytes of messages, as recorded.

        Args:
            topics: Which; by default all that we know the type of.
            wanted: Called with topic and stamp; messages it refuses are left out.
            heads: Topics of which only the stamps matter: their bytes may come cut.
        """
        chosen = {t for t in (self.topics if topics is None else topics) if self._usable(t)}
        encodings = {t: self.topics[t].encoding for t in chosen}
        headed = {t for t in chosen if has_header(self.topics[t].type) and encodings[t] != FILE}
        use_header = self.stamps == "header"
        for topic, bag_ns, raw in self._storage.messages(chosen, heads):
            try:
                by_header = use_header and topic in headed
                stamp_ns = header_stamp(raw, encodings[topic]) if by_header else bag_ns
            except (struct.error, IndexError):
                self._note(topic, f"of {len(raw)} bytes, too short for its type")
                continue
            if stamp_ns < 0:  # ROS 2 seconds have a sign; its time begins in 1970
                self._note(topic, f"with a stamp of {stamp_ns} ns, before 1970")
                continue
            if wanted is None or wanted(topic, stamp_ns):
                yield topic, stamp_ns, bag_ns, raw

    def messages(
        self, topics: Collection[str] | None = None, wanted: Wanted | None = None
    ) -> Iterator[tuple[str, Message]]:
        """Topic and typed message, streamed.

        A message that cannot be read is left out and appears in `problems`.

        Args:
            topics: Which; by default all that we know the type of.
            wanted: Called with topic and stamp before a message is deserialised; messages it
                refuses cost next to nothing.
        """
        for topic, stamp_ns, bag_ns, raw in self.serialised(topics, wanted):
            message = self.read(topic, raw, stamp_ns, bag_ns)
            if message is not None:
                yield topic, message

    def read(self, topic: str, raw: memoryview, stamp_ns: int, bag_ns: int) -> Message | None:
        """Typed message of serialised bytes; None, and a line in `problems`, if damaged."""
        info = self.topics[topic]
        converter = self._converters.setdefault(info.encoding, Converter(info.encoding))
        try:
            return converter(raw, info.type, stamp_ns, bag_ns)
        except MessageError as error:
            self._note(topic, str(error))
            return None

    def _usable(self, topic: str) -> bool:
        info = self.topics.get(topic)
        return (
            info is not None and info.type in READ_TYPES and info.encoding in ("ros1", "cdr", FILE)
        )

    def _note(self, topic: str, problem: str) -> None:
        self._bad[topic] += 1
        self._first_bad.setdefault(topic, problem)

    def close(self) -> None:
        """Release files."""
        self._storage.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
