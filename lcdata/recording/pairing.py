"""Which image belongs to which scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Indices = NDArray[np.intp]
Stamps = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Pairing:
    """Pairs of scans and images.

    Args:
        lidar: (P,) indices of scans, by stamp.
        image: (P,) indices of their images.
        dt_ns: (P,) image's stamp minus scan's.
        nearest_ns: Smallest distance of any scan to any image; None without scans or images.
        tolerance_ns: Limit.
    """

    lidar: Indices
    image: Indices
    dt_ns: Stamps
    nearest_ns: int | None
    tolerance_ns: int

    def reason(self) -> str:
        """Why there is no pair."""
        if self.nearest_ns is None:
            return "no image to pair a scan with"
        return (
            f"nearest image was {self.nearest_ns / 1e6:.4g} ms away "
            f"(limit {self.tolerance_ns / 1e6:.4g} ms)"
        )


def pair_stamps(lidar_ns: ArrayLike, image_ns: ArrayLike, tolerance_ns: int) -> Pairing:
    """Pair each scan with the nearest image within the tolerance, each image at most once.

    Where two scans have the same nearest image, the nearer scan gets it and the other one the
    nearest image that is left.

    Args:
        lidar_ns: (L,) stamps of scans, in any order.
        image_ns: (M,) stamps of images, in any order.
        tolerance_ns: Largest distance.
    """
    lidar, image = np.asarray(lidar_ns, np.int64), np.asarray(image_ns, np.int64)
    if not len(lidar) or not len(image):
        none = np.empty(0, np.intp)
        return Pairing(none, none, np.empty(0, np.int64), None, tolerance_ns)
    matched = np.full(len(lidar), -1, np.intp)
    scans, images = np.arange(len(lidar)), np.argsort(image, kind="stable")
    nearest_ns: int | None = None
    while len(scans) and len(images):
        nearest = images[_nearest(image[images], lidar[scans])]
        distance = np.abs(image[nearest] - lidar[scans])
        nearest_ns = int(distance.min()) if nearest_ns is None else nearest_ns
        order = np.lexsort((lidar[scans], distance))
        order = order[distance[order] <= tolerance_ns]
        _, first = np.unique(nearest[order], return_index=True)
        winners = order[first]
        if not len(winners):
            break
        matched[scans[winners]] = nearest[winners]
        scans = np.delete(scans, winners)
        images = images[~np.isin(images, nearest[winners])]
    pairs = np.flatnonzero(matched >= 0)
    pairs = pairs[np.argsort(lidar[pairs], kind="stable")]
    dt = image[matched[pairs]] - lidar[pairs]
    return Pairing(pairs, matched[pairs], dt, nearest_ns, tolerance_ns)


def _nearest(sorted_values: Stamps, values: Stamps) -> Indices:
    """Index of the nearest sorted value."""
    right = np.clip(np.searchsorted(sorted_values, values), 1, max(len(sorted_values) - 1, 1))
    right = np.minimum(right, len(sorted_values) - 1)
    left = np.maximum(right - 1, 0)
    nearer = values - sorted_values[left] <= sorted_values[right] - values
    return np.where(nearer, left, right)


def select(count: int, per_pose: int | None) -> Indices:
    """Indices of at most `per_pose` of `count` pairs, evenly spread; all of them for None."""
    if per_pose is None or per_pose >= count:
        return np.arange(count)
    return ((np.arange(per_pose) + 0.5) * count / per_pose).astype(np.intp)
