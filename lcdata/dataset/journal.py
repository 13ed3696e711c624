"""What an unfinished build has done so far.

`build.partial` lies in the data set until it is complete. Its first line says what is being
built (recordings, rig, options), each further line holds one finished pair. A build of the same
goes on from there; a build of anything else is refused, so old and new files never mix.
"""

from __future__ import annotations

import json
import os
import shutil
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from lcdata import __version__
from lcdata.dataset import atomic, schema
from lcdata.dataset.lock import locked
from lcdata.dataset.schema import PairRecord
from lcdata.errors import DatasetError

NAME = "build.partial"

REPLACED = "dataset.replaced.json"
"""dataset.json of a data set that is being deleted."""


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

    def __init__(self, folder: Path, what: dict[str, Any], *, force: bool) -> None:
        self.folder = folder
        self.finished: dict[str, PairRecord] = {}
        self._path = folder / NAME
        with ExitStack() as stack:
            stack.enter_context(locked(folder))
            if not force:
                _refuse_other(folder)
            self._file = stack.enter_context(self._path.open("a+b", buffering=0))
            self._start(_header(what), force)
            self._held = stack.pop_all()

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
        if not force:
            _refuse_other(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            return cls(folder, what, force=force)
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
        self._held.close()

    def add(self, record: PairRecord) -> None:
        """Note a pair whose files are complete."""
        self._append(asdict(record))

    def close_build(self) -> None:
        """The data set is complete: the journal goes."""
        self._path.unlink()

    def abandon(self) -> None:
        """There will be no data set: leave nothing behind."""
        clear(self.folder)
        self._path.unlink()
        with suppress(OSError):  # it may have been there before, with something in it
            self.folder.rmdir()

    def _start(self, header: dict[str, Any], force: bool) -> None:
        self._file.seek(0)
        content = self._file.read()
        first, *others = content.split(b"\n")
        known = _parsed(first)
        if known and known != header and not force:
            raise DatasetError(
                f"{self.folder} holds an unfinished build of other recordings, another rig, other "
                "options or another version",
                "finish that one first, choose another folder with -o, or drop it with --force",
            )
        atomic.remove_leftovers(self.folder)
        if known == header and not (self.folder / schema.INFO).exists():
            # What follows the last line feed was cut off by a kill.
            self._file.truncate(content.rfind(b"\n") + 1)
            records = [PairRecord(**line) for line in map(_parsed, others) if line]
            self.finished = {record.pair_id: record for record in records}
        else:
            clear(self.folder)
            self._file.truncate(0)
            self._append(header)
            os.fsync(self._file.fileno())

    def _append(self, content: dict[str, Any]) -> None:
        line = json.dumps(content).encode() + b"\n"
        try:
            written = self._file.write(line)
        except OSError as error:
            if error.errno not in atomic.FULL:
                raise
            written = 0
        if written != len(line):
            raise atomic.full_disk(self._path)


def _refuse_other(folder: Path) -> None:
    if (folder / schema.INFO).exists():
        raise DatasetError(
            f"{folder} already holds a data set of other recordings, rig or options",
            "choose another folder with -o, or replace it with --force",
        )


def check_folder(folder: Path) -> None:
    """Refuse a folder that holds something that is no data set of ours.

    Raises:
        DatasetError: A file is in the way, or the folder holds other things.
    """
    if folder.exists() and not folder.is_dir():
        raise DatasetError(f"{folder} is a file", "choose another folder with -o")
    if not folder.is_dir() or any(
        (folder / name).is_file() for name in (schema.INFO, NAME, REPLACED)
    ):
        return
    if any(folder.iterdir()):
        raise DatasetError(
            f"{folder} is not empty and holds no lcdata data set", "choose another folder with -o"
        )


def clear(folder: Path) -> None:
    """Delete what a build writes and what was computed from it, nothing else, not the journal.

    From the first step on the folder is no complete data set; the last one removes what names
    its scenarios, so that an interrupted deletion can be taken up again.
    """
    if (folder / schema.INFO).exists():
        (folder / schema.INFO).replace(folder / REPLACED)
    sources = _sources(folder / REPLACED) | _sources(folder / NAME)
    # an import's own masks only: those of other data sets are a person's work
    masks = [f"{schema.MASKS}/{name}" for name in sources if sources[name].get("masks")]
    for name in (*sorted(sources), *masks, schema.RESULTS, schema.REPORT, schema.GROUNDTRUTH):
        shutil.rmtree(folder / name, ignore_errors=True)
    with suppress(OSError):  # not there, or not empty
        (folder / schema.MASKS).rmdir()
    for name in (schema.PAIRS, schema.POSES, schema.REVIEW, REPLACED):
        (folder / name).unlink(missing_ok=True)


def _header(what: dict[str, Any]) -> dict[str, Any]:
    return {"lcdata": __version__, "schema_version": schema.SCHEMA_VERSION, **schema.plain(what)}


def _parsed(line: bytes) -> dict[str, Any] | None:
    """A line of the journal; None if it was cut off."""
    try:
        content = json.loads(line)
    except ValueError:
        return None
    return content if isinstance(content, dict) else None


def _sources(path: Path) -> dict[str, dict[str, Any]]:
    """Sources that dataset.json or a journal speaks of, by scenario; none if damaged."""
    try:
        text = path.read_bytes()
        content = json.loads(text.split(b"\n")[0] if path.name == NAME else text)
        found = {str(source["scenario"]): dict(source) for source in content["sources"]}
    except (OSError, ValueError, KeyError, TypeError):
        return {}
    return {name: s for name, s in found.items() if name not in {"", ".", ".."} and "/" not in name}
