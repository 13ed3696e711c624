"""Computed trials by the content that they were computed from.

    STORE/store.json                      version of the store
    STORE/trials/<time>-<process>.parquet trials as in DATASET/results, with a column `key`
    STORE/guesses/<key>.json              initial guesses that were found from pairs alone
    STORE/reserve-<run>                   some room for the last trials, while a run goes on
    STORE/checksums.json                  of data-set files, so that they are read once

Files are written once, whole or not at all, and are never changed: any number of processes may
work with one store at a time. Of a trial that is there twice the later one counts.
"""

from __future__ import annotations

import json
import os
import time
import uuid
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from lcdata.dataset.atomic import write_bytes, write_json, write_parquet
from lcdata.errors import ExperimentError, GeometryError, ReportError
from lcdata.evaluation.results import TrialResult, from_table, readable, to_table
from lcdata.evaluation.task import FoundGuess
from lcdata.geometry.se3 import check_transform

if TYPE_CHECKING:
    import pyarrow as pa

VERSION = 1
"""Raised whenever a reader of the version before would misread a store."""

RESERVE = "reserve"
STALE_S = 7 * 24 * 3600.0
RESERVE_BYTES = 1 << 19
"""Trials between two savings fill less: one with hundreds of matched lines takes 20 kB."""

INFO, TRIALS, GUESSES = "store.json", "trials", "guesses"


@dataclass(frozen=True)
class Store:
    """A store on disk.

    Args:
        folder: Its folder.
    """

    folder: Path

    @classmethod
    def open(cls, folder: Path) -> Store:
        """Open a store, or make it.

        Raises:
            ExperimentError: It is of another version, or something else is in its place.
            DatasetError: It cannot be written.
        """
        info = folder / INFO
        if not info.exists():
            if folder.is_dir() and any(folder.iterdir()):
                raise ExperimentError(
                    f"{folder} is no store of trials (it has no {INFO})", "name another `store`"
                )
            write_json(info, {"lcdata.trials": VERSION})
        try:
            version = int(json.loads(info.read_text())["lcdata.trials"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ExperimentError(
                f"{info} cannot be read ({type(error).__name__})", "name another `store`"
            ) from error
        if version != VERSION:
            age = "a newer" if version > VERSION else "another"
            raise ExperimentError(
                f"{folder} is a store of version {version}, this lcdata has {VERSION}",
                f"it was written by {age} lcdata: use that, or name another `store`",
            )
        return cls(folder)

    def keys(self) -> dict[str, bool]:
        """Keys of all trials, and whether they failed."""
        found: dict[str, bool] = {}
        for table in self._tables(("key", "failed")):
            found |= zip(table["key"].to_pylist(), table["failed"].to_pylist(), strict=True)
        return found

    def read(self, keys: Collection[str]) -> dict[str, TrialResult]:
        """Those of some trials that are there, by key."""
        import pyarrow as pa

        wanted = pa.array(list(keys), pa.string())
        found: dict[str, TrialResult] = {}
        for table in self._tables():
            found |= _by_key(table, wanted)
        return found

    def write(self, trials: Mapping[str, TrialResult]) -> Path:
        """Add trials by key.

        Returns:
            The file that holds them.

        Raises:
            DatasetError: The disk is full or cannot be written.
        """
        import pyarrow as pa

        table = to_table(trials.values()).append_column("key", pa.array(list(trials), pa.string()))
        name = f"{time.time_ns():020d}-{os.getpid()}-{uuid.uuid4().hex[:8]}.parquet"
        path = self.folder / TRIALS / name
        write_parquet(path, table)
        return path

    def guess(self, key: str) -> FoundGuess | None:
        """An initial guess by what it was found from; None if it is not there or damaged."""
        try:
            content = json.loads((self.folder / GUESSES / f"{key}.json").read_text())
            T = check_transform(content["T_camera_lidar"], "a stored initial guess")
            return FoundGuess(T, str(content["doubt"]))
        except (OSError, ValueError, KeyError, TypeError, GeometryError):
            return None

    def keep_guess(self, key: str, found: FoundGuess) -> None:
        """Keep an initial guess.

        Raises:
            DatasetError: The disk is full or cannot be written.
        """
        path = self.folder / GUESSES / f"{key}.json"
        if found.T_camera_lidar is not None and not path.exists():
            content = {"T_camera_lidar": found.T_camera_lidar.tolist(), "doubt": found.doubt}
            write_json(path, content)

    def reserve(self) -> Path:
        """Take some of the disk, so that what was computed when it fills can still be written.

        Returns:
            The file to delete for that, and in the end.

        Raises:
            DatasetError: The disk is full or cannot be written.
        """
        for old in self.folder.glob(f"{RESERVE}-*"):  # of processes that were killed
            with suppress(OSError):
                if time.time() - old.stat().st_mtime > STALE_S:
                    old.unlink()
        path = self.folder / f"{RESERVE}-{uuid.uuid4().hex[:8]}"
        write_bytes(path, os.urandom(RESERVE_BYTES))
        return path

    def merge(self, paths: Sequence[Path]) -> None:
        """Put one's own files together: one is faster to read than many."""
        if len(paths) < 2:
            return
        together: dict[str, TrialResult] = {}
        for path in sorted(paths):
            with readable(path) as file:
                table = file.read()
            together |= _by_key(table, table["key"])
        self.write(together)
        for path in paths:
            path.unlink(missing_ok=True)

    def _tables(self, columns: Sequence[str] | None = None) -> Iterator[pa.Table]:
        """Tables from the oldest file to the newest, those that come meanwhile too."""
        seen: set[str] = set()
        while True:
            paths = sorted((self.folder / TRIALS).glob("[!.]*.parquet"))
            paths = [path for path in paths if path.name not in seen]
            if not paths:
                return
            for path in paths:
                seen.add(path.name)
                try:
                    with readable(path) as file:
                        table = file.read(columns=columns)
                except ReportError:
                    if path.exists():  # else merged by its writer: a newer file has its trials
                        raise
                    continue
                yield table


def _by_key(table: pa.Table, wanted: pa.Array) -> dict[str, TrialResult]:
    import pyarrow.compute as pc

    chosen = table.filter(pc.is_in(table["key"], value_set=wanted))
    trials = from_table(chosen.drop_columns(["key"]))
    return dict(zip(chosen["key"].to_pylist(), trials, strict=True))
