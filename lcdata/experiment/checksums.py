"""Whether a data set's files are those that its index names; each file is read once."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from lcdata.dataset.atomic import write_json
from lcdata.dataset.validate import checksum
from lcdata.errors import ExperimentError

if TYPE_CHECKING:
    from lcdata.dataset import Dataset
    from lcdata.dataset.schema import PairRecord

FILE = "checksums.json"


@dataclass
class Checksums:
    """sha256 of files, known from before where their size and time of change are the same.

    Args:
        folder: Where they are kept.
    """

    folder: Path
    known: dict[str, list[str | int]] = field(default_factory=dict)
    changed: bool = False

    @classmethod
    def read(cls, folder: Path) -> Checksums:
        """Those that were kept; none where that cannot be read: they are made again."""
        try:
            content = json.loads((folder / FILE).read_text())
        except (OSError, ValueError):
            content = {}
        return cls(folder, content if isinstance(content, dict) else {})

    def save(self) -> None:
        """Keep them for the next time."""
        if self.changed:
            write_json(self.folder / FILE, self.known)
            self.changed = False

    def of(self, path: Path) -> str | None:
        """Checksum of a file; None if it cannot be read."""
        name = str(path)
        try:
            state = path.stat()
        except OSError:
            return None
        stamp: list[str | int] = [state.st_size, state.st_mtime_ns]
        before = self.known.get(name)
        if before and before[1:] == stamp:
            return str(before[0])
        found = checksum(path)
        if found is not None:
            self.known[name] = [found, *stamp]
            self.changed = True
        return found

    def _remote(self, dataset: Dataset, pair: PairRecord) -> tuple[str, str]:
        """What the index says of a pair at a URL: workers check it as they read the files."""
        if pair.image_sha256 and pair.cloud_sha256:
            return pair.image_sha256, pair.cloud_sha256
        image, cloud = dataset.files(pair.pair_id)
        return hashlib.sha256(image).hexdigest(), hashlib.sha256(cloud).hexdigest()

    def checked(self, dataset: Dataset, pair: PairRecord) -> tuple[str, str]:
        """Checksums of a pair's image and cloud, which must be those of pairs.parquet.

        Raises:
            ExperimentError: A file that is gone or has changed.
            DatasetError: A file at a URL that cannot be read.
        """
        found = []
        if not isinstance(dataset.address, Path):
            return self._remote(dataset, pair)
        for name, recorded in (
            (pair.image, pair.image_sha256),
            (pair.cloud, pair.cloud_sha256),
        ):
            path = dataset.address / name
            actual = self.of(path)
            if actual is None:
                raise ExperimentError(
                    f"{path} cannot be read", "`lcdata validate` names all that is missing"
                )
            if recorded and actual != recorded:
                raise ExperimentError(
                    f"{path} has changed: its sha256 is {actual[:12]}…, pairs.parquet has "
                    f"{recorded[:12]}…",
                    "bring the file back or build the data set again; stored trials are kept",
                )
            found.append(actual)
        return found[0], found[1]
