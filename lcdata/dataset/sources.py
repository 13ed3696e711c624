"""What a build starts from: the rig that belongs to recordings, and names for their content."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from lcdata.errors import DatasetError, RigError
from lcdata.recording.plain_folder import is_plain_folder
from lcdata.recording.source import scenario_name

RIG = "rig.yaml"

SAMPLE_BYTES = 1 << 20
"""How much of a file's beginning and end its fingerprint covers: recordings are large."""

MANY = 256
"""A recording of more files, which are small then, has less of each covered."""


def find_rig(root: Path, recordings: Sequence[Path]) -> Path:
    """The rig file of recordings: in their folder, or the nearest above it up to `root`.

    Args:
        root: What the user named, a recording or a folder of them.
        recordings: The recordings found there.

    Raises:
        RigError: There is none, or recordings have different ones.
    """
    found = {_nearest(root, recording) for recording in recordings}
    if None in found:
        missing = next(path for path in recordings if _nearest(root, path) is None)
        raise RigError(
            f"no {RIG} beside {missing}",
            f"`lcdata info {missing}` prints one to start from; or name one with --rig",
        )
    first, *others = sorted(path for path in found if path is not None)
    if others:
        raise RigError(
            f"the recordings in {root} have different rigs: {first} and {others[0]}",
            "build each into a data set of its own, or name one with --rig",
        )
    return first


def _nearest(root: Path, recording: Path) -> Path | None:
    top, start = _absolute(root), _absolute(recording)
    if start == top:
        top = top.parent
    for folder in (start, *start.parents):
        if (folder / RIG).is_file():
            return folder / RIG
        if folder == top:
            return None
    return None


def _absolute(path: Path) -> Path:
    """Where the user says it is: a link to a recording has its rig beside the link."""
    return Path(os.path.abspath(path))  # noqa: PTH100 - Path.absolute keeps ..


def describe_source(path: Path, joint_log: Path | None = None) -> dict[str, Any]:
    """Name, files, sizes and fingerprint of a recording, plain values.

    The fingerprint covers sizes and the ends of the files, not all of their content; a joint log
    has a checksum of all of it.

    Args:
        path: The recording.
        joint_log: Its joint log.
    """
    files = sorted(_files(path)) if path.is_dir() else [path]
    sample = SAMPLE_BYTES if len(files) <= MANY else SAMPLE_BYTES // MANY
    digest = hashlib.sha256()
    for file in files:
        size = file.stat().st_size
        digest.update(f"{file.name} {size}\n".encode())
        with file.open("rb") as opened:
            digest.update(opened.read(sample))
            opened.seek(max(size - sample, 0))
            digest.update(opened.read(sample))
    log = {}
    if joint_log is not None:
        whole = hashlib.sha256(joint_log.read_bytes()).hexdigest()
        log = {"joint_log": {"name": joint_log.name, "sha256": whole}}
    return {
        "scenario": scenario_name(path),
        "name": _absolute(path).name,
        "bytes": sum(file.stat().st_size for file in files),
        "fingerprint": digest.hexdigest(),
        **log,
    }


def _files(folder: Path) -> Iterator[Path]:
    inside = folder.rglob("*") if is_plain_folder(folder) else folder.iterdir()
    return (f for f in inside if f.is_file() and f.name != RIG and f.name[0] != ".")


def check_names(recordings: Sequence[Path], reserved: Sequence[str]) -> None:
    """Refuse recordings whose names a data set needs for itself.

    Raises:
        DatasetError: Naming the recording.
    """
    for path in recordings:
        name = scenario_name(path)
        if name in reserved or name.startswith("."):
            raise DatasetError(
                f"{path} would be scenario {name!r}, a name that a data set uses itself",
                "rename the recording",
            )
