"""What an unfinished build has done so far.

`build.partial` lies in the data set until it is complete. Its first line says what is being
built (recordings, rig, options), each further line holds one finished pair. A build of the same
goes on from there; a build of anything else is refused, so old and new files never mix.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from lcdata.dataset import atomic, schema
from lcdata.dataset.schema import PairRecord
from lcdata.errors import DatasetError

NAME = "build.partial"


class Journal:
    """The journal of a build, open and locked.

        with Journal.open(out, what, force=False) as journal:
            journal.finished.get(pair_id)
            journal.add(record)
            journal.close_build()

    Attributes:
        folder: The data set.
        finished: Pairs of an earlier, interrupted run by pair_id; their files are unchecked.
    """

    def __init__(self, folder: Path, what: dict[str, Any]) -> None:
        self.folder = folder
        self.finished: dict[str, PairRecord] = {}
        self._path = folder / NAME
        self._file = self._path.open("a+b", buffering=0)
        try:
            self._lock()
            self._start(what)
        except BaseException:
            self._file.close()
            raise

    @classmethod
    def open(cls, folder: Path, what: dict[str, Any], *, force: bool) -> Self:
        """Start or continue a build.

        Args:
            folder: The data set; made if it is not there.
            what: Recordings, rig and options, plain values.
            force: Delete a data set, finished or not, that is of something else.

        Raises:
            DatasetError: The folder holds something else, or another build is running.
        """
        check_folder(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            partial = folder / NAME
            if (folder / schema.INFO).exists() or (force and not _is_of(partial, what)):
                if not force:
                    raise DatasetError(
                        f"{folder} already holds a data set of other recordings or another rig",
                        "choose another folder with -o, or replace it with --force",
                    )
                clear(folder)
            return cls(folder, what)
        except OSError as error:
            raise DatasetError(
                f"{folder}: cannot be written ({error.strerror})", "choose another folder with -o"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()

    def add(self, record: PairRecord) -> None:
        """Note a pair whose files are complete."""
        self._append(asdict(record))

    def close_build(self) -> None:
        """The data set is complete: the journal goes."""
        self._path.unlink()

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DatasetError(
                f"another lcdata build is writing {self.folder}",
                "wait for it to end",
            ) from error

    def _start(self, what: dict[str, Any]) -> None:
        self._file.seek(0)
        lines = self._file.read().split(b"\n")
        complete = lines[:-1]  # what follows the last line feed was cut off by a kill
        if not complete:
            self._file.truncate(0)
            self._append(_header(what))
            return
        if json.loads(complete[0]) != _header(what):
            raise DatasetError(
                f"{self.folder} holds an unfinished build of other recordings or another rig",
                "finish that one first, choose another folder with -o, or drop it with --force",
            )
        if lines[-1]:
            self._file.truncate(sum(len(line) + 1 for line in complete))
        records = (PairRecord(**json.loads(line)) for line in complete[1:])
        self.finished = {record.pair_id: record for record in records}

    def _append(self, content: dict[str, Any]) -> None:
        line = json.dumps(content).encode() + b"\n"
        try:
            written = self._file.write(line)
            os.fsync(self._file.fileno())
        except OSError as error:
            raise DatasetError(
                f"{self._path}: cannot be written ({error.strerror})",
                "free some space and run the same command again; what was finished is kept",
            ) from error
        if written != len(line):
            raise DatasetError(
                f"{self._path}: no space left to write it",
                "free some space and run the same command again; what was finished is kept",
            )


def check_folder(folder: Path) -> None:
    """Refuse a folder that holds something that is no data set of ours.

    Raises:
        DatasetError: A file is in the way, or the folder holds other things.
    """
    if folder.exists() and not folder.is_dir():
        raise DatasetError(f"{folder} is a file", "choose another folder with -o")
    if not folder.is_dir() or any((folder / name).is_file() for name in (schema.INFO, NAME)):
        return
    if any(folder.iterdir()):
        raise DatasetError(
            f"{folder} is not empty and holds no lcdata data set", "choose another folder with -o"
        )


def clear(folder: Path) -> None:
    """Delete what a build writes, and what was computed from it; nothing else.

    dataset.json goes last: until then the folder is known as a data set.
    """
    scenarios: set[str] = set()
    for name in (schema.INFO, NAME):
        scenarios |= _scenarios(folder / name)
    for folder_name in (*sorted(scenarios), schema.RESULTS, schema.REPORT):
        shutil.rmtree(folder / folder_name, ignore_errors=True)
    atomic.remove_leftovers(folder)
    for name in (schema.PAIRS, schema.POSES, schema.REVIEW, NAME, schema.INFO):
        (folder / name).unlink(missing_ok=True)


def _header(what: dict[str, Any]) -> dict[str, Any]:
    plain = json.loads(json.dumps(what))
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()
    return {"schema_version": schema.SCHEMA_VERSION, "sha256": digest, "what": plain}


def _is_of(path: Path, what: dict[str, Any]) -> bool:
    """Whether a journal is there and of the same build."""
    try:
        first = path.read_bytes().split(b"\n")[0]
        return bool(json.loads(first) == _header(what))
    except (OSError, ValueError):
        return False


def _scenarios(path: Path) -> set[str]:
    """Names of the recordings that dataset.json or a journal speaks of; none if damaged."""
    try:
        text = path.read_text(encoding="utf-8")
        content = json.loads(text.split("\n")[0] if path.name == NAME else text)
        sources = content["what"]["sources"] if path.name == NAME else content["sources"]
        names = {str(source["scenario"]) for source in sources}
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    return {name for name in names if name not in {"", ".", ".."} and "/" not in name}
