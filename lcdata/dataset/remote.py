"""Data sets at a URL that fsspec reads: s3://, gs://, http://, file://, memory:// and others.

Its index is copied into a temporary folder as it is opened. Images and clouds are read when they
are asked for, and are not kept.
"""

from __future__ import annotations

import re
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from lcdata.dataset import schema
from lcdata.dataset.reader import Dataset, read_info
from lcdata.errors import DatasetError, MissingLibraryError

T = TypeVar("T")

TRIES = 3
"""How often something is asked for, for connections break."""

PAUSE_S = 1.0
"""Before asking again; twice as long each time."""

CONNECT_S, SILENCE_S = 5.0, 30.0
"""How long a web server may take to answer, and between two pieces of what it sends."""


def is_url(path: Path | str) -> bool:
    """Whether a data set's path is for fsspec: it has a protocol, as in `s3://bucket/set`."""
    return isinstance(path, str) and re.match(r"[A-Za-z][\w+.:-]*://", path) is not None


@dataclass(frozen=True, eq=False)
class RemoteDataset(Dataset):
    """A data set at a URL; nothing can be written to it.

    Args:
        url: Where it is.
        folder: Temporary folder of what was copied, deleted with this object.
    """

    url: str = ""
    folder: tempfile.TemporaryDirectory[str] | None = field(default=None, repr=False)

    @property
    def address(self) -> Path | str:
        """Its URL."""
        return self.url

    def place(self, name: str) -> Path | str:
        """URL of one of its files."""
        return f"{self.url}/{name}"

    def read_bytes(self, name: str) -> bytes:
        """Content of one of its files.

        Raises:
            DatasetError: It cannot be read.
        """
        return _Files.at(self.url).read(name)


def open_remote(url: str) -> RemoteDataset:
    """Open a data set at a URL; reads its index and picks, no images or clouds.

    Raises:
        DatasetError: Not there, does not answer, unfinished, damaged, or of another schema version.
        MissingLibraryError: fsspec, or what it needs for the URL's protocol.
    """
    url = url.rstrip("/")
    files = _Files.at(url)
    folder = tempfile.TemporaryDirectory(prefix="lcdata-")
    path = Path(folder.name) / (url.rpartition("/")[2] or "dataset")
    try:
        for name in (schema.INFO, schema.PAIRS, schema.POSES):
            files.copy(name, path)
        with suppress(FileNotFoundError):
            files.copy(schema.version_file(read_info(path).groundtruth_version), path, True)
        for name in files.below(schema.PICKS):
            files.copy(name, path)
        opened = Dataset.open(path)
    except DatasetError as error:
        raise DatasetError(error.message.replace(str(path), url), error.remedy) from error
    return RemoteDataset(path, opened.info, opened.pairs, opened.poses, url, folder)


@dataclass(frozen=True)
class _Files:
    """Files below a URL."""

    url: str
    system: Any
    root: str

    @classmethod
    def at(cls, url: str) -> _Files:
        try:
            from fsspec.core import url_to_fs
        except ImportError as error:
            raise MissingLibraryError(
                f"{url}: fsspec is not installed", "pip install 'lcdata[dask]', or give a folder"
            ) from error
        try:
            system, root = url_to_fs(url, **_options(url))
        except ImportError as error:  # fsspec's own words name the package
            raise MissingLibraryError(f"{url}: {error}", "install it, on workers too") from error
        except (ValueError, OSError) as error:
            raise DatasetError(f"{url} cannot be opened ({error})", "check the URL") from error
        return cls(url, system, root.rstrip("/"))

    def read(self, name: str, optional: bool = False) -> bytes:
        """Content of a file.

        Raises:
            FileNotFoundError: It is not there, and need not be.
            DatasetError: It cannot be read.
        """
        place = f"{self.url}/{name}"
        try:
            return bytes(_patiently(lambda: self.system.cat_file(f"{self.root}/{name}")))
        except FileNotFoundError as error:
            if optional:
                raise
            raise DatasetError(f"{place}: not there", "check the URL") from error
        except Exception as error:  # each protocol has errors of its own
            raise self._unreadable(name, error) from error

    def _unreadable(self, name: str, error: Exception) -> DatasetError:
        reason = " ".join(str(error).split()) or type(error).__name__
        return DatasetError(
            f"{self.url}/{name}: cannot be read ({reason})",
            "check the URL, the network and permissions",
        )

    def copy(self, name: str, folder: Path, optional: bool = False) -> None:
        content = self.read(name, optional)
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)

    def below(self, folder: str) -> list[str]:
        """Files in one of its folders; none where there is no such folder or no way to list it.

        Raises:
            DatasetError: It cannot be listed, and not because a web server has no lists.
        """
        try:
            found = self.system.find(f"{self.root}/{folder}")
        except (FileNotFoundError, NotImplementedError):
            return []
        except Exception as error:  # each protocol has errors of its own
            if _is_web(self.url):
                return []
            raise self._unreadable(folder, error) from error
        return [str(name)[len(self.root) :].lstrip("/") for name in found]


def _is_web(url: str) -> bool:
    return url.lower().startswith(("http://", "https://"))


def _options(url: str) -> dict[str, Any]:
    """No endless wait for a web server."""
    if not _is_web(url):
        return {}
    with suppress(ImportError):
        from aiohttp import ClientTimeout

        limits = ClientTimeout(total=None, sock_connect=CONNECT_S, sock_read=SILENCE_S)
        return {"client_kwargs": {"timeout": limits}}
    return {}


def _patiently(ask: Callable[[], T]) -> T:
    """Ask again where something breaks; that there is no such file is an answer."""
    for attempt in range(TRIES - 1):
        try:
            return ask()
        except (FileNotFoundError, PermissionError, ImportError):
            raise
        except Exception:  # each protocol has errors of its own
            time.sleep(PAUSE_S * 2**attempt)
    return ask()
