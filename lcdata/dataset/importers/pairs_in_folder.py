"""Images and clouds of a folder as pairs of one camera and one extrinsic."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset.importers import files
from lcdata.dataset.importers.published import Item, Lost
from lcdata.errors import SourceError

Array = NDArray[np.float64]

STEP_NS = 100_000_000
"""Between the stamps that pairs get whose names are none."""

DIGITS = 13
"""A name of fewer digits counts frames, it is no time in ns."""


def pair_up(
    images: Sequence[Path], clouds: Sequence[Path], where: Path, *, by_order: bool = False
) -> list[tuple[str, Path | None, Path | None]]:
    """Which image belongs to which cloud.

    Args:
        images: In order.
        clouds: In order.
        where: The folder, for an error.
        by_order: The first image belongs to the first cloud, whatever they are called.

    Returns:
        Name, image and cloud of each pair; None for what is not there.

    Raises:
        SourceError: There are none, two of one name, or their numbers differ.
    """
    for kind, found, suffixes in (("image", images, files.IMAGES), ("cloud", clouds, files.CLOUDS)):
        if not found:
            raise SourceError(f"{where}: no {kind} in it", f"{kind}s are {', '.join(suffixes)}")
    if by_order or len(images) == len(clouds) == 1:
        if len(images) != len(clouds):
            raise SourceError(
                f"{where}: {len(images)} images and {len(clouds)} clouds cannot be paired by order",
                "give them equal names, or remove what has no partner",
            )
        return [(files.stem(i), i, c) for i, c in zip(images, clouds, strict=True)]
    of_image, of_cloud = files.by_stem(images), files.by_stem(clouds)
    if not of_image.keys() & of_cloud.keys():
        raise SourceError(
            f"{where}: no image has the name of a cloud ({images[0].name}, {clouds[0].name})",
            "give pairs equal names, or --by-order where there are as many images as clouds",
        )
    names = [*of_image, *(name for name in of_cloud if name not in of_image)]
    return [(name, of_image.get(name), of_cloud.get(name)) for name in names]


def items_of(
    named: Sequence[tuple[str, Path | None, Path | None]],
    folder: Path,
    T_camera_lidar: Array,
    covariance: Array | None = None,
    masks: Path | None = None,
) -> tuple[tuple[Item | Lost, ...], list[str]]:
    """Pairs with stamps and masks.

    Args:
        named: As of `pair_up`.
        folder: The folder of the pairs.
        T_camera_lidar: 4x4 of all of them.
        covariance: 6x6 of it; None where it is unknown.
        masks: Folder of the masks, if it is not `masks` in the folder.

    Returns:
        The pairs, and what a user should know about them.
    """
    stamps = _stamps([name for name, _, _ in named])
    made = stamps is None
    alone = len(named) == 1
    items: list[Item | Lost] = []
    for number, (name, image, cloud) in enumerate(named):
        if image is None or cloud is None:
            there, lacking = ("an image", "cloud") if image else ("a cloud", "image")
            items.append(Lost(name, f"there is {there} of this name, but no {lacking}"))
            continue
        stamp = number * STEP_NS if stamps is None else stamps[number]
        beside = files.masks_of(folder, files.stem(image), alone=alone, masks=masks)
        items.append(
            Item(name, image, cloud, stamp, stamp, T_camera_lidar, covariance, masks=beside)
        )
    note = f"{folder}: names of files are no stamps: pairs have made ones, 0.1 s apart"
    return tuple(items), [note] if made and not alone else []


def _stamps(names: Sequence[str]) -> list[int] | None:
    """Stamps in ns that names are: nanoseconds, or seconds with a point; None if they are none."""
    result = []
    for name in names:
        whole, point, fraction = name.partition(".")
        if not (name.isascii() and whole.isdecimal() and (not point or fraction.isdecimal())):
            return None
        if not point and len(whole) < DIGITS:
            return None
        stamp = int(Decimal(name).scaleb(9)) if point else int(whole)
        if stamp >= 1 << 62:
            return None
        result.append(stamp)
    return result
