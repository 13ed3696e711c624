"""What a method reads beside pairs: files that its parameters name, by their content."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

from lcdata.calibrators.base import Calibrator
from lcdata.dataset.validate import checksum

Checksum = Callable[[Path], str | None]
"""sha256 of a file; None if it cannot be read."""


def parameter_files(method: Calibrator, folder: Path = Path()) -> dict[str, Path]:
    """Parameters that name a file or folder that is there: masks, the model of a network.

    Such a parameter is a `Path`, or a string that is not its default.

    Args:
        method: The method.
        folder: What relative names are relative to.
    """
    found: dict[str, Path] = {}
    known: tuple[dataclasses.Field[Any], ...] = (
        dataclasses.fields(method) if dataclasses.is_dataclass(method) else ()
    )
    for field in known:
        value = getattr(method, field.name)
        named = isinstance(value, str) and value not in {"", field.default}
        if named or isinstance(value, Path):
            path = folder / Path(value).expanduser()
            if _exists(path):
                found[field.name] = path
    return found


def located(method: Calibrator, folder: Path) -> Calibrator:
    """A method whose parameters name files by their full paths: workers may be elsewhere.

    Args:
        method: The method.
        folder: What relative names are relative to; those that are not there are left as they are.
    """
    places = {
        name: type(getattr(method, name))(path.resolve())
        for name, path in parameter_files(method, folder).items()
    }
    return dataclasses.replace(method, **places) if places else method  # type: ignore[type-var]


def file_contents(method: Calibrator, of: Checksum = checksum) -> dict[str, str]:
    """sha256 of what each of these parameters names, by the parameter.

    Args:
        method: The method.
        of: Where checksums of files come from, which may know them from before.
    """
    return {name: content(path, of) for name, path in parameter_files(method).items()}


def content(path: Path, of: Checksum = checksum) -> str:
    """sha256 of a file, or of the names and checksums of all files below a folder."""
    if path.is_file():
        return of(path.resolve()) or ""
    found = hashlib.sha256()
    for file in sorted(path.resolve().rglob("*")):
        if file.is_file():
            found.update(f"{file.relative_to(path.resolve()).as_posix()}\0{of(file)}\n".encode())
    return found.hexdigest()


def _exists(path: Any) -> bool:
    try:
        return bool(path.exists())
    except (OSError, ValueError):  # a name that no file can have
        return False
