"""Images, clouds and masks in folders, and which belong together."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from lcdata.dataset.schema import in_order
from lcdata.errors import SourceError
from lcdata.recording import images
from lcdata.recording.cloud_files import READERS

IMAGES = (".png", ".jpg", ".jpeg")
CLOUDS = tuple(READERS)
MASKS = "masks"

HEAD = 1 << 18
"""Bytes at the beginning of an image that hold its size, metadata before it included."""

SAMPLED = 9
"""How many images are asked for the size that all of them should have."""


def files_in(folder: Path, suffixes: Sequence[str]) -> list[Path]:
    """Files of some kinds in a folder, numbers in their names in order; none if it is not there.

    Raises:
        SourceError: The folder cannot be read.
    """
    try:
        found = [
            file
            for file in folder.iterdir()
            if file.suffix.lower() in suffixes and not file.name.startswith(".") and file.is_file()
        ]
    except (FileNotFoundError, NotADirectoryError):
        return []
    except OSError as error:
        raise SourceError(
            f"{folder}: cannot be read ({error.strerror})", "check the permissions"
        ) from error
    return sorted(found, key=lambda file: in_order(file.name))


def stem(file: Path) -> str:
    """Name of a file without its suffixes; `a` of `a.pcd.bin`."""
    return re.sub(r"\.pcd$", "", file.stem, flags=re.IGNORECASE)


def frame(file: Path) -> int | None:
    """Number that a file's name is; None if it is another name."""
    return int(file.stem) if file.stem.isascii() and file.stem.isdecimal() else None


def by_stem(files: Iterable[Path]) -> dict[str, Path]:
    """Files by name without suffix.

    Raises:
        SourceError: Two have the same.
    """
    result: dict[str, Path] = {}
    for file in files:
        other = result.setdefault(stem(file), file)
        if other != file:
            raise SourceError(
                f"{other} and {file.name} have the same name", "keep one: the name makes the pair"
            )
    return result


def image_size(path: Path) -> tuple[int, int] | None:
    """Width and height of a PNG or JPEG in pixels by its header; None if it has none."""
    try:
        with path.open("rb") as file:
            height, width = images.size(file.read(HEAD))
    except OSError:
        return None
    return (width, height) if width > 0 and height > 0 else None


def common_size(paths: Sequence[Path], where: Path) -> tuple[int, int]:
    """Width and height that most images have.

    Args:
        paths: The images; a few of them are asked.
        where: Where they are, for an error.

    Raises:
        SourceError: None of them is an image.
    """
    step = max(1, len(paths) // SAMPLED)
    sizes = [size for size in map(image_size, paths[::step]) if size]
    sizes = sizes or [size for size in map(image_size, paths) if size]
    if not sizes:
        raise SourceError(f"{where}: no PNG or JPEG image that can be read", "check the files")
    return Counter(sizes).most_common(1)[0][0]


def masks_of(
    folder: Path, name: str, *, alone: bool, masks: Path | None = None
) -> Path | tuple[Path, ...]:
    """Masks that lie beside an image.

    Args:
        folder: `NAME_mask.png` may lie in it.
        name: Of the image, without suffix.
        alone: Whether there is this pair only: then `mask.jpg` in the folder and the files
            of the folder of masks are its own too.
        masks: Folder in which `NAME.png` or `.jpg` is one mask, and `NAME/` holds a segment each;
            `folder / "masks"` if it is not given.

    Returns:
        One mask, or the segments, of which there may be none.
    """
    masks = masks or folder / MASKS
    if segments := files_in(masks / name, IMAGES):
        return tuple(segments)
    candidates = [masks / name, folder / f"{name}_mask", *([folder / "mask"] if alone else [])]
    for candidate in candidates:
        for suffix in IMAGES:
            if (file := candidate.with_name(candidate.name + suffix)).is_file():
                return file
    return tuple(files_in(masks, IMAGES)) if alone else ()


def without_masks(files: Iterable[Path]) -> list[Path]:
    """Images of a folder that are no masks of others."""
    return [f for f in files if f.stem != "mask" and not f.stem.endswith("_mask")]


def misfit(mask: Path, size: tuple[int, int]) -> str:
    """What is wrong with a mask of an image of a size (width, height); nothing if it fits."""
    found = image_size(mask)
    if found is None:
        return "no PNG or JPEG image"
    if found != size:
        return f"mask of {found[0]}x{found[1]}, its image has {size[0]}x{size[1]}"
    return ""
