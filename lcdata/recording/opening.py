"""A path to a storage: which reader, which salvage."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from lcdata.errors import RecordingError
from lcdata.recording.mcap_file import McapFile
from lcdata.recording.plain_folder import PlainFolder, is_plain_folder
from lcdata.recording.ros1 import Ros1Bag
from lcdata.recording.salvage import Scanned
from lcdata.recording.sqlite3_file import Sqlite3File
from lcdata.recording.storage import Raw, Storage, TopicInfo, describe, read_errors

OPENERS: dict[str, Callable[[Path], Storage]] = {
    ".bag": Ros1Bag,
    ".mcap": McapFile,
    ".db3": Sqlite3File,
}
"""Reader of each kind of file."""

COMPRESSED_SUFFIXES = (".zstd", ".zst")
KINDS = f"a ROS 2 folder, a folder with images and clouds, or a file {', '.join(OPENERS)}"


def storage_suffix(path: Path) -> str:
    """`.bag`, `.mcap` or `.db3`, also before `.zstd` and `.active`; `""` for other files."""
    name = path.name
    for ending in (*COMPRESSED_SUFFIXES, ".active"):
        name = name.removesuffix(ending)
    return next((suffix for suffix in OPENERS if name.endswith(suffix)), "")


def open_storage(path: Path) -> Storage:
    """Open a bag file, a ROS 2 storage file or a ROS 2 folder.

    Raises:
        RecordingError: Nothing in it can be read.
    """
    try:
        if path.is_dir():
            return PlainFolder(path) if is_plain_folder(path) else _open_folder(path)
        with path.open("rb") as file:
            if not file.read(1):
                raise RecordingError(f"{path} is empty (0 bytes)", "remove it or copy it again")
    except OSError as error:
        remedy = "check the permissions" if isinstance(error, PermissionError) else ""
        raise RecordingError(f"{path} cannot be opened ({error.strerror})", remedy) from error
    suffix = storage_suffix(path)
    if not suffix:
        raise RecordingError(f"{path} is not a recording", f"give {KINDS}")
    if path.suffix in COMPRESSED_SUFFIXES:
        return _open_compressed(path)
    try:
        return OPENERS[suffix](path)
    except read_errors() as error:
        return Scanned(path, suffix, describe(error))


def _open_folder(path: Path) -> Storage:
    """A ROS 2 folder: its storage files say everything themselves, metadata.yaml only how many."""
    found = {file.name: file for file in path.iterdir() if storage_suffix(file)}
    listed = _listed_files(path / "metadata.yaml")
    problems = [
        f"{path}: its file {name} is missing: copy it again" for name in listed if name not in found
    ]
    remedy = "" if problems else "copy or record it again"
    parts: list[Storage] = []
    for name in sorted(found, key=lambda name: (len(name), name)):  # _2 before _10
        try:
            parts.append(open_storage(found[name]))
        except RecordingError as error:
            problems.append(error.message)
            remedy = error.remedy or remedy
    if not parts:
        reason = "; ".join(problems) or f"{path} has no {' or '.join(OPENERS)} file"
        raise RecordingError(reason, remedy)
    return parts[0] if len(parts) == 1 and not problems else Chain(parts, problems)


def _listed_files(metadata: Path) -> list[str]:
    """Names of the files in a metadata.yaml; none if it is damaged."""
    try:
        content: Any = yaml.safe_load(metadata.read_text(encoding="utf-8"))
        paths = content["rosbag2_bagfile_information"]["relative_file_paths"]
        return [PurePosixPath(name).name for name in paths]
    except (OSError, UnicodeDecodeError, yaml.YAMLError, LookupError, TypeError):
        return []


def _open_compressed(path: Path) -> Storage:
    """A file compressed as a whole is unpacked into a temporary folder first."""
    import zstandard

    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="lcdata-"))
        unpacked = Path(folder) / path.stem
        problem = "it is cut off"
        with path.open("rb") as source, unpacked.open("wb") as target:
            try:
                zstandard.ZstdDecompressor().copy_stream(source, target)
            except zstandard.ZstdError as error:
                problem = describe(error)
        if not unpacked.stat().st_size:
            raise RecordingError(f"{path} cannot be decompressed ({problem})", "copy it again")
        try:
            part = open_storage(unpacked)
        except RecordingError as error:
            message = error.message.replace(str(unpacked), str(path))
            raise RecordingError(message, error.remedy) from error
        return Chain([part], [], stack.pop_all(), (str(unpacked), str(path)))


class Chain:
    """Several storages, one after the other.

    Args:
        parts: The storages.
        problems: Lines to begin `problems` with.
        stack: What to close in the end.
        renamed: A path in the parts' problems, and what to show instead of it.
    """

    def __init__(
        self,
        parts: list[Storage],
        problems: list[str],
        stack: ExitStack | None = None,
        renamed: tuple[str, str] = ("", ""),
    ) -> None:
        self._parts, self._problems = parts, problems
        self._stack, self._renamed = stack or ExitStack(), renamed
        self.topics: dict[str, TopicInfo] = {}
        for info in (info for part in parts for info in part.topics.values()):
            known = self.topics.setdefault(info.name, replace(info, count=0))
            self.topics[info.name] = replace(known, count=known.count + info.count)
        filled = [part for part in parts if part.end_ns]
        self.start_ns = min((part.start_ns for part in filled), default=0)
        self.end_ns = max((part.end_ns for part in filled), default=0)

    @property
    def problems(self) -> list[str]:
        """Problems of all parts."""
        unpacked, path = self._renamed
        lines = [line for part in self._parts for line in part.problems]
        return [*self._problems, *(ln.replace(unpacked, path) if path else ln for ln in lines)]

    def messages(self, topics: Collection[str], heads: Collection[str] = ()) -> Iterator[Raw]:
        """Messages of some topics, one storage after the other."""
        for part in self._parts:
            yield from part.messages(topics, heads)

    def close(self) -> None:
        """Release files and remove temporary ones."""
        for part in self._parts:
            part.close()
        self._stack.close()
