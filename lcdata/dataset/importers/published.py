"""What every published format is brought to: scenarios with their pairs, not yet read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lcdata.dataset.importers.files import misfit
from lcdata.errors import SourceError
from lcdata.geometry.camera import Camera
from lcdata.recording.cloud_files import CloudFile, read_cloud

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Item:
    """A pair as published: where its files are and what is known of it.

    Args:
        name: What its publisher calls it; it ends the pair_id.
        image: PNG or JPEG, kept byte by byte.
        cloud: File that `read` reads; every field is kept.
        stamp_image_ns: Time of the image.
        stamp_lidar_ns: Time of the scan.
        T_camera_lidar: 4x4 reference, maps LiDAR points to camera points.
        covariance: 6x6 of the reference, translation (m) then rotation (rad), in the camera
            frame; None where it is unknown.
        T_moved: 4x4, maps the file's points to those of the pair, where the LiDAR moved between
            the scan and the image; None if they are as in the file.
        masks: One file, a semantic mask of the image; or a tuple of files, a segment each.
        read: Reader of the cloud.
    """

    name: str
    image: Path
    cloud: Path
    stamp_image_ns: int
    stamp_lidar_ns: int
    T_camera_lidar: Array
    covariance: Array | None = None
    T_moved: Array | None = None
    masks: Path | tuple[Path, ...] = ()
    read: Callable[[Path], CloudFile] = read_cloud

    @property
    def mask_files(self) -> tuple[Path, ...]:
        """All files of its masks."""
        return (self.masks,) if isinstance(self.masks, Path) else self.masks

    @property
    def files(self) -> tuple[Path, ...]:
        """All its files."""
        return (self.image, self.cloud, *self.mask_files)


@dataclass(frozen=True)
class Lost:
    """A pair that cannot be taken.

    Args:
        name: What its publisher calls it.
        reason: Why, with the file, and the remedy if there is one.
    """

    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class Published:
    """Pairs of one scenario: one camera, one LiDAR.

    Args:
        name: Of the scenario.
        camera: Model and intrinsics of its images.
        items: In order of time, those that cannot be taken among them.
        image: What the publisher calls the camera.
        lidar: What the publisher calls the LiDAR.
        calibration: Files that camera and extrinsics were read from.
        warnings: What a user should know about it, a line each.
        tolerance_ms: How far the stamps of a pair may be apart.
    """

    name: str
    camera: Camera
    items: tuple[Item | Lost, ...]
    image: str
    lidar: str
    calibration: tuple[Path, ...]
    warnings: tuple[str, ...] = ()
    tolerance_ms: float = 50.0

    @property
    def pairs(self) -> list[Item]:
        """Those that can be taken."""
        return [item for item in self.items if isinstance(item, Item)]


class Importer(Protocol):
    """A published format."""

    @property
    def format(self) -> str:
        """What a user calls it."""

    @property
    def source(self) -> Path:
        """The folder to import."""

    def recordings(self) -> Mapping[str, Callable[[], Published]]:
        """What lists the pairs of each recording in the folder, by its publisher's name for it.

        Several recordings may be of one scenario.

        Raises:
            SourceError: The folder holds none.
        """


@dataclass(frozen=True)
class Choice:
    """Which pairs are wanted.

    Args:
        only: Recordings by their publisher's names; empty for all.
        every: Every so manieth pair of a recording, from the first on.
        limit: At most so many pairs of a scenario; None for all.
    """

    only: tuple[str, ...] = ()
    every: int = 1
    limit: int | None = None

    def recordings(self, names: Iterable[str]) -> list[str]:
        """Those names that are wanted.

        Raises:
            SourceError: One that is wanted is not there.
        """
        there = list(names)
        for name in self.only:
            if name not in there:
                shown = ", ".join(there[:8]) + (", ..." if len(there) > 8 else "")
                raise SourceError(f"no {name!r} among the recordings", f"there are {shown}")
        return [name for name in there if not self.only or name in self.only]


@dataclass
class Listing:
    """What is to be imported.

    Args:
        scenarios: In the order in which they were found.
        failures: Why recordings and pairs cannot be taken, by name.
    """

    scenarios: list[Published] = field(default_factory=list)
    failures: dict[str, str] = field(default_factory=dict)


def list_pairs(importer: Importer, choice: Choice) -> Listing:
    """The pairs that are wanted, by scenario.

    Raises:
        SourceError: There are none, or one that was asked for is not there.
    """
    if not importer.source.exists():
        raise SourceError(f"{importer.source} does not exist", "give the folder of the data")
    if not importer.source.is_dir():
        raise SourceError(f"{importer.source} is a file", "give the folder that it is in")
    listing = Listing()
    found: dict[str, Published] = {}
    errors: list[SourceError] = []
    recordings = importer.recordings()
    for name in choice.recordings(recordings):
        try:
            part = recordings[name]()
        except SourceError as error:
            errors.append(error)
            listing.failures[name] = str(error)
            continue
        part = replace(part, items=part.items[:: choice.every])
        found[part.name] = _joined(found[part.name], part) if part.name in found else part
    for scenario in found.values():
        kept = replace(scenario, items=scenario.items[: choice.limit])
        kept = replace(kept, items=tuple(_in_time(item, kept.tolerance_ms) for item in kept.items))
        kept, unusable = _with_usable_masks(kept)
        lost = [item for item in kept.items if isinstance(item, Lost)]
        listing.failures |= {f"{kept.name}/{item.name}": item.reason for item in lost}
        listing.failures |= unusable
        if kept.pairs:
            listing.scenarios.append(kept)
    if not listing.scenarios:
        raise _no_pairs(importer, errors, listing)
    return listing


def _joined(first: Published, second: Published) -> Published:
    """Two recordings of one scenario."""
    if first.camera != second.camera:
        raise SourceError(
            f"{first.name}: recordings of different cameras", "import each by itself with --only"
        )
    return replace(
        first,
        items=first.items + second.items,
        warnings=tuple(dict.fromkeys(first.warnings + second.warnings)),
    )


def _in_time(item: Item | Lost, tolerance_ms: float) -> Item | Lost:
    """Refuse a pair whose image is too far from its scan."""
    if isinstance(item, Lost):
        return item
    apart_ms = abs(item.stamp_image_ns - item.stamp_lidar_ns) / 1e6
    if apart_ms <= tolerance_ms:
        return item
    return Lost(item.name, f"image {apart_ms:.4g} ms from the scan (limit {tolerance_ms:g} ms)")


def _with_usable_masks(scenario: Published) -> tuple[Published, dict[str, str]]:
    """The scenario without masks that do not fit their images, and why by the mask's name."""
    size = scenario.camera.width, scenario.camera.height
    problems: dict[str, str] = {}
    items: list[Item | Lost] = []
    for item in scenario.items:
        fitting = item
        if isinstance(item, Item) and item.mask_files:
            found = {file: problem for file in item.mask_files if (problem := misfit(file, size))}
            label = f"{scenario.name}/{item.name}: its mask"
            problems |= {f"{label} {file.name}": problem for file, problem in found.items()}
            left = tuple(file for file in item.mask_files if file not in found)
            one = isinstance(item.masks, Path) and left
            fitting = replace(item, masks=left[0] if one else left)
        items.append(fitting)
    return replace(scenario, items=tuple(items)), problems


def _no_pairs(importer: Importer, errors: list[SourceError], listing: Listing) -> SourceError:
    if len(errors) == len(listing.failures) == 1:
        return errors[0]
    shown = [f"{name}: {reason}" for name, reason in list(listing.failures.items())[:3]]
    more = len(listing.failures) - len(shown)
    return SourceError(
        f"no pair to import in {importer.source}",
        "; ".join([*shown, f"and {more} more"] if more > 0 else shown),
    )
