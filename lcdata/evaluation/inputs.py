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


def parameter_files(method: Calibrator) -> dict[str, Path]:
    """Parameters that name a file or folder that is there: masks, the model of a network.

    Such a parameter is a `Path`, or a string that is not its default.
    """
    found: dict[str, Path] = {}
    known: tuple[dataclasses.Field[Any], ...] = (
        dataclasses.fields(method) if dataclasses.is_dataclass(method) else ()
    )
    for field in known:
        value = getattr(method, field.name)
        named = isinstance(value, str) and value not in {"", field.default}
        if (named or isinstance(value, Path)) and _exists(Path(value)):
            found[field.name] = Path(value)
    return found


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
