"""Files that are either complete or not there.

A file is written under a temporary name in its own folder, forced to the disk, then renamed.
Whatever interrupts the writing, its final name never shows half of it.
"""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from lcdata.errors import DatasetError

MARK = ".lcdata-tmp"
"""Part of every temporary name, by which leftovers of a killed process are found."""

FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_FORBIDDEN = {errno.EACCES, errno.EPERM, errno.EROFS}


@contextmanager
def write_atomically(path: Path, *, sync_folder: bool = True) -> Iterator[Path]:
    """Write a file so that it is there in full or not at all.

        with write_atomically(folder / "table.csv") as temporary:
            temporary.write_text(text)

    Folders that are missing are made. The temporary name keeps the suffix, for libraries that
    choose the format by it.

    Args:
        path: The final name; a file that has it is replaced.
        sync_folder: Force the name to the disk as well, not only the content. Who writes many
            files may leave it to one `sync_folders` at the end, which halves the time.

    Yields:
        The temporary path to write to, in the same folder.

    Raises:
        DatasetError: Full disk or quota, no permission, a folder in the way.
    """
    path = Path(path)
    temporary = path.with_name(f".{path.stem}{MARK}{os.getpid()}{path.suffix}")
    try:
        _make_folder(path.parent)
        yield temporary
        _force_to_disk(temporary)
        temporary.replace(path)
        if sync_folder:
            _force_to_disk(path.parent)
    except OSError as error:
        raise _explained(error, path, temporary) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_bytes(path: Path, *chunks: bytes | memoryview, sync_folder: bool = True) -> None:
    """Write bytes atomically, chunk after chunk."""
    with (
        write_atomically(path, sync_folder=sync_folder) as temporary,
        temporary.open("wb", buffering=0) as file,
    ):
        for chunk in chunks:
            view = memoryview(chunk).cast("B")
            while view:  # an unbuffered write may take a part only
                view = view[file.write(view) :]


def write_json(path: Path, content: Any) -> None:
    """Write JSON atomically, indented, with a line feed at the end."""
    write_bytes(path, json_text(content).encode())


def json_text(content: Any) -> str:
    """JSON, indented, with a line feed at the end."""
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def write_parquet(path: Path, table: Any) -> None:
    """Write a `pyarrow.Table` atomically."""
    import pyarrow.parquet as pq

    with write_atomically(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")


def sync_folders(folders: Iterable[Path]) -> None:
    """Force the names in folders to the disk, each folder once."""
    for folder in sorted(set(folders)):
        _force_to_disk(folder)


def remove_leftovers(folder: Path) -> None:
    """Delete temporary files that a killed process left below a folder."""
    for leftover in folder.rglob(f".*{MARK}*"):
        leftover.unlink(missing_ok=True)


def full_disk(path: Path) -> DatasetError:
    """The error of a file that the disk has no room for."""
    return DatasetError(
        f"{path}: no space left to write it",
        "free some space and run the same command again; what was finished is kept",
    )


def _make_folder(folder: Path) -> None:
    """Make a folder and its parents, each entry forced to the disk."""
    if not folder.is_dir():
        _make_folder(folder.parent)
        folder.mkdir(exist_ok=True)
        _force_to_disk(folder.parent)


def _force_to_disk(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as error:
        if error.errno != errno.EINVAL:  # some file systems cannot sync a folder
            raise
    finally:
        os.close(descriptor)


def _explained(error: OSError, path: Path, temporary: Path) -> OSError | DatasetError:
    """An error of writing `path` in one line; any other error as it is."""
    if error.errno in FULL:
        return full_disk(path)
    ours = error.filename is None or Path(error.filename) in (temporary, *temporary.parents)
    if ours and error.errno in _FORBIDDEN:
        return DatasetError(
            f"{path}: cannot be written ({error.strerror})", "choose another folder"
        )
    if ours and error.errno in {errno.EEXIST, errno.ENOTDIR, errno.EISDIR}:
        return DatasetError(
            f"{path}: a file or folder of this name is in the way", "choose another folder"
        )
    return error
